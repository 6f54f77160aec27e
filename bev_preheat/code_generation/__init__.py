# SPDX-License-Identifier: Apache-2.0
"""C headers generated from the Python equations and constants; the core's build and the export use them."""
