# SPDX-License-Identifier: Apache-2.0
"""A drive with disturbances and the expectations of the planner, from a YAML file."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np

from bev_preheat.charging.stop import Charger, ChargingProspect, USUAL_DEPARTURE_SOC
from bev_preheat.control.settings import settings_of
from bev_preheat.errors import InvalidInput, located
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml, load_schema, problems_by
from bev_preheat.files.input_files import find_configuration
from bev_preheat.planning.planner import check_method
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import route_for
from bev_preheat.route.for_vehicle import RouteForVehicle
from bev_preheat.route.segments import Route
from bev_preheat.route.sources.journey import BESIDE_ROUTE, RouteOptions
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections, Mismatch
from bev_preheat.simulation.phases import Charge, DrivePhase, Park, Phase
from bev_preheat.simulation.sensors import OtherBattery, PositionReports, Sensors, Span, Spike
from bev_preheat.simulation.traffic import ClockJump, Event, Kind
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.loading import heat_path_problems

SCHEMA = Path(__file__).with_name('scenario_schema.yaml')
# Keys of the section `drive` that stay there in a chain, and sections that belong to a drive.
OF_A_CAR = 'vehicle', 'initial_battery_temperature_c', 'initial_soc'
OF_A_DRIVE = 'traffic', 'route_progress'


@dataclass(frozen=True)
class Expectations:
    """Expectations of a scenario; see scenario_schema.yaml. None and empty: no expectation."""

    arrival_error_k: tuple[float, float] | None = None
    most_switch_ons: int | None = None
    statuses: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    off_during: tuple[Span, ...] = ()
    heats_during: tuple[Span, ...] = ()
    heater: str | None = None
    never_heater_verdict: bool = False
    not_heated_above_c: float | None = None
    # (regime, from, until [s])
    regime_during: tuple[tuple[str, float, float], ...] = ()
    never_regimes: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()
    named_within_s: float | None = None
    no_signals: bool = False


@dataclass(frozen=True)
class Scenario:
    """
    A drive, or a chain that begins with it, its faults, and the expectations.

    `phases` begin with a drive; `phase_expectations` are the Expectations of each phase of a chain. `planner`
    holds parameters of the node `planner` by name, `vehicle_name` is the vehicle's name or path in the file.
    `files` are the paths of all files that were read; `warnings` are sentences on routes made for another vehicle.
    """

    name: str
    description: str
    vehicle_name: str
    vehicle: Vehicle
    phases: tuple[Phase, ...]
    state: BatteryState
    seed: int
    imperfections: Imperfections
    expectations: Expectations
    planner: dict[str, FileData] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    warnings: tuple[str, ...] = ()
    phase_expectations: tuple[Expectations | None, ...] = ()

    @property
    def drives(self) -> list[DrivePhase]:
        """All drives, in order."""
        return [phase for phase in self.phases if isinstance(phase, DrivePhase)]

    @property
    def first(self) -> DrivePhase:
        """The first drive."""
        return self.drives[0]

    def car(self) -> ImperfectCar:
        """Return the ImperfectCar at the start."""
        return ImperfectCar(self.vehicle, self.first, self.state, self.imperfections, self.seed, self.name,
                            self.phases[1:])


def load_scenario(name_or_file: str | Path) -> Scenario:
    """Return the Scenario of a name (config/scenarios) or a YAML file; raises InvalidInput."""
    path = find_configuration('scenarios', name_or_file, '.yaml')
    contents = load_checked_yaml(path, SCHEMA)
    with located(path):
        _refuse_falling(contents)
        return _scenario(path, contents)


def _scenario(path: Path, contents: dict[str, FileData]) -> Scenario:
    node = contents['drive']
    name: str = node['vehicle']
    vehicle_name = str(path.parent / name) if '/' in name or name.endswith('.yaml') else name
    reader = _PhaseReader(load_vehicle(vehicle_name), path.parent)
    state = BatteryState(float(node['initial_battery_temperature_c']), float(node['initial_soc']))
    phases = reader.chain(contents) if 'chain' in contents else [reader.drive({
        **node, **{key: contents[key] for key in OF_A_DRIVE if key in contents}}, '')]
    scenario = Scenario(
        name=contents['name'], description=contents['description'], vehicle_name=vehicle_name,
        vehicle=reader.vehicle, phases=tuple(phases), state=state, seed=contents.get('seed', 0),
        imperfections=Imperfections(
            mismatch=Mismatch(**_with_floats(Mismatch, contents.get('mismatch', {}))),
            heat_path=_heat_path(contents),
            sensors=_sensors(contents.get('sensors', {})),
            heater_faults=tuple(HeaterFault(**node) for node in contents.get('heater_faults', ())),
            clock_jumps=tuple(ClockJump(**node) for node in contents.get('clock_jumps', ()))),
        expectations=_expectations(contents['expect'], 'expect'),
        planner=_planner(contents.get('planner', {})),
        phase_expectations=tuple(
            _expectations(item['expect'], f'chain[{at}].expect') if 'expect' in item else None
            for at, item in enumerate(contents.get('chain', ()))),
        files=(path, vehicle_file(vehicle_name), *(each.file for each in reader.routes)),
        warnings=tuple(dict.fromkeys(each.warning for each in reader.routes if each.warning)))
    check_situation(scenario.vehicle, scenario.first.route, state)
    _check_sources(scenario.vehicle, scenario.imperfections)
    return scenario


def check_imperfections(vehicle: Vehicle, imperfections: Imperfections) -> None:
    """Raise InvalidInput, with field, value and range, if a scenario file may not have these deviations."""
    given = {name: _given(getattr(imperfections, name)) for name in ('mismatch', 'sensors', 'heater_faults')}
    problems = problems_by({**load_schema(SCHEMA), 'required': []}, given)
    if problems:
        raise InvalidInput(problems)
    _refuse_falling(given)
    _check_sources(vehicle, imperfections)


def _refuse_falling(node: FileData, where: str = '') -> None:
    """Raise InvalidInput for spans, and expected errors, whose end is before their begin."""
    is_error = where.endswith('arrival_error_k')
    begin, end = (node if is_error else (node['from_s'], node['until_s'])
                  if isinstance(node, dict) and {'from_s', 'until_s'} <= node.keys() else (0.0, 1.0))
    if not (begin <= end if is_error else begin < end):
        raise InvalidInput(f'{where}: [{begin:g}, {end:g}] must rise')
    if isinstance(node, dict):
        for key, item in node.items():
            _refuse_falling(item, f'{where}.{key}'.lstrip('.'))
    elif isinstance(node, list):
        for at, item in enumerate(node):
            _refuse_falling(item, f'{where}[{at}]')


def _given(value: Any) -> FileData:
    """Return a value of a program in the form of a file, without its defaults."""
    if is_dataclass(value):
        return {each.name: _given(own) for each in fields(value)
                if (own := getattr(value, each.name)) is not None and own != each.default}
    if isinstance(value, tuple | list):
        return list(map(_given, value))
    return value.item() if isinstance(value, np.generic) else value


def _check_sources(vehicle: Vehicle, imperfections: Imperfections) -> None:
    for fault in imperfections.heater_faults:
        vehicle.most_w(fault.source)


class _PhaseReader:
    """Reads the phases of a scenario; `routes` are all routes read."""

    def __init__(self, vehicle: Vehicle, folder: Path) -> None:
        self.vehicle, self._folder = vehicle, folder
        self.routes: list[RouteForVehicle] = []

    def chain(self, contents: dict[str, FileData]) -> list[Phase]:
        """Return the phases of a chain."""
        outside = [key for key in contents['drive'] if key not in OF_A_CAR] + [
            key for key in OF_A_DRIVE if key in contents]
        if outside:
            raise InvalidInput(f'{", ".join(outside)}: in a chain this belongs to a drive')
        phases: list[Phase] = []
        for at, item in enumerate(contents['chain']):
            where, kinds = f'chain[{at}]', [key for key in item if key != 'expect']
            if len(kinds) != 1 or (at == 0 and kinds != ['drive']):
                raise InvalidInput(f'{where}: has {", ".join(kinds) or "nothing"}; it must have '
                                   + ('a drive' if at == 0 else 'a drive, a charge or a park'))
            node = item[kinds[0]]
            if kinds == ['drive']:
                if node.get('announced_s') and not (phases and isinstance(phases[-1], Park)):
                    raise InvalidInput(f'{where}.drive.announced_s: only for a drive after a park')
                phases.append(self.drive(node, f'{where}.drive.'))
            else:
                phases.append((Charge if kinds == ['charge'] else Park)(**node))
        return phases

    def drive(self, node: dict[str, FileData], where: str) -> DrivePhase:
        """Return the DrivePhase of a node with its `traffic` and `route_progress`; `where` prefixes its keys."""
        vehicle = self.vehicle
        if 'route' not in node:
            raise InvalidInput('drive: missing route')
        route = self._route(node)
        events = tuple(
            _event(f'{where}traffic[{at}]', each, self._route(each) if 'route' in each else None)
            for at, each in enumerate(node.get('traffic', ())))
        if 'ends_after_s' in node:
            if node['ends_after_s'] > route.total_duration_s:
                raise InvalidInput(f'{where or "drive."}ends_after_s: {node["ends_after_s"]:g} s is beyond the '
                                   f'end of the route, {route.total_duration_s:g} s')
            route = route.before(float(node['ends_after_s']))
        default_c = vehicle.defaults.target_battery_temperature_c
        target_c = node.get('target_battery_temperature_c', default_c)
        goal = Goal(default_c if target_c is None else float(target_c),
                    float(node.get('minimum_arrival_soc', 0.0)), node.get('charging_planned', True),
                    maximum_arrival_temperature_c=float(node.get('maximum_arrival_temperature_c', math.inf)))
        check_situation(vehicle, route, goal=goal)
        if target_c is None:
            goal = replace(goal, target_temperature_c=math.nan)
        return DrivePhase(route, goal, float(node.get('standing_time_s', 0.0)), events,
                          _position(node, where), float(node.get('announced_s', 0.0)),
                          node.get('starts_over', False), _charger(node, where), _prospect(node))

    def _route(self, node: dict[str, FileData]) -> Route:
        loaded = route_for(node['route'], self.vehicle, self._folder,
                           RouteOptions(node.get('ambient_temperature_c'), offers=BESIDE_ROUTE))
        if loaded.stops:
            raise InvalidInput(f'{loaded.file}: has {len(loaded.stops)} charging stops; a drive of a scenario has '
                               'none on the way')
        self.routes.append(loaded)
        return loaded.route


def _planner(parameters: dict[str, FileData]) -> dict[str, FileData]:
    with located('planner'):
        check_method(settings_of(parameters).method)
    return parameters


def _spans(node: dict[str, FileData], key: str, where: str) -> tuple[Span, ...]:
    spans = tuple(map(tuple, node.get(key, ())))
    for at, (from_s, until_s) in enumerate(spans):
        if not from_s < until_s:
            raise InvalidInput(f'{where}.{key}[{at}]: [{from_s:g}, {until_s:g}] must rise')
    return spans


def _heat_path(contents: dict[str, FileData]) -> HeatPath | None:
    """Return the HeatPath in a scenario's contents; None: that of the vehicle file."""
    if 'heat_path' not in contents:
        return None
    path = HeatPath(**_with_floats(HeatPath, contents['heat_path']))
    problems = list(heat_path_problems(path))
    if problems:
        raise InvalidInput(problems)
    return path


