# SPDX-License-Identifier: Apache-2.0
"""The planner's inputs and answers, in MCAP files; see docs/how-to/replay.md."""
