# SPDX-License-Identifier: Apache-2.0
"""`preheat robustness`: the planner in closed loop with cars that differ from their vehicle file."""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from bev_preheat.commands.parser import completed_by, given_options, option_group, Subparsers
from bev_preheat.commands.situation import load_planned_vehicle, MethodNames, target_of, warn
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.route import route_for, route_source
from bev_preheat.vehicle import vehicle_file
from bev_preheat.vehicle.description import HVCH
from bev_preheat_studies.results_file import digest_of
from bev_preheat_studies.robustness.cars import CarResult, drive_car, print_summary, summarise_drives
from bev_preheat_studies.robustness.days import DayResult, drive_day, print_days, summarise_days
from bev_preheat_studies.robustness.drawn_cars import (
    Conditions,
    FAULTS,
    PLANTS,
    PROPULSION_POWER_VARIABILITY,
    SPREAD,
    TEMPERATURE_NOISE_K,
    TEMPERATURE_RESOLUTION_K,
)
from bev_preheat_studies.robustness.driven import COMPARED
from bev_preheat_studies.robustness.signals import CASES, drive_case, print_cases, SignalResult, summarise_cases
from bev_preheat_studies.study import add_study_arguments, check_study_arguments, Study

# Number of trips, days or cars by kind of study; the routes of days.
DEFAULT_TRIPS = {'': 300, 'days': 200, 'signals': 20}
ROUTES_OF_DAYS = 'reference', 'alpine_pass', 'city_stop_and_go', 'motorway_3h', 'winter_commute'
# Routes on which each climb and each descent has its own heating interval.
HILLY = ('alpine_pass',)
# Driven part of each route with wrong signals [s].
DRIVEN_S = 1500.0
# (low, high) that the options allow; the period is that of the node's lease, timeout and commands.
LIMITS = {'period': (0.1, 10.0), 'traffic': (0.0, 0.5)}


