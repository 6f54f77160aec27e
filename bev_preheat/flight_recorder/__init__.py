# SPDX-License-Identifier: Apache-2.0
"""What the planner was given and what it answered, in MCAP files; see docs/how-to/replay.md."""
