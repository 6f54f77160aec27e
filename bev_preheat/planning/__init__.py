# SPDX-License-Identifier: Apache-2.0
"""When to heat: the methods, what they share, and plans in words."""
