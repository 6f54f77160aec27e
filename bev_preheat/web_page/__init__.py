# SPDX-License-Identifier: Apache-2.0
"""Scripts and styles of web pages: curves, embedded so that the pages work offline."""
