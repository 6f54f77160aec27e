# SPDX-License-Identifier: Apache-2.0
"""Parts of `python -m bev_preheat.demo`: processes, observer, display and picture."""
