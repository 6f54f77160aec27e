# SPDX-License-Identifier: Apache-2.0
"""
Published charging times and battery temperatures of cars against computed ones (published.yaml).

Each time is computed from the data sheet alone (the curve of the car's class), with the published curve, with the
published time from 10 to 80 %, and with the car's shipped file, if it has one. Temperatures are those of heating
runs of owners, and rises in charging sessions; the cars are described from their data sheets alone.
"""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.charging.session import charge, Session
from bev_preheat.charging.stop import CHARGER_RANGE_W, ChargingStop
from bev_preheat.errors import InvalidInput
from bev_preheat.files.checked_yaml import load_checked_yaml
from bev_preheat.numerics.factors import S_PER_MIN, W_PER_KW
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.charging import session_charging
from bev_preheat.vehicle.charging_curve import charging_map, checked_curve, FIT_RANGE, PERCENT
from bev_preheat.vehicle.chemistry import load_chemistry
from bev_preheat.vehicle.data_sheet import DataSheet
from bev_preheat.vehicle.data_sheet_import import describe_car, warm_curve
from bev_preheat.vehicle.loading import vehicle_of_text
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.writing import vehicle_text

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.vehicle import Vehicle
    from bev_preheat.vehicle.data_sheet_import import Entry

USUAL_WARM_C = 25.0
AIR_C = 20.0
PUBLISHED_SPAN = (0.1, 0.8)
# Factor of a published curve beyond which curve and time do not belong to one car.
CURVE_FACTOR_RANGE = (0.8, 1.25)
# The fit's range is halved until a time is met far below the digits of data sheets.
TIME_HALVINGS = 20


def warm_session(vehicle: Vehicle, span: tuple[float, float] = PUBLISHED_SPAN,
                 battery_c: float = USUAL_WARM_C) -> Session:
    """
    Return the Session of a Vehicle between two states of charge (0 ... 1) at an unlimited charger.

    `battery_c` is the battery temperature at its start [deg C]; the air has AIR_C, or `battery_c` if it is colder.
    The cabin is not heated, and a car whose file does not say whether it heats its battery does not. States of
    charge outside the vehicle's soc_range are cut off.
    """
    low, high = vehicle.battery.soc_range
    start, end = (min(max(soc, low), high) for soc in span)
    car = replace(vehicle, charging=session_charging(vehicle))
    stop = ChargingStop(CHARGER_RANGE_W[1], end, min(AIR_C, battery_c), 0.0, vehicle.defaults.auxiliary_power_w)
    return charge(car, stop, BatteryState(battery_c, start))


def curve_fit(sheet: DataSheet) -> float:
    """
    Return the `curve_fit` of `describe_car` with which a session takes the published time of a DataSheet.

    1 without a published time. Raises InvalidInput if the data sheet is implausible, or if no fit gives the time.
    """
    chemistry = load_chemistry(sheet.chemistry) if sheet.charging_time_10_80_min is not None else None
    entries = describe_car(sheet)
    if chemistry is None or sheet.charging_time_10_80_min is None:
        return 1.0
    vehicle = vehicle_of_text(vehicle_text(sheet.name, entries, ''), sheet.name)
    wanted_s = S_PER_MIN * sheet.charging_time_10_80_min

    def time_s(fit: float) -> float:
        table = charging_map(warm_curve(sheet, fit), chemistry, sheet.charging_power_kw, sheet.charging_limit)
        charging = session_charging(vehicle)
        return warm_session(replace(vehicle, charging=replace(
            charging, power_limit=table))).charging_time_s

    slow, fast = CURVE_FACTOR_RANGE if sheet.charging_curve is not None else FIT_RANGE
    shortest_s, longest_s = time_s(fast), time_s(slow)
    if not shortest_s <= wanted_s <= longest_s:
        raise InvalidInput(_unfit(sheet, time_s(1.0), shortest_s, longest_s))
    return math.exp(halve(
        math.log(fast), math.log(slow), lambda fit: time_s(math.exp(fit)) <= wanted_s, TIME_HALVINGS))


