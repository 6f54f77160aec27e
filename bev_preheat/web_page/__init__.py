# SPDX-License-Identifier: Apache-2.0
"""What web pages of this package are made of: the library of curves and its style, embedded so that they work offline."""
