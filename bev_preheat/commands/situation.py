# SPDX-License-Identifier: Apache-2.0
"""The arguments that subcommands share: vehicle, route, state and goal, methods, prospect of charging, logs."""

from __future__ import annotations

from argparse import _ArgumentGroup as ArgumentGroup
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.stop import ChargingProspect, check_prospect
from bev_preheat.commands.parser import Alternatives, completed_by, given_options, option_group
from bev_preheat.commands.program import say
from bev_preheat.drawing.plan_figure import make_plan_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.interface.inputs import route_or_log
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import (
    check_method,
    DEFAULT_METHOD,
    method_names,
    METHODS,
    REPLACED,
    replaced_in_words,
)
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import Route
from bev_preheat.route.plausibility import unit_warnings
from bev_preheat.route.sources.journey import Offers, RouteOptions
from bev_preheat.tunables import LONGEST_ROW_S
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file
from bev_preheat.vehicle.plausibility import assumption_warning

if TYPE_CHECKING:
    from bev_preheat.drawing.figure import Figure
    from bev_preheat.identification.trips import Trip

# Options of `add_route_options`.
ROUTE_OPTIONS = 'ambient', 'free_speed', 'stop_duration', 'vehicle_id', 'consumption'
# The title of options that few need.
LESS_COMMON = 'less common options'
OFFERS = Offers('{} {}', {
    'ambient_temperature_c': ('--ambient', 'degC', -5), 'free_speed_kmh': ('--free-speed', 'km/h', 90),
    'stop_duration_s': ('--stop-duration', 'min', 20), 'vehicle_id': ('--vehicle-id', ''),
    'with_auxiliaries': ('--consumption', '', 'total', 'drivetrain')})
AMBIENT_HELP = 'ambient temperature [degC] of a route whose file has none'
PROSPECT_OPTIONS = 'charging_probability', 'arrival_deviation', 'charging_known_before'


@dataclass(frozen=True)
class PlanningArguments:
    """
    The situation to plan for, with a title of vehicle and route.

    `files` are the paths of the vehicle's and the route's file; `route_made_for` is the name of the vehicle that
    the route's powers belong to, None if unknown.
    """

    title: str
    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    files: tuple[Path, ...]
    route_made_for: str | None

    @property
    def inputs(self) -> tuple[Vehicle, Route, BatteryState, Goal]:
        """What planning functions take."""
        return self.vehicle, self.route, self.state, self.goal

    def figure(self, plans: Sequence[Plan]) -> Figure:
        """Return the figure of Plans for it."""
        return make_plan_figure(self.vehicle, self.route, self.goal, plans, self.title)

    def as_dictionary(self) -> dict[str, Any]:
        """Return the part of a command's JSON on the inputs."""
        return {'route_made_for': self.route_made_for, 'vehicle_assumed': list(self.vehicle.assumed)}


def add_situation_arguments(parser: ArgumentParser,
                            route_group: Alternatives | None = None) -> None:
    """Add the arguments that `read_situation` reads; `route_group` has the alternatives to `--route`."""
    add_drive_arguments(parser, route_group)
    more = option_group(parser, LESS_COMMON)
    more.add_argument('--no-charging', action='store_true', help='no fast charging at the end of the route')
    more.add_argument('--max-arrival-temperature', type=float, metavar='DEGC',
                      help='highest battery temperature on arrival [degC] (default: any)')


def add_drive_arguments(parser: ArgumentParser, route_group: Alternatives | None = None,
                        needs_state: bool = True, ambient_help: str = AMBIENT_HELP) -> None:
    """Add the arguments of a drive to a charger; without `needs_state` its state at the start is optional."""
    add_vehicle_argument(parser)
    completed_by('routes', (route_group or parser).add_argument(
        '--route', required=route_group is None, metavar='NAME|FILE',
        help='route: a name in config/routes, a file of any known format (CSV, drive cycle, GPX, '
        'GeoJSON, answer of a navigation service, ...), or the legs of a road: legs/NAME or a YAML file'), '.csv')
    parser.add_argument('--temperature', required=needs_state, type=float, metavar='DEGC',
                        help='battery temperature at the start [degC]')
    parser.add_argument('--soc', required=needs_state, type=float, metavar='0..1',
                        help='state of charge at the start')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature on arrival [degC] (default: the vehicle's)")
    add_route_options(parser, ambient_help)
    more = option_group(parser, LESS_COMMON)
    more.add_argument('--min-soc', type=float, metavar='0..1',
                      help='least state of charge on arrival (default: 0)')
    more.add_argument('--step', type=float, metavar='S',
                      help='plan in steps of this length [s] (default: the rows of the route, at most 60)')
    parser.set_defaults(no_charging=False, max_arrival_temperature=None)


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
                        None if stop_min is None else 60.0 * stop_min, arguments.vehicle_id, OFFERS)


def add_vehicle_argument(parser: ArgumentParser, what: str = 'vehicle:', metavar: str = 'NAME|FILE') -> None:
    """Add `--vehicle`; `what` begins the help."""
    completed_by('vehicles', parser.add_argument(
        '--vehicle', required=True, metavar=metavar, help=f'{what} a name in config/vehicles or a YAML file'))


