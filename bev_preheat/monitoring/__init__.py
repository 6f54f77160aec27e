# SPDX-License-Identifier: Apache-2.0
"""A running planner, watched in a terminal."""
