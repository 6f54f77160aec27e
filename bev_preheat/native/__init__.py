# SPDX-License-Identifier: Apache-2.0
"""The compiled core: C made from the equations, and calls of the library that it becomes."""
