# SPDX-License-Identifier: Apache-2.0
"""The planner in closed loop with many cars that differ from their vehicle file."""
