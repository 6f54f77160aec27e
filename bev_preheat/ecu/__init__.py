# SPDX-License-Identifier: Apache-2.0
"""The planner as C sources for one vehicle, with plans of Python for comparison."""
