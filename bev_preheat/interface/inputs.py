# SPDX-License-Identifier: Apache-2.0
"""Vehicles and routes for the public interface, by name, by file or from numbers."""

from __future__ import annotations

import math
from numbers import Integral, Real
import re
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
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


def make_vehicle(name: str, *, chemistry: str, charging_power_kw: float, **figures: float | None) -> Vehicle:
    """
    Return a Vehicle from the figures of a data sheet; missing values are assumed, and listed in `Vehicle.assumed`.

    `chemistry` is 'nmc' (also for NCA) or 'lfp', `charging_power_kw` the most at a fast charger [kW]. Also needed:
    `usable_energy_kwh` or `gross_energy_kwh`, and `nominal_voltage_v` or `cells_in_series`. The other figures:
    `battery_mass_kg`, `heater_power_kw`, `drive_power_kw`, `regeneration_power_kw`, `cabin_heating_power_kw`,
    `auxiliary_power_kw`, `target_temperature_c`; for routes given as legs of road also `vehicle_mass_kg`,
    `drag_coefficient`, `frontal_area_m2`, `rolling_resistance`. `preheat vehicle new` writes the same car to a
    file, with the source of each value. Raises InvalidInput, which names figure, value and plausible range.
    """
    from bev_preheat.vehicle.data_sheet import DataSheet
    from bev_preheat.vehicle.data_sheet_import import describe_car
    from bev_preheat.vehicle.loading import vehicle_of_text
    from bev_preheat.vehicle.writing import vehicle_text
    given = {'charging_power_kw': charging_power_kw,
             **{figure: value for figure, value in figures.items() if value is not None}}
    _check_figures(name, chemistry, given)
    try:
        entries = describe_car(DataSheet(name, chemistry.lower(), **given))  # type: ignore[arg-type]
        return vehicle_of_text(vehicle_text(name, entries, 'bev_preheat.make_vehicle'), f'vehicle {name}')
    except InvalidInput as error:
        # The data sheet speaks of the options of `preheat vehicle new`.
        raise InvalidInput([re.sub('--([a-z][a-z0-9-]*)', lambda option: option[1].replace('-', '_'), problem)
                            for problem in error.problems]) from error


def _check_figures(name: object, chemistry: object, figures: Mapping[str, object]) -> None:
    """Raise InvalidInput if a figure is unknown or not a number, or name or chemistry is not a text."""
    from difflib import get_close_matches

    from bev_preheat.vehicle.data_sheet import QUANTITIES
    problems = [f'{field}: {value!r} is not a text' for field, value in (('name', name), ('chemistry', chemistry))
                if not isinstance(value, str)]
    for figure, value in figures.items():
        if figure not in QUANTITIES:
            near = get_close_matches(figure, QUANTITIES, n=1)
            hint = f'did you mean {near[0]}?' if near else f'known: {", ".join(QUANTITIES)}'
            problems.append(f'{quoted(figure)} is not a figure of a data sheet; {hint}')
        elif isinstance(value, bool) or not isinstance(value, Real) or math.isnan(value):
            problems.append(f'{figure}: {quoted(str(value))} is not a number')
        elif figure == 'cells_in_series' and not isinstance(value, Integral):
            problems.append(f'{figure}: {value} is not a whole number')
    if problems:
        raise InvalidInput(problems)


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
