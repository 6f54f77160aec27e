# SPDX-License-Identifier: Apache-2.0
"""Planning when to heat: the methods, their common parts, and plans as text."""
