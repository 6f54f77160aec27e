# SPDX-License-Identifier: Apache-2.0
"""The parts of `python -m bev_preheat.demo`: processes, what they say, display and picture."""
