# SPDX-License-Identifier: Apache-2.0
"""The planner's inputs and answers, written to MCAP files and put through its step again."""
