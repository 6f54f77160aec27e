# SPDX-License-Identifier: Apache-2.0
"""A recording put through the planner's step again: its answers and their reasons."""
