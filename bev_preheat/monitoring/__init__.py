# SPDX-License-Identifier: Apache-2.0
"""Running planners seen from outside: found, heard, put into one view, asked; the view in a terminal."""
