# SPDX-License-Identifier: Apache-2.0
"""
Routes: segments, files and sources.

Modules that read and write files are imported on first use: a planner gets its routes as messages.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TYPE_CHECKING

from bev_preheat.route.segments import make_route, Route

__all__ = ['Route', 'RouteForVehicle', 'load_route', 'make_route', 'route_file', 'route_for',
           'route_source', 'save_route']

if TYPE_CHECKING:
    from bev_preheat.route.csv_file import load_route, route_file, save_route
    from bev_preheat.route.for_vehicle import route_for, route_source, RouteForVehicle
else:
    _MODULES = {
        'load_route': 'csv_file', 'route_file': 'csv_file', 'save_route': 'csv_file',
        'route_for': 'for_vehicle', 'route_source': 'for_vehicle', 'RouteForVehicle': 'for_vehicle'}

    def __getattr__(name: str) -> Any:
        """Return a name of `__all__` from its module."""
        if name not in _MODULES:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