def _charger(node: dict[str, FileData], where: str) -> Charger | None:
    """Return the Charger at the end of a drive; None: the trip planner does not know it."""
    if 'charger_power_w' not in node:
        if 'charging_departure_soc' in node:
            raise InvalidInput(f'{where or "drive."}charging_departure_soc: only with charger_power_w')
        return None
    return Charger(float(node['charger_power_w']), float(node.get('charging_departure_soc', USUAL_DEPARTURE_SOC)))


def _prospect(node: dict[str, FileData]) -> ChargingProspect:
    """Return the ChargingProspect at the end of a drive."""
    return ChargingProspect(*(float(node.get(key, unset)) for key, unset in (
        ('charging_probability', 1.0), ('arrival_time_deviation_s', 0.0),
        ('charging_known_before_arrival_s', 0.0))))


def _position(contents: dict[str, FileData], where: str) -> PositionReports | None:
    """Return the car's position reports; None: it sends none."""
    node = contents.get('route_progress')
    return None if node is None else PositionReports(
        **{**_with_floats(PositionReports, node),
           'drop_outs': _spans(node, 'drop_outs', f'{where}route_progress')})


def _with_floats(kind: type, node: dict[str, FileData]) -> dict[str, FileData]:
    """Return a dataclass's values with floats, where YAML reads 20 as an integer, which ROS messages refuse."""
    types = {each.name: str(each.type) for each in fields(kind)}
    return {key: float(value) if type(value) is int and 'float' in types.get(key, '') else value
            for key, value in node.items()}


