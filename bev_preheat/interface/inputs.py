# SPDX-License-Identifier: Apache-2.0
"""Arguments of the public interface: vehicles and routes by name, by file or from numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial, wraps
from importlib import import_module
from inspect import signature
import math
from numbers import Integral, Real
import os
from pathlib import Path
import re
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.recording import Recording
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import make_route as make_route_of_columns
from bev_preheat.route import Route, route_for
from bev_preheat.route.for_vehicle import route_source, RouteForVehicle
from bev_preheat.route.sources.journey import Offers, RouteOptions
from bev_preheat.vehicle import load_vehicle as load_vehicle_file
from bev_preheat.vehicle import Vehicle

Arguments = ParamSpec('Arguments')
Returned = TypeVar('Returned')
LONGEST_QUOTED = 60
# The arguments of `load_route`.
OFFERS = Offers('{}={!r}', {
    'ambient_temperature_c': ('ambient_c', 'degC', -5), 'free_speed_kmh': ('free_speed_kmh', 'km/h', 90),
    'stop_duration_s': ('stop_duration_s', 's', 1200), 'vehicle_id': ('vehicle_id', ''),
    'with_auxiliaries': ('consumption', '', 'total', 'drivetrain')})


class _Kind(NamedTuple):
    """The allowed values of an argument, as a function and as text."""

    is_allowed: Callable[[Any], bool]
    words: str


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_method(value: Any) -> bool:
    return isinstance(value, str) or callable(value)


def _is_list(value: Any, is_item: Callable[[Any], bool]) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, str) and all(map(is_item, value))


def _is_public(value: Any, name: str) -> bool:
    # Not all of them are needed at once.
    return isinstance(value, getattr(import_module('bev_preheat'), name))


def _has_numbers(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and all(isinstance(field, bool) or _is_number(field)
                                           for field in vars(value).values())


NUMBER = _Kind(_is_number, 'a number')
FILE = _Kind(lambda value: isinstance(value, str | os.PathLike), 'a name or a path (text)')
KINDS = {
    'vehicle': _Kind(lambda value: isinstance(value, Vehicle), 'a Vehicle, as load_vehicle returns'),
    'route': _Kind(lambda value: isinstance(value, Route), 'a Route, as load_route returns'),
    'state': _Kind(lambda value: _has_numbers(value, BatteryState),
                   'a BatteryState with numbers, such as BatteryState(-7.0, 0.9)'),
    'goal': _Kind(lambda value: _is_number(value) or _has_numbers(value, Goal), 'a Goal or a number [deg C]'),
    'method': _Kind(_is_method, 'the name of a method, or a function of a MethodSituation'),
    'methods': _Kind(lambda value: _is_list(value, _is_method), 'a list of names or functions'),
    'recordings': _Kind(lambda value: _is_list(value, partial(_is_public, name='Recording')),
                        'a list of Recordings, as load_recording returns'),
    'mismatch': _Kind(lambda value: _is_public(value, 'Mismatch'), 'a Mismatch'),
    'sensors': _Kind(lambda value: _is_public(value, 'Sensors'), 'Sensors'),
    'heater_faults': _Kind(lambda value: _is_list(value, partial(_is_public, name='HeaterFault')),
                           'a list of HeaterFaults'),
    'columns': _Kind(lambda value: isinstance(value, Mapping), 'a dictionary of columns by name'),
    'name_or_file': FILE, 'file': FILE, 'signals': FILE,
    'seed': _Kind(lambda value: isinstance(value, Integral), 'a whole number'),
    **dict.fromkeys(('charger_power_w', 'departure_soc', 'ambient_c', 'cabin_heating_power_w', 'auxiliary_power_w',
                     'energy_price_per_kwh', 'value_of_time_per_h', 'free_speed_kmh', 'stop_duration_s'), NUMBER),
    **dict.fromkeys(('trips', 'feasible', 'jobs', 'leg'), _Kind(
        lambda value: isinstance(value, Integral), 'a whole number')),
    **dict.fromkeys(('repair', 'estimation', 'limits'), _Kind(
        lambda value: isinstance(value, bool), 'True or False')),
}


def checked(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
    """Return a function that raises InvalidInput, one problem an argument, if one in KINDS has a wrong type."""
    parameters = signature(function)
    optional = {name for name, parameter in parameters.parameters.items() if 'None' in str(parameter.annotation)}

    @wraps(function)
    def call(*given: Arguments.args, **named: Arguments.kwargs) -> Returned:
        bound = parameters.bind(*given, **named)
        problems = [f'{name}: must be {KINDS[name].words}, not {_in_words(value)}'
                    for name, value in bound.arguments.items()
                    if name in KINDS and not (value is None and name in optional)
                    and not KINDS[name].is_allowed(value)]
        if problems:
            raise InvalidInput(problems)
        return function(*given, **named)

    return call


def _in_words(value: Any) -> str:
    """Return a value and its type for a message."""
    return f'{type(value).__name__} {quoted(shortened(str(value), LONGEST_QUOTED))}'


# Larger files [bytes] that are no routes are not read a second time.
LARGEST_LOG = 32_000_000


def vehicles() -> list[str]:
    """Return the names of the vehicles that come with the package."""
    return sorted(path.stem for path in configuration_folder('vehicles').glob('*.yaml'))


def routes() -> list[str]:
    """Return the names of the routes that come with the package, `legs/NAME` for descriptions of legs."""
    folder = configuration_folder('routes')
    return sorted(path.stem for path in folder.glob('*.csv')) + sorted(
        f'legs/{path.stem}' for path in (folder / 'legs').glob('*.yaml'))


@checked
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
        # The options of the command are arguments here.
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


@checked
def load_route(name_or_file: str | Path, vehicle: Vehicle, *, ambient_c: float | None = None,
               free_speed_kmh: float | None = None, stop_duration_s: float | None = None,
               consumption: str | None = None, vehicle_id: str | None = None, leg: int | None = 0) -> Route:
    """
    Return the Route of a name in `routes()` or of a file of any format, driven by a vehicle, as `--route` does.

    Some files need more: `ambient_c` [deg C]; `free_speed_kmh`, for a line without times; `stop_duration_s` [s],
    if the waypoints of navigation are charging stops; `consumption`, 'total' or 'drivetrain'; `vehicle_id`, in a
    file of several cars. Of a way with charging stops, `leg` is the part up to the first one (0), a later part, or
    the whole way (None). Raises InvalidInput, which names file, place, value and allowed range.
    """
    if consumption not in (None, 'total', 'drivetrain'):
        raise InvalidInput(f"consumption: must be 'total' or 'drivetrain', not {quoted(str(consumption))}")
    if stop_duration_s is not None and not 60.0 <= stop_duration_s <= 86400.0:
        raise InvalidInput(f'stop_duration_s: {stop_duration_s:g} is not allowed; it must be 60 ... 86400 s')
    loaded = route_or_log(name_or_file, vehicle, RouteOptions(
        ambient_c, None if consumption is None else consumption == 'total', free_speed_kmh, stop_duration_s,
        vehicle_id, OFFERS))
    if leg is None:
        return loaded.route
    edges = [0, *(stop.after_segment + 1 for stop in loaded.stops), len(loaded.route)]
    if not 0 <= leg < len(edges) - 1:
        raise InvalidInput(f'leg: {leg} is not allowed; it must be 0 ... {len(edges) - 2}')
    return loaded.route.segments(edges[leg], edges[leg + 1])


@checked
def load_recording(file: str | Path, signals: str | Path | None = None, repair: bool = False) -> Recording:
    """
    Return the Recording of a drive log of any known format; `signals` is a signal map (None: found).

    With `repair` mix-ups of sign, unit and scale are corrected. Raises InvalidInput, which names file, place,
    value.
    """
    return read_recording(file, signals, repair)


@checked
def make_route(columns: Mapping[str, ArrayLike], vehicle: Vehicle) -> Route:
    """
    Return a Route of columns by name, each of shape (N,) or one number for all segments.

    `duration_s`, `speed_mps`, `propulsion_power_w` and `ambient_temperature_c` are needed;
    `propulsion_power_rms_w`, `cabin_heating_power_w` and `auxiliary_power_w` have defaults. Raises InvalidInput.
    """
    arrays = {}
    for name, values in columns.items():
        try:
            arrays[name] = np.atleast_1d(np.asarray(values, dtype=float))
        except (TypeError, ValueError) as error:
            raise InvalidInput(f'{name}: must be numbers: {error}') from error
    return make_route_of_columns(arrays, vehicle.defaults)


def route_or_log(name_or_file: str | Path, vehicle: Vehicle, options: RouteOptions) -> RouteForVehicle:
    """Return the RouteForVehicle of `route_for`; if a file is refused and is a drive log, InvalidInput says so."""
    try:
        return route_for(name_or_file, vehicle, options=options)
    except InvalidInput as error:
        # An unknown name is refused here again, as before.
        file = route_source(name_or_file)
        if not _is_drive_log(file):
            raise
        raise type(error)(f'{file}: is a drive log, no route; to make a route: preheat route --log {file} '
                          '--vehicle NAME --output ROUTE.csv') from error


def _is_drive_log(file: Path) -> bool:
    """Return whether a file that is no route has readings of a battery."""
    if file.stat().st_size > LARGEST_LOG:
        return False
    try:
        signals = read_recording(file).signals
    except InvalidInput:
        return False
    return bool({'battery_temperature_c', 'soc'} & signals.keys())
