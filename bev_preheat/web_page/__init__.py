# SPDX-License-Identifier: Apache-2.0
"""What this package's web pages embed, so that they work offline: the library of curves, and its style."""
