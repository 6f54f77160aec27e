# SPDX-License-Identifier: Apache-2.0
"""What the planner takes as C sources for a control unit: bytes, stack, instructions."""