def read_situation(arguments: Namespace) -> PlanningArguments:
    """Return the PlanningArguments of parsed arguments; raise InvalidInput if they are invalid."""
    if arguments.no_charging and (given := given_options(arguments, ('target', 'max_arrival_temperature'))):
        raise InvalidInput(f'{", ".join(given)}: not allowed with --no-charging')
    vehicle = load_planned_vehicle(arguments.vehicle)
    loaded = route_or_log(arguments.route, vehicle, route_options(arguments))
    note(*loaded.remarks)
    route = loaded.route
    if loaded.stops:
        route = route.segments(0, loaded.stops[0].after_segment + 1)
        first = 'charging stop' if len(loaded.stops) == 1 else f'first of {len(loaded.stops)} charging stops'
        note(f'planned up to the {first}, after {route.total_duration_s / 60.0:.0f} min')
    warn(loaded.warning, *(f'route {arguments.route}: {sentence}'
                           for sentence in unit_warnings([loaded.route], vehicle, with_units=True)))
    most_c = arguments.max_arrival_temperature
    goal = Goal(target_of(arguments, vehicle), arguments.min_soc or 0.0, not arguments.no_charging,
                maximum_arrival_temperature_c=math.inf if most_c is None else most_c)
    return PlanningArguments(
        f'vehicle {vehicle.name}, route {arguments.route}', vehicle, in_steps(route, arguments),
        BatteryState(arguments.temperature, arguments.soc), goal, (vehicle_file(arguments.vehicle), loaded.file),
        loaded.made_for)


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
    """Return a Route in the steps of `--step`, else with its long rows divided; raise InvalidInput."""
    if arguments.step is None:
        return route.divided(LONGEST_ROW_S)
    if not 0.1 <= arguments.step <= 3600.0:
        raise InvalidInput(f'--step: {arguments.step:g} s is not allowed; it must be 0.1 ... 3600 s')
    return route.resampled(arguments.step)


def target_of(arguments: Namespace, vehicle: Vehicle) -> float:
    """Return the target [degC] of parsed arguments, the vehicle's default without one."""
    target_c: float | None = arguments.target
    return vehicle.defaults.target_battery_temperature_c if target_c is None else target_c


class MethodNames:
    """The names of all methods for argparse; installed packages are searched only if a name is not built in."""

    def __contains__(self, name: object) -> bool:
        return name in METHODS or name in method_names()

    def __iter__(self) -> Iterator[str]:
        return iter(method_names())

    def checked(self, name: str) -> str:
        """Return an allowed name or what took its place; a method of a package is loaded."""
        if name in REPLACED:
            say(f'preheat: {replaced_in_words(name)}')
            return REPLACED[name]
        try:
            check_method(name)
        except InvalidInput as error:
            raise ArgumentTypeError(str(error).removeprefix('method: ')) from None
        return name


def add_method_argument(parser: ArgumentParser) -> None:
    """Add `--method`."""
    names = MethodNames()
    option_group(parser, LESS_COMMON).add_argument(
        '--method', choices=names, type=names.checked, default=DEFAULT_METHOD, metavar='NAME',
        help='planning method: %(choices)s (default: %(default)s)')


def add_methods_argument(parser: ArgumentParser, default: str) -> None:
    """Add `--methods`, None by default; `default` is the help's word for None."""
    names = MethodNames()
    parser.add_argument('--methods', action='extend', nargs='+', choices=names, type=names.checked, metavar='NAME',
                        help=f'planning methods, of %(choices)s (default: {default})')


def add_log_arguments(parser: ArgumentParser, needs_logs: bool = True) -> None:
    """Add the logs, at least one if the command `needs_logs`, `--signals` and `--repair`."""
    parser.add_argument('logs', nargs='+' if needs_logs else '*', metavar='LOG',
                        help='recorded drives, charging sessions, nights at stand')
    add_signal_arguments(parser)


def add_signal_arguments(parser: ArgumentParser | ArgumentGroup) -> None:
    """Add `--signals` and `--repair`."""
    completed_by('signals', parser.add_argument(
        '--signals', metavar='NAME|FILE',
        help='signal map: a name in config/signals or a YAML file (default: the map that recognises the log)'))
    parser.add_argument('--repair', action='store_true',
                        help='correct mix-ups of sign, unit and scale that physics reveals')


def read_trips(arguments: Namespace, vehicle: Vehicle, is_fit: bool = False) -> list[Trip]:
    """Return the Trips of logs, one recording in memory at a time; for a fit, doubts about sign or unit refuse."""
    from bev_preheat.identification.recording_checks import refuse_doubted
    from bev_preheat.identification.trips import trip_of, trips_from
    from bev_preheat.logs.reading import read_recording

    def trip(path: str) -> Trip:
        recording = read_recording(Path(path), arguments.signals, arguments.repair)
        if is_fit:
            refuse_doubted(recording)
        return trip_of(recording, vehicle)

    return trips_from(partial(trip, path) for path in arguments.logs)


def add_prospect_arguments(parser: ArgumentParser) -> None:
    """Add the arguments that `read_prospect` reads."""
    group = option_group(parser, 'charging or arrival in doubt')
    group.add_argument('--charging-probability', type=float, metavar='0..1',
                       help='probability that the vehicle charges on arrival, above 0 (default: it does); below '
                       '1, plan heats only if that pays')
    group.add_argument('--arrival-deviation', type=float, metavar='S',
                       help='standard deviation of the arrival time [s] (default: exact)')
    group.add_argument('--charging-known-before', type=float, metavar='S',
                       help='how long before arrival the driver knows whether the vehicle charges [s] (default: '
                       'on arrival)')


def read_prospect(arguments: Namespace) -> ChargingProspect:
    """Return the ChargingProspect of parsed arguments; raise InvalidInput if they are not allowed."""
    probability, deviation_s, known_s = (getattr(arguments, name) for name in PROSPECT_OPTIONS)
    prospect = ChargingProspect(1.0 if probability is None else probability, deviation_s or 0.0, known_s or 0.0)
    check_prospect(prospect)
    if known_s and prospect.probability == 1.0:
        raise InvalidInput('--charging-known-before: only with --charging-probability below 1')
    return prospect
