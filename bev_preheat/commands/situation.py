# SPDX-License-Identifier: Apache-2.0
"""The arguments that define a situation: vehicle, route, state and goal."""

from __future__ import annotations

from dataclasses import dataclass
import sys
from typing import TYPE_CHECKING

from bev_preheat.commands.completion import completed_by, ROUTES, VEHICLES
from bev_preheat.commands.parser import option_group
from bev_preheat.errors import InvalidInput
from bev_preheat.interface.route_or_log import route_or_log
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import Route
from bev_preheat.route.plausibility import unit_warnings
from bev_preheat.route.sources.journey import RouteOptions
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file
from bev_preheat.vehicle.plausibility import assumption_warning

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from pathlib import Path
    from typing import Any

    from bev_preheat.commands.arguments import Alternatives

# Options of `add_route_options`.
ROUTE_OPTIONS = ('ambient', 'free-speed', 'stop-duration', 'vehicle-id', 'consumption')
# The title of options that few need.
LESS_COMMON = 'less common options'
AMBIENT_HELP = 'ambient temperature [degC] of a route whose file has none'


@dataclass(frozen=True)
class PlanningArguments:
    """
    The situation to plan for; `files` are the paths of the vehicle's and the route's file.

    `route_made_for` is the name of the vehicle that the route's powers belong to, None if unknown.
    """

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    files: tuple[Path, ...]
    route_made_for: str | None

    def as_dictionary(self) -> dict[str, Any]:
        """Return the part of a command's JSON on the inputs."""
        return {'route_made_for': self.route_made_for, 'vehicle_assumed': list(self.vehicle.assumed)}


def add_situation_arguments(parser: ArgumentParser,
                            route_group: Alternatives | None = None) -> None:
    """
    Add the arguments that `read_situation` reads.

    `route_group` is a group that requires exactly one argument, if `--route` has alternatives.
    """
    add_drive_arguments(parser, route_group)
    option_group(parser, LESS_COMMON).add_argument(
        '--no-charging', action='store_true', help='no fast charging at the end of the route')


