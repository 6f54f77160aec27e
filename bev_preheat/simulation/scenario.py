# SPDX-License-Identifier: Apache-2.0
"""A drive in which something is wrong, and what is expected of the planner: a YAML file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.configuration import find_configuration
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import route_for
from bev_preheat.route.segments import Route
from bev_preheat.simulation.heater_faults import HeaterFault
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.simulation.position import PositionReports
from bev_preheat.simulation.sensors import Sensors, Span
from bev_preheat.simulation.traffic import ClockJump, Event, Kind
from bev_preheat.supervision.settings import FIELD_OF_PARAMETER
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat.vehicle.loading import heat_path_problems

if TYPE_CHECKING:
    from bev_preheat.route.for_vehicle import RouteForVehicle

SCHEMA = Path(__file__).with_name('scenario_schema.yaml')


@dataclass(frozen=True)
class Expectations:
    """What a scenario expects; see scenario_schema.yaml. None and empty: nothing."""

    arrival_error_k: tuple[float, float] | None = None
    most_switch_ons: int | None = None
    statuses: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    off_during: tuple[Span, ...] = ()
    heats_during: tuple[Span, ...] = ()
    heater: str | None = None


@dataclass(frozen=True)
class Scenario:
    """
    A drive, what is wrong with it, and what is expected.

    The car stood for `standing_time_s` [s] before (0: not known). `planner` holds parameters of the
    node `planner` by name, `vehicle_name` what the file calls the
    vehicle: a name, or a file's path. `files` are the paths of all files that were read;
    `warnings` are sentences on routes that were made for another vehicle.
    """

    name: str
    description: str
    vehicle_name: str
    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    seed: int
    imperfections: Imperfections
    expectations: Expectations
    planner: dict[str, FileData] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    warnings: tuple[str, ...] = ()
    standing_time_s: float = 0.0

    def car(self) -> ImperfectCar:
        """Return the ImperfectCar at its start."""
        return ImperfectCar(self.vehicle, self.route, self.state, self.goal, self.imperfections,
                            self.seed, self.name, self.standing_time_s)


def load_scenario(name_or_file: str | Path) -> Scenario:
    """
    Return the Scenario of a name (a file in config/scenarios) or of a YAML file.

    Raises InvalidInput naming file, key, value and what is allowed.
    """
    path = find_configuration('scenarios', name_or_file, '.yaml')
    contents = load_checked_yaml(path, SCHEMA)
    try:
        return _scenario(path, contents)
    except InvalidInput as error:
        raise InvalidInput([f'{path}: {problem}' for problem in error.problems]) from error


def _scenario(path: Path, contents: dict[str, FileData]) -> Scenario:
    drive, folder = contents['drive'], path.parent
    vehicle_name = _seen_from(folder, drive['vehicle'])
    vehicle = load_vehicle(vehicle_name)
    driven = route_for(drive['route'], vehicle, folder)
    detours = [route_for(node['route'], vehicle, folder) if 'route' in node else None
               for node in contents.get('traffic', ())]
    routes = [driven, *filter(None, detours)]
    route = driven.route
    if 'ends_after_s' in drive:
        if drive['ends_after_s'] > route.total_duration_s:
            raise InvalidInput(f'drive.ends_after_s: {drive["ends_after_s"]:g} s is beyond the '
                               f'end of the route, {route.total_duration_s:g} s')
        route = route.before(float(drive['ends_after_s']))
    state = BatteryState(float(drive['initial_battery_temperature_c']),
                         float(drive['initial_soc']))
    goal = Goal(
        float(drive.get('target_battery_temperature_c',
                        vehicle.defaults.target_battery_temperature_c)),
        float(drive.get('minimum_arrival_soc', 0.0)), drive.get('charging_planned', True))
    check_situation(vehicle, route, state, goal)
    return Scenario(
        name=contents['name'], description=contents['description'], vehicle_name=vehicle_name,
        vehicle=vehicle, route=route, state=state, goal=goal, seed=contents.get('seed', 0),
        imperfections=Imperfections(
            mismatch=Mismatch(**contents.get('mismatch', {})),
            heat_path=_heat_path(contents),
            position=_position(contents),
            sensors=_sensors(contents.get('sensors', {})),
            heater_faults=tuple(HeaterFault(**node) for node in contents.get('heater_faults', ())),
            events=tuple(_event(at, node, detour) for at, (node, detour) in enumerate(
                zip(contents.get('traffic', ()), detours))),
            clock_jumps=tuple(ClockJump(**node) for node in contents.get('clock_jumps', ()))),
        expectations=_expectations(contents['expect']),
        planner=_planner(contents.get('planner', {})),
        standing_time_s=float(drive.get('standing_time_s', 0.0)),
        files=(path, vehicle_file(vehicle_name), *(each.file for each in routes)),
        warnings=tuple(dict.fromkeys(each.warning for each in routes if each.warning)))


def _planner(parameters: dict[str, FileData]) -> dict[str, FileData]:
    for name in parameters:
        if name not in FIELD_OF_PARAMETER:
            raise InvalidInput(f"planner: {name!r} is none of the planner's parameters that a "
                               f'scenario may set: {", ".join(FIELD_OF_PARAMETER)}')
    return parameters


def _seen_from(folder: Path, name_or_file: str) -> str:
    is_file = '/' in name_or_file or name_or_file.endswith('.yaml')
    return str(folder / name_or_file) if is_file else name_or_file


def _spans(node: dict[str, FileData], key: str, where: str) -> tuple[Span, ...]:
    spans = tuple(map(tuple, node.get(key, ())))
    for at, (from_s, until_s) in enumerate(spans):
        if not from_s < until_s:
            raise InvalidInput(f'{where}.{key}[{at}]: [{from_s:g}, {until_s:g}] must rise')
    return spans


def _heat_path(contents: dict[str, FileData]) -> HeatPath | None:
    """Return the HeatPath that a scenario gives its car; None: that of the vehicle file."""
    if 'heat_path' not in contents:
        return None
    path = HeatPath(**contents['heat_path'])
    problems = list(heat_path_problems(path))
    if problems:
        raise InvalidInput(problems)
    return path


def _position(contents: dict[str, FileData]) -> PositionReports | None:
    """Return how the car says where it is; None: it does not."""
    node = contents.get('route_progress')
    return None if node is None else PositionReports(
        **{**node, 'drop_outs': _spans(node, 'drop_outs', 'route_progress')})


def _sensors(node: dict[str, FileData]) -> Sensors:
    spans = {key: _spans(node, key, 'sensors') for key in ('drop_outs', 'stuck', 'invalid')}
    return Sensors(**{**node, **spans})


# Keys that an event of a kind must have besides its instant, and no other has.
OWN_KEYS: dict[Kind, set[str]] = {
    Kind.STOP: {'duration_s'}, Kind.OTHER_PACE: {'duration_s', 'factor'},
    Kind.DETOUR: {'route'}, Kind.CANCEL_CHARGING: set(), Kind.ARRIVE_EARLY: set()}


def _event(at: int, node: dict[str, FileData], detour: RouteForVehicle | None) -> Event:
    kind = Kind(node['event'])
    own = {key: value for key, value in node.items()
           if key not in ('event', 'at_s', 'route_plan_after_s')}
    if set(own) != OWN_KEYS[kind]:
        raise InvalidInput(f'traffic[{at}]: {kind.value} has '
                           f'{", ".join(sorted(own)) or "nothing"} besides its instant; it must '
                           f'have {", ".join(sorted(OWN_KEYS[kind])) or "nothing"}')
    if detour is not None:
        own['route'] = detour.route
    return Event(kind, float(node['at_s']), node.get('route_plan_after_s', 0.0), **own)


def _expectations(node: dict[str, FileData]) -> Expectations:
    known = {status.name for status in Status}
    for key in ('statuses', 'never'):
        for at, name in enumerate(node.get(key, ())):
            if name not in known:
                raise InvalidInput(f'expect.{key}[{at}]: {name!r} is not one of '
                                   f'{", ".join(sorted(known))}')
    values: dict[str, FileData] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in node.items()}
    for key in ('off_during', 'heats_during'):
        values[key] = _spans(node, key, 'expect')
    return Expectations(**values)
