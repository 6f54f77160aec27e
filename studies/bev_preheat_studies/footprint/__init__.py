# SPDX-License-Identifier: Apache-2.0
"""Footprint of the planner as C sources for a control unit: bytes, stack, instructions."""
