# SPDX-License-Identifier: Apache-2.0
"""The arguments that say what is planned: vehicle, route, state and goal."""

from dataclasses import dataclass

from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route, Route
from bev_preheat.vehicle import load_vehicle, Vehicle


@dataclass(frozen=True)
class Situation:
    """What a plan is made for."""

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal


def add_situation_arguments(parser):
    """Add the arguments that `read_situation` reads."""
    parser.add_argument('--vehicle', required=True, metavar='NAME|FILE',
                        help='vehicle: a name in config/vehicles or a YAML file')
    parser.add_argument('--route', required=True, metavar='NAME|FILE',
                        help='route: a name in config/routes or a CSV file')
    parser.add_argument('--temperature', required=True, type=float, metavar='DEGC',
                        help='battery temperature at the start [degC]')
    parser.add_argument('--soc', required=True, type=float, metavar='0..1',
                        help='state of charge at the start')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="battery temperature wanted on arrival [degC]; the vehicle's default "
                        'if not given')
    parser.add_argument('--min-soc', type=float, default=0.0, metavar='0..1',
                        help='state of charge that must be left on arrival (default: 0)')
    parser.add_argument('--no-charging', action='store_true',
                        help='no fast charging at the end of the route')
    parser.add_argument('--step', type=float, metavar='S',
                        help='plan in steps of this length [s]; the rows of the route if not given')


def read_situation(arguments):
    """Return the Situation of parsed arguments; raise InvalidInput where they make none."""
    vehicle = load_vehicle(arguments.vehicle)
    route = load_route(arguments.route, vehicle.defaults)
    if arguments.step is not None:
        if not 0.1 <= arguments.step <= 3600.0:
            raise InvalidInput(f'--step: {arguments.step:g} s is not allowed; it must be '
                               '0.1 ... 3600 s')
        route = route.resampled(arguments.step)
    target_c = arguments.target
    if target_c is None:
        target_c = vehicle.defaults.target_battery_temperature_c
    return Situation(vehicle, route, BatteryState(arguments.temperature, arguments.soc),
                     Goal(target_c, arguments.min_soc, not arguments.no_charging))
