# SPDX-License-Identifier: Apache-2.0
"""Kinds of number that the equations take: floats, arrays, symbols."""
