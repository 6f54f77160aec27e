# SPDX-License-Identifier: Apache-2.0
"""The native core: C made from the equations, and calls of the library that it becomes."""
