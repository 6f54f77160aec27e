# SPDX-License-Identifier: Apache-2.0
"""Routes: segments, files, and where routes come from."""

from bev_preheat.route.csv_file import load_route, route_file, save_route
from bev_preheat.route.segments import Route, make_route

__all__ = ['Route', 'load_route', 'make_route', 'route_file', 'save_route']
