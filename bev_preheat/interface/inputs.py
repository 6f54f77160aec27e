# SPDX-License-Identifier: Apache-2.0
"""Vehicles and routes for the public interface, by name, by file or from numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.files.configuration import configuration_folder
from bev_preheat.logs.reading import read_recording
from bev_preheat.route import make_route as make_route_of_columns
from bev_preheat.route import route_for
from bev_preheat.vehicle import load_vehicle as load_vehicle_file

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import ArrayLike

    from bev_preheat.logs.recording import Recording
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle


def vehicles() -> list[str]:
    """Return the names of the vehicles that come with the package."""
    return sorted(path.stem for path in configuration_folder('vehicles').glob('*.yaml'))


def routes() -> list[str]:
    """Return the names of the routes that come with the package, `legs/NAME` for descriptions of legs."""
    folder = configuration_folder('routes')
    return sorted(path.stem for path in folder.glob('*.csv')) + sorted(
        f'legs/{path.stem}' for path in (folder / 'legs').glob('*.yaml'))


def load_vehicle(name_or_file: str | Path) -> Vehicle:
    """Return the Vehicle of a name in `vehicles()` or of a YAML file; raises InvalidInput."""
    return load_vehicle_file(name_or_file)


def load_route(name_or_file: str | Path, vehicle: Vehicle) -> Route:
    """
    Return the Route of a name in `routes()`, a CSV file or a YAML description of legs, driven by a vehicle.

    Raises InvalidInput, which names file, place, value and allowed range.
    """
    return route_for(name_or_file, vehicle).route


def load_recording(file: str | Path, signals: str | Path | None = None, repair: bool = False) -> Recording:
    """
    Return the Recording of a drive log of any known format; `signals` is a signal map (None: found).

    With `repair` mix-ups of sign, unit and scale are corrected. Raises InvalidInput, which names file, place,
    value.
    """
    return read_recording(file, signals, repair)


def make_route(columns: Mapping[str, ArrayLike], vehicle: Vehicle) -> Route:
    """
    Return a Route of columns by name, each of shape (N,) or one number for all segments.

    `duration_s`, `speed_mps`, `propulsion_power_w` and `ambient_temperature_c` are needed;
    `propulsion_power_rms_w`, `cabin_heating_power_w` and `auxiliary_power_w` have defaults. Raises InvalidInput.
    """
    return make_route_of_columns(
        {name: np.atleast_1d(np.asarray(values, dtype=float)) for name, values in columns.items()},
        vehicle.defaults)