class ComparedNames(MethodNames):
    """The names of COMPARED, and of all methods."""

    def __contains__(self, name: object) -> bool:
        return name in COMPARED or super().__contains__(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*COMPARED, *super().__iter__()))

    def checked(self, name: str) -> str:
        """Return an allowed name or what took its place; a method of a package is loaded."""
        try:
            return name if name in COMPARED else super().checked(name)
        except ArgumentTypeError as error:
            raise ArgumentTypeError(f'{error}; also allowed: {", ".join(COMPARED)}') from None


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'robustness', help='planner in closed loop with cars that differ from their vehicle file',
        description="Drive cars that differ from vehicle and route file with the planner (and with the paper's "
        'heuristic, re-planned on each battery state), without ROS: arrival temperature, switch-ons, and the '
        'energy above that of a plan made with the true car.')
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument('--days', action='store_true',
                       help='whole days in one process: 2 … 5 trips with charging and parking in between, early '
                       'and late, with and without voltage and current')
    kinds.add_argument('--signals', action='store_true',
                       help='faulty battery states: which signals are reported, and how soon')
    parser.add_argument('--trips', type=int, metavar='N',
                        help='number of trips (default: 300); with --days, of days (200); with --signals, of '
                        'cars for each case (20)')
    completed_by('vehicles', parser.add_argument(
        '--vehicle', default='reference', metavar='NAME|FILE',
        help='vehicle before it is varied (default: %(default)s)'))
    completed_by('routes', parser.add_argument(
        '--route', action='extend', nargs='+', metavar='NAME|FILE',
        help='route before it is varied, or legs/NAME; trips use several routes alternately, days at random '
        '(default: reference; with --days the five of config/routes)'), '.csv')
    parser.add_argument('--temperature', type=float, default=-7.0, metavar='DEGC',
                        help='battery temperature at the start [degC] (default: %(default)s)')
    parser.add_argument('--soc', type=float, default=0.9, metavar='0..1',
                        help='state of charge at the start (default: %(default)s)')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature on arrival [degC] (default: the vehicle's)")
    compared = ComparedNames()
    parser.add_argument('--methods', action='extend', nargs='+', choices=compared, type=compared.checked,
                        metavar='METHOD', help='of %(choices)s; a planning method drives as in the planner '
                        f'(default: {", ".join(COMPARED)})')
    true_car = option_group(parser, 'the true car and its signals')
    true_car.add_argument('--fault', choices=tuple(FAULTS), default='none',
                          help='a real heater fault that starts during the drive (default: %(default)s)')
    true_car.add_argument('--fault-source', default=HVCH, metavar='NAME',
                          help="the vehicle's heat source that fails (default: %(default)s)")
    true_car.add_argument('--plant', choices=tuple(PLANTS), default='nominal',
                          help='effects of the true car that the model leaves out: a heater that lags, coolant '
                          'that must be heated, a sensor that lags, a current ripple that is not measured; or, of '
                          'which the file says nothing, a shell and a core with the sensor on either '
                          '(default: %(default)s)')
    true_car.add_argument('--period', type=float, default=1.0, metavar='S',
                          help='period of battery states and of commands [s] (default: %(default)s)')
    true_car.add_argument('--no-power', action='store_true',
                          help='battery states carry neither voltage nor current')
    true_car.add_argument('--traffic', type=float, default=0.0, metavar='SHARE',
                          help="largest relative deviation of a trip's duration from its route's, which the trip "
                          'planner does not report (default: %(default)s)')
    true_car.add_argument('--progress', action='store_true', help='the car reports its position on the route')
    add_study_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Run the study; returns 0 whether or not the requirements are met."""
    kind = 'days' if arguments.days else 'signals' if arguments.signals else ''
    refused = [*given_options(arguments, ('plot', 'methods', 'progress', 'no_power')),
               *['--traffic'] * (arguments.traffic != 0.0),
               *['--fault'] * (kind == 'signals' and arguments.fault != 'none')]
    if kind and refused:
        raise InvalidInput(f'{", ".join(refused)}: not allowed with --{kind}')
    if arguments.fault_source != HVCH and arguments.fault == 'none':
        raise InvalidInput('--fault-source: only with --fault')
    trips = DEFAULT_TRIPS[kind] if arguments.trips is None else arguments.trips
    arguments.route = arguments.route or (list(ROUTES_OF_DAYS) if kind == 'days' else ['reference'])
    check_study_arguments(
        arguments, (vehicle_file(arguments.vehicle), *map(route_source, arguments.route)), 'trips', **LIMITS)
    conditions = _conditions(arguments)
    if kind == 'days':
        return _run_days(arguments, conditions, trips)
    if kind == 'signals':
        conditions = replace(conditions, routes=tuple(
            route.before(min(DRIVEN_S, route.total_duration_s)) for route in conditions.routes))
        return Study(partial(drive_case, conditions, arguments.seed), SignalResult, trips * len(CASES),
                     _identity(arguments, conditions, 'signals'), what='drives').conduct(
                         arguments, _shown_cases)
    # Without duplicates, in the order of the command line.
    methods = tuple(dict.fromkeys(arguments.methods or COMPARED))

    def show(console: Console, results: list[CarResult]) -> dict[str, Any]:
        summary = summarise_drives(results, methods)
        if arguments.plot:
            from bev_preheat.drawing.figure import save_figure
            from bev_preheat_studies.robustness.figure import make_robustness_figure
            save_figure(make_robustness_figure(results, methods), arguments.plot)
        console.print(_drawn_sentence(), soft_wrap=True)
        print_summary(console, summary, methods)
        return {'drawn': _drawn(), 'summary': summary}

    return Study(partial(drive_car, conditions, arguments.seed, methods), CarResult, trips, {
        **_identity(arguments, conditions, 'robustness'), 'methods': list(methods)}).conduct(arguments, show)


def _run_days(arguments: Namespace, conditions: Conditions, days: int) -> int:
    has_fault = conditions.fault != 'none'

    def show(console: Console, results: list[DayResult]) -> dict[str, Any]:
        hilly = [number for number, name in enumerate(arguments.route) if Path(name).stem in HILLY]
        summary = summarise_days(results, has_fault, hilly)
        print_days(console, summary, has_fault)
        return {'summary': summary}

    return Study(partial(drive_day, conditions, arguments.seed), DayResult, days,
                 _identity(arguments, conditions, 'days'), what='days').conduct(arguments, show)


def _shown_cases(console: Console, results: list[SignalResult]) -> dict[str, Any]:
    summary = summarise_cases(results)
    print_cases(console, summary)
    return {'summary': summary}


def _conditions(arguments: Namespace) -> Conditions:
    vehicle = load_planned_vehicle(arguments.vehicle)
    vehicle.most_w(arguments.fault_source)
    routes = []
    for name in arguments.route:
        loaded = route_for(name, vehicle)
        warn(loaded.warning)
        routes.append(loaded.route)
    state = BatteryState(arguments.temperature, arguments.soc)
    goal = Goal(target_of(arguments, vehicle))
    for route in routes:
        check_situation(vehicle, route, state, goal)
    return Conditions(vehicle, tuple(routes), state, goal, arguments.period,
                      not arguments.no_power, arguments.plant, arguments.fault, arguments.fault_source,
                      arguments.traffic, arguments.progress)


def _identity(arguments: Namespace, conditions: Conditions, study: str) -> dict[str, Any]:
    """Return what the results depend on; the number of trips may change."""
    return {'study': study, 'seed': arguments.seed,
            'vehicle': f'{conditions.vehicle.name} ({digest_of(conditions.vehicle)})',
            **{f'route {number}': f'{Path(name).stem} ({digest_of(route)})' for number, (name, route) in enumerate(
                zip(arguments.route, conditions.routes), start=1)},
            **asdict(conditions.state), **asdict(conditions.goal),
            **{name: value for name, value in vars(conditions).items()
               if name not in ('vehicle', 'routes', 'state', 'goal')}}


def _drawn() -> dict[str, Any]:
    return {'spread': SPREAD, 'propulsion_power_variability': PROPULSION_POWER_VARIABILITY,
            'temperature_noise_k': TEMPERATURE_NOISE_K, 'temperature_resolution_k': TEMPERATURE_RESOLUTION_K}


def _drawn_sentence() -> str:
    """Return a sentence on the distributions."""
    spread = ', '.join(f'{name.replace("_", " ")} ±{100 * share:.0f} %' for name, share in SPREAD.items())
    return (f'Drawn for each trip: {spread}, all uniform; propulsion power varies from segment to '
            f'segment (standard deviation of the logarithm {PROPULSION_POWER_VARIABILITY:g}). '
            f'Measured temperature: noise {TEMPERATURE_NOISE_K:g} K, then rounded to '
            f'{TEMPERATURE_RESOLUTION_K:g} K.')
