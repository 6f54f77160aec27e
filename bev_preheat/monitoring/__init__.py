# SPDX-License-Identifier: Apache-2.0
"""Running planners seen from outside, in a terminal and on a live web page; the report of a recording."""
