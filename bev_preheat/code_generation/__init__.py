# SPDX-License-Identifier: Apache-2.0
"""C from the Python equations and constants: headers of the core, and the planner as sources for an ECU."""
