# SPDX-License-Identifier: Apache-2.0
"""Running planners seen from outside, on a live web page; the report of a recording."""
