# SPDX-License-Identifier: Apache-2.0
"""Factors between units, and constants of nature: each once."""

NS_PER_S = 10**9
S_PER_MIN = 60.0
S_PER_H = 3600.0
NS_PER_DAY = 86400 * NS_PER_S
W_PER_KW = 1000.0
WH_PER_KWH = 1000.0
JOULES_PER_WH = 3600.0
# Mean radius of the earth [m], WGS 84.
EARTH_RADIUS_M = 6_371_008.8
