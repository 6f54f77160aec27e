# SPDX-License-Identifier: Apache-2.0
"""A recording put through the planner's step again: what it answered, and why."""
