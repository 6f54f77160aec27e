# SPDX-License-Identifier: Apache-2.0
"""Routes: segments, files, and where routes come from."""

from bev_preheat.route.csv_file import load_route, route_file, save_route
from bev_preheat.route.for_vehicle import route_for, route_source, RouteForVehicle
from bev_preheat.route.segments import make_route, Route

__all__ = ['Route', 'RouteForVehicle', 'load_route', 'make_route', 'route_file', 'route_for',
           'route_source', 'save_route']