def _sensors(node: dict[str, FileData]) -> Sensors:
    spans = {key: _spans(node, key, 'sensors') for key in ('drop_outs', 'stuck', 'invalid')}
    other = OtherBattery(**_with_floats(OtherBattery, node['other'])) if 'other' in node else None
    return Sensors(**{**_with_floats(Sensors, node), **spans, 'other': other,
                      'spikes': tuple(Spike(**_with_floats(Spike, each)) for each in node.get('spikes', ()))})


# Required keys of each kind of event, besides its instant; other keys are refused.
OWN_KEYS: dict[Kind, set[str]] = {
    Kind.STOP: {'duration_s'}, Kind.OTHER_PACE: {'duration_s', 'factor'},
    Kind.DETOUR: {'route'}, Kind.CANCEL_CHARGING: set(), Kind.CHARGING_PROBABILITY: {'probability'},
    Kind.ARRIVE_EARLY: set()}


def _event(where: str, node: dict[str, FileData], detour: Route | None) -> Event:
    kind = Kind(node['event'])
    own = {key: value for key, value in node.items()
           if key not in ('event', 'at_s', 'route_plan_after_s')}
    if set(own) != OWN_KEYS[kind]:
        raise InvalidInput(f'{where}: {kind.value} has '
                           f'{", ".join(sorted(own)) or "nothing"} besides its instant; it must '
                           f'have {", ".join(sorted(OWN_KEYS[kind])) or "nothing"}')
    if detour is not None:
        own['route'] = detour
    return Event(kind, float(node['at_s']), node.get('route_plan_after_s', 0.0), **_with_floats(Event, own))


def _expectations(node: dict[str, FileData], where: str) -> Expectations:
    known = {status.name for status in Status}
    for key in ('statuses', 'never'):
        for at, name in enumerate(node.get(key, ())):
            if name not in known:
                raise InvalidInput(f'{where}.{key}[{at}]: {name!r} is not one of '
                                   f'{", ".join(sorted(known))}')
    values: dict[str, FileData] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in node.items()}
    for key in ('off_during', 'heats_during'):
        values[key] = _spans(node, key, where)
    values['regime_during'] = tuple(
        (span['regime'], span['from_s'], span['until_s']) for span in node.get('regime_during', ()))
    return Expectations(**values)