def _unfit(sheet: DataSheet, usual_s: float, shortest_s: float, longest_s: float) -> str:
    low, high = (f'{seconds / S_PER_MIN:.1f}' for seconds in (shortest_s, longest_s))
    start = f'--charging-time-10-80-min: {sheet.charging_time_10_80_min:g} min'
    if sheet.charging_curve is not None:
        return (f'{start} does not fit --charging-curve, which takes {duration_text(usual_s)}; {low} ... {high} '
                'min are allowed. Do both belong to one car?')
    return (f'{start} does not fit --charging-power-kw {sheet.charging_power_kw:g} kW; it must be {low} ... '
            f'{high} min. Give the maximum power and the time of one car')


def describe_timed_car(sheet: DataSheet) -> dict[str, Entry]:
    """Return the entries of a vehicle file as `describe_car`, with the curve fitted to the published time."""
    return describe_car(sheet, curve_fit(sheet))


FIGURES = Path(__file__).with_name('published.yaml')
SCHEMA = Path(__file__).with_name('published_schema.yaml')


@dataclass(frozen=True)
class ComputedTime:
    """
    A published charging time and its computed counterparts [min], between two states of charge (0 ... 1).

    None if the curve, the time from 10 to 80 % or a shipped file is missing. `fitted_min` of the span from 10 to
    80 % is the published time by construction. `remark` says why times may differ, or is None.
    """

    car: str
    start_soc: float
    end_soc: float
    published_min: float
    source: str
    data_sheet_min: float
    curve_min: float | None
    fitted_min: float | None
    shipped_min: float | None
    remark: str | None = None

    @property
    def is_fitted(self) -> bool:
        """Whether the curve was fitted to this very time."""
        return self.fitted_min is not None and (self.start_soc, self.end_soc) == PUBLISHED_SPAN

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible data."""
        return asdict(self)


def computed_times(path: Path = FIGURES) -> list[ComputedTime]:
    """Return the ComputedTime of each published time of a file; raise InvalidInput naming file and car."""
    found = []
    for node in load_checked_yaml(path, SCHEMA)['cars']:
        with naming(path, node):
            found += _times_of(node)
    return found


@contextmanager
def naming(path: Path, node: dict[str, FileData]) -> Iterator[None]:
    """Add file and car to the problems of an InvalidInput."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput([f'{path}: {node["name"]}: {problem}' for problem in error.problems]) from error


def _times_of(node: dict[str, FileData]) -> list[ComputedTime]:
    sheet = DataSheet(node['name'], **node['data_sheet'])
    times = [(time['from'] / PERCENT, time['to'] / PERCENT, float(time['minutes']), time['source'],
              time.get('remark')) for time in node.get('times', ())]
    for start, end, *_ in times:
        if not start < end:
            raise InvalidInput(f'times: from {PERCENT * start:g} to {PERCENT * end:g} % must rise')
    cars: list[Vehicle | None] = [described(sheet)]
    curve = node.get('curve')
    cars.append(None if curve is None else described(replace(sheet, charging_curve=checked_curve(
        [tuple(point) for point in curve['points']], curve['temperature_c'], curve['source']))))
    usual = [minutes for start, end, minutes, *_ in times if (start, end) == PUBLISHED_SPAN]
    cars.append(described(replace(sheet, charging_time_10_80_min=usual[0])) if usual else None)
    cars.append(load_vehicle(node['vehicle']) if 'vehicle' in node else None)

    def minutes_of(car: Vehicle | None, span: tuple[float, float]) -> float | None:
        return None if car is None else warm_session(car, span).charging_time_s / S_PER_MIN

    found = []
    for start, end, minutes, source, remark in times:
        sheet_min, curve_min, fitted_min, shipped_min = (minutes_of(car, (start, end)) for car in cars)
        assert sheet_min is not None
        found.append(ComputedTime(sheet.name, start, end, minutes, source, sheet_min, curve_min, fitted_min,
                                  shipped_min, remark))
    return found


def described(sheet: DataSheet) -> Vehicle:
    """Return the Vehicle of a DataSheet as `preheat vehicle new` makes it."""
    return vehicle_of_text(vehicle_text(sheet.name, describe_timed_car(sheet), ''), sheet.name)


