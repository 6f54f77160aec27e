# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle as a node, its clock, and scenarios driven by nodes."""