def add_drive_arguments(parser: ArgumentParser, route_group: Alternatives | None = None,
                        needs_state: bool = True, ambient_help: str = AMBIENT_HELP) -> None:
    """
    Add the arguments of a drive to a charger, all that `read_situation` needs.

    `route_group` is as in `add_situation_arguments`; without `needs_state` temperature and state of
    charge at the start are optional.
    """
    add_vehicle_argument(parser)
    completed_by(ROUTES, (route_group or parser).add_argument(
        '--route', required=route_group is None, metavar='NAME|FILE',
        help='route: a name in config/routes, a file of any known format (CSV, drive cycle, GPX, '
        'GeoJSON, answer of a navigation service, ...), or the legs of a road: legs/NAME or a YAML file'))
    parser.add_argument('--temperature', required=needs_state, type=float, metavar='DEGC',
                        help='battery temperature at the start [degC]')
    parser.add_argument('--soc', required=needs_state, type=float, metavar='0..1',
                        help='state of charge at the start')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature on arrival [degC] (default: the vehicle's)")
    add_route_options(parser, ambient_help)
    more = option_group(parser, LESS_COMMON)
    more.add_argument('--min-soc', type=float, default=0.0, metavar='0..1',
                      help='least state of charge on arrival (default: 0)')
    more.add_argument('--step', type=float, metavar='S',
                      help='plan in steps of this length [s] (default: the rows of the route)')
    parser.set_defaults(no_charging=False)


def add_route_options(parser: ArgumentParser, ambient_help: str = AMBIENT_HELP) -> None:
    """Add the options that `route_options` reads."""
    parser.add_argument('--ambient', type=float, metavar='DEGC', help=ambient_help)
    of_file = option_group(parser, 'files of routes without some figures')
    of_file.add_argument('--free-speed', type=float, metavar='KMH',
                         help='speed on free road [km/h] of a line on the map without times')
    of_file.add_argument('--stop-duration', type=float, metavar='MIN',
                         help='the waypoints of navigation are charging stops of this duration [min] '
                         '(default: they are passed)')
    of_file.add_argument('--vehicle-id', metavar='ID', help='the vehicle in a SUMO file with several')
    of_file.add_argument('--consumption', choices=('total', 'drivetrain'),
                         help='whether the consumption in a list of segments includes heating and auxiliaries')


def route_options(arguments: Namespace) -> RouteOptions:
    """Return the RouteOptions of parsed arguments."""
    with_auxiliaries = None if arguments.consumption is None else arguments.consumption == 'total'
    stop_min = arguments.stop_duration
    if stop_min is not None and not 1.0 <= stop_min <= 1440.0:
        raise InvalidInput(f'--stop-duration: {stop_min:g} min is not allowed; it must be 1 ... 1440 min')
    return RouteOptions(arguments.ambient, with_auxiliaries, arguments.free_speed,
                        None if stop_min is None else 60.0 * stop_min, arguments.vehicle_id)


def add_vehicle_argument(parser: ArgumentParser) -> None:
    """Add `--vehicle`."""
    completed_by(VEHICLES, parser.add_argument(
        '--vehicle', required=True, metavar='NAME|FILE',
        help='vehicle: a name in config/vehicles or a YAML file'))


def read_situation(arguments: Namespace) -> PlanningArguments:
    """Return the PlanningArguments of parsed arguments; raise InvalidInput if they are invalid."""
    vehicle = load_planned_vehicle(arguments.vehicle)
    loaded = route_or_log(arguments.route, vehicle, route_options(arguments))
    note(*loaded.remarks)
    route = loaded.route
    if loaded.stops:
        route = route.segments(0, loaded.stops[0].after_segment + 1)
        first = 'charging stop' if len(loaded.stops) == 1 else f'first of {len(loaded.stops)} charging stops'
        note(f'planned up to the {first}, after '
             f'{route.total_duration_s / 60.0:.0f} min')
    warn(loaded.warning, *(f'route {arguments.route}: {sentence}'
                           for sentence in unit_warnings([loaded.route], vehicle, with_units=True)))
    return PlanningArguments(vehicle, in_steps(route, arguments),
                             BatteryState(arguments.temperature, arguments.soc),
                             Goal(target_of(arguments, vehicle), arguments.min_soc,
                                  not arguments.no_charging),
                             (vehicle_file(arguments.vehicle), loaded.file), loaded.made_for)


def warn(*sentences: str | None) -> None:
    """Print each sentence that is not None to standard error, once."""
    for sentence in dict.fromkeys(filter(None, sentences)):
        print(f'preheat: warning: {sentence}', file=sys.stderr)


def note(*sentences: str) -> None:
    """Print each sentence to standard error."""
    for sentence in sentences:
        print(f'preheat: note: {sentence}', file=sys.stderr)


def load_planned_vehicle(name_or_file: str) -> Vehicle:
    """Return a Vehicle, and warn on standard error about its assumed values, because plans depend on them."""
    vehicle = load_vehicle(name_or_file)
    warn(assumption_warning(vehicle, vehicle_file(name_or_file)))
    return vehicle


def in_steps(route: Route, arguments: Namespace) -> Route:
    """Return a Route in the steps of `--step`; raise InvalidInput if the step is not allowed."""
    if arguments.step is None:
        return route
    if not 0.1 <= arguments.step <= 3600.0:
        raise InvalidInput(f'--step: {arguments.step:g} s is not allowed; it must be '
                           '0.1 ... 3600 s')
    return route.resampled(arguments.step)


def target_of(arguments: Namespace, vehicle: Vehicle) -> float:
    """Return the target [degC] of parsed arguments, the vehicle's default without one."""
    target_c: float | None = arguments.target
    return vehicle.defaults.target_battery_temperature_c if target_c is None else target_c