MPS_PER_KMH = 1.0 / 3.6
# State of charge of a heating run; owners do not give it, and it hardly matters.
RUN_SOC = 0.5


@dataclass(frozen=True)
class ComputedWarmth:
    """
    A published battery temperature [deg C] and its computed counterpart, from a common start [deg C].

    `minutes` are those of a heating run or, computed, of a session between two states of charge, `start_soc` and
    `end_soc` (0 ... 1; NaN for a heating run); `end_power_kw` is the computed charging power at its end.
    `not_comparable` says why the computed rise cannot be compared with the published one, or is None.
    """

    car: str
    start_c: float
    published_c: float
    computed_c: float
    minutes: float
    source: str
    start_soc: float | None = None
    end_soc: float | None = None
    end_power_kw: float | None = None
    not_comparable: str | None = None

    @property
    def deviation(self) -> float:
        """Computed over published rise, less 1."""
        return (self.computed_c - self.start_c) / (self.published_c - self.start_c) - 1.0

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible data."""
        return {**asdict(self), 'deviation': self.deviation}


def computed_warmth(path: Path = FIGURES) -> tuple[list[ComputedWarmth], list[ComputedWarmth]]:
    """
    Return the ComputedWarmth of each heating run of a file, and of each session.

    Raises InvalidInput naming file and car.
    """
    contents = load_checked_yaml(path, SCHEMA)
    drive = contents['heating_drive']
    runs, sessions = [], []
    for node in contents['cars']:
        if 'heating_runs' in node or 'sessions' in node:
            with naming(path, node):
                vehicle = described(DataSheet(node['name'], **node['data_sheet']))
                runs += [_run(vehicle, run, drive) for run in node.get('heating_runs', ())]
                sessions += [_session(vehicle, session) for session in node.get('sessions', ())]
    return runs, sessions


def _check_rise(start_c: float, end_c: float) -> None:
    if not start_c < end_c:
        raise InvalidInput(f'from {start_c:g} to {end_c:g} degC must rise')


def _run(vehicle: Vehicle, node: dict[str, FileData], drive: dict[str, FileData]) -> ComputedWarmth:
    """Return the ComputedWarmth of a drive with the whole power of the heater for the battery."""
    start_c, minutes = float(node['from_c']), float(node['minutes'])
    _check_rise(start_c, node['to_c'])
    trip = make_trip(vehicle, make_route({
        'duration_s': [S_PER_MIN] * max(1, round(minutes)), 'speed_mps': [drive['speed_kmh'] * MPS_PER_KMH],
        'propulsion_power_w': [W_PER_KW * drive['power_kw']], 'ambient_temperature_c': [node['air_c']],
        'cabin_heating_power_w': [0.0], 'auxiliary_power_w': [vehicle.defaults.auxiliary_power_w]}, None))
    _, temperature_c = run_forward(trip, make_runge_kutta_4, RUN_SOC, start_c,
                                   np.full(len(trip.route), vehicle.hvch.maximum_power_w))
    return ComputedWarmth(vehicle.name, start_c, float(node['to_c']), float(temperature_c[-1]), minutes,
                          node['source'])


def _session(vehicle: Vehicle, node: dict[str, FileData]) -> ComputedWarmth:
    """Return the ComputedWarmth of a session in which the car does not heat its battery."""
    start_c, start, end = float(node['start_c']), node['from'] / PERCENT, node['to'] / PERCENT
    _check_rise(start_c, node['end_c'])
    if not start < end:
        raise InvalidInput(f'sessions: from {node["from"]:g} to {node["to"]:g} % must rise')
    car = replace(vehicle, charging=replace(session_charging(vehicle), battery_heating=False))
    session = charge(car, ChargingStop(W_PER_KW * node['charger_kw'], end, float(node['air_c']), 0.0,
                                       vehicle.defaults.auxiliary_power_w), BatteryState(start_c, start))
    return ComputedWarmth(
        vehicle.name, start_c, float(node['end_c']), float(session.battery_temperature_c[-1]),
        session.charging_time_s / S_PER_MIN, node['source'], start, end,
        float(session.charging_power_w[-1]) / W_PER_KW, node.get('not_comparable'))
