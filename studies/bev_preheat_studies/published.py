# SPDX-License-Identifier: Apache-2.0
"""
Published charging times and battery temperatures of cars against computed ones; cars and sources: published.yaml.

Each time is computed from the data sheet alone (the curve of the car's class), with the published curve, with the
published time from 10 to 80 %, and with the car's shipped file, if it has one. Temperatures are those of heating
runs of owners and rises in charging sessions, of cars described from their data sheets alone.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bev_preheat.charging.published_time import describe_timed_car, PUBLISHED_SPAN, warm_session
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.commands.output import add_json_argument, json_output, write_json
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_records, result_console, ResultConsole
from bev_preheat.errors import InvalidInput, located
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.output_files import check_outputs
from bev_preheat.numerics import S_PER_MIN, W_PER_KW
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle, Vehicle
from bev_preheat.vehicle.charging import session_charging
from bev_preheat.vehicle.charging_curve import checked_curve, PERCENT
from bev_preheat.vehicle.data_sheet import DataSheet
from bev_preheat.vehicle.loading import vehicle_of_text
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.writing import vehicle_text

FIGURES = Path(__file__).with_name('published.yaml')
SCHEMA = Path(__file__).with_name('published_schema.yaml')
MPS_PER_KMH = 1.0 / 3.6
# State of charge of a heating run; owners do not give it, and it hardly matters.
RUN_SOC = 0.5


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


def computed_times(path: Path = FIGURES) -> list[ComputedTime]:
    """Return the ComputedTime of each published time of a file; raise InvalidInput naming file and car."""
    found = []
    for node in load_checked_yaml(path, SCHEMA)['cars']:
        with located(f'{path}: {node["name"]}'):
            found += _times_of(node)
    return found


def _times_of(node: dict[str, FileData]) -> list[ComputedTime]:
    sheet = DataSheet(node['name'], **node['data_sheet'])
    times = [(time['from'] / PERCENT, time['to'] / PERCENT, float(time['minutes']), time['source'],
              time.get('remark')) for time in node.get('times', ())]
    for start, end, *_ in times:
        _check_rise(PERCENT * start, PERCENT * end, '%')
    cars: list[Vehicle | None] = [described(sheet)]
    curve = node.get('curve')
    cars.append(None if curve is None else described(replace(sheet, charging_curves=(checked_curve(
        [tuple(point) for point in curve['points']], curve['temperature_c'], curve['source']),))))
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
    """Return the ComputedWarmth of heating runs and of sessions; raise InvalidInput naming file and car."""
    contents = load_checked_yaml(path, SCHEMA)
    drive = contents['heating_drive']
    runs, sessions = [], []
    for node in contents['cars']:
        if 'heating_runs' in node or 'sessions' in node:
            with located(f'{path}: {node["name"]}'):
                vehicle = described(DataSheet(node['name'], **node['data_sheet']))
                runs += [_run(vehicle, run, drive) for run in node.get('heating_runs', ())]
                sessions += [_session(vehicle, session) for session in node.get('sessions', ())]
    return runs, sessions


def _check_rise(start: float, end: float, unit: str = 'degC') -> None:
    if not start < end:
        raise InvalidInput(f'from {start:g} to {end:g} {unit} must rise')


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
    _check_rise(node['from'], node['to'], '%')
    car = replace(vehicle, charging=replace(session_charging(vehicle), battery_heating=False))
    session = charge(car, ChargingStop(W_PER_KW * node['charger_kw'], end, float(node['air_c']), 0.0,
                                       vehicle.defaults.auxiliary_power_w), BatteryState(start_c, start))
    return ComputedWarmth(
        vehicle.name, start_c, float(node['end_c']), float(session.battery_temperature_c[-1]),
        session.charging_time_s / S_PER_MIN, node['source'], start, end,
        float(session.charging_power_w[-1]) / W_PER_KW, node.get('not_comparable'))


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'published', help='published charging times and battery temperatures of cars against computed ones',
        description='Compare published figures of cars with those computed from their data sheets. Charging '
                    'times: from the data sheet alone, with the published curve, with the published time from 10 '
                    'to 80 %%, with the shipped file. Battery temperatures: heating runs and charging sessions.')
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Print the tables, write the requested file, and return the exit status."""
    check_outputs([json_output(arguments.json)])
    times = computed_times()
    runs, sessions = computed_warmth()
    if arguments.json:
        write_json(arguments.json, {
            'times': [asdict(time) for time in times],
            'heating_runs': [run.as_dictionary() for run in runs],
            'sessions': [session.as_dictionary() for session in sessions]})
    console = result_console(arguments.json)
    _print_times(console, times)
    print_records(console, 'Battery heated by the car, in degC', (
        'car', 'from', 'min', 'published', 'computed', 'rise'), [
            (run.car, f'{run.start_c:g}', f'{run.minutes:g}', f'{run.published_c:g}', f'{run.computed_c:.1f}',
             f'{100.0 * run.deviation:+.0f} %') for run in runs], ('left', *('right',) * 5))
    print_records(console, 'Battery warmed by a charging session, in degC', (
        'car', 'span', 'from', 'published', 'computed', 'rise', 'kW at its end'), [
            (session.car, _span(session), f'{session.start_c:g}', f'{session.published_c:g}',
             f'{session.computed_c:.1f}',
             '' if session.not_comparable else f'{100.0 * session.deviation:+.0f} %',
             f'{session.end_power_kw:.0f}') for session in sessions], ('left', *('right',) * 6))
    for session in sessions:
        if session.not_comparable:
            console.say(f'{session.car}, {_span(session)}: not comparable: {session.not_comparable}.')
    return 0


def _print_times(console: ResultConsole, times: Sequence[ComputedTime]) -> None:
    rows = []
    for time in times:
        def text(minutes: float | None, published_min: float = time.published_min) -> str:
            return '' if minutes is None else f'{minutes:.1f} {100.0 * (minutes / published_min - 1.0):+.0f} %'

        rows.append((time.car, _span(time), f'{time.published_min:.1f}', text(time.data_sheet_min),
                     text(time.curve_min),
                     'given' if time.is_fitted else text(time.fitted_min), text(time.shipped_min)))
    print_records(console, 'Charging times in min', (
        'car', 'span', 'published', 'data sheet', 'curve', 'time', 'shipped'), rows, ('left', *('right',) * 6))
    for time in times:
        if time.remark is not None:
            console.say(f'{time.car}, {_span(time)}: {time.remark}.')


def _span(figure: ComputedTime | ComputedWarmth) -> str:
    assert figure.start_soc is not None and figure.end_soc is not None
    return f'{100 * figure.start_soc:g} ... {100 * figure.end_soc:g} %'
