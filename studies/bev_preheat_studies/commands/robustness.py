# SPDX-License-Identifier: Apache-2.0
"""`preheat robustness`: the planner in closed loop with cars that differ from their vehicle file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from bev_preheat.commands.completion import completed_by, ROUTES, VEHICLES
from bev_preheat.commands.method_argument import MethodNames
from bev_preheat.commands.situation import load_planned_vehicle, target_of, warn
from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import add_output_arguments, write_json
from bev_preheat.console.terminal import (
    print_figures,
    print_records,
    progress_bar,
    progress_console,
    result_console,
)
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.route import route_for, route_source
from bev_preheat.vehicle import vehicle_file
from bev_preheat_studies.commands.study_arguments import add_study_arguments, check_study_arguments, study_executor
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.robustness.car_figures import summarise_drives
from bev_preheat_studies.robustness.car_study import COMPARED, drive_car, result_from, run_study
from bev_preheat_studies.robustness.drawn_cars import (
    Conditions,
    FAULTS,
    PLANTS,
    PROPULSION_POWER_VARIABILITY,
    SPREAD,
    TEMPERATURE_NOISE_K,
    TEMPERATURE_RESOLUTION_K,
)
from bev_preheat_studies.sources import digest_of

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence
    from typing import Any

    from rich.console import Console

    from bev_preheat.commands.arguments import Subparsers
    from bev_preheat.console.finished import InterruptedEnding
    from bev_preheat_studies.robustness.car_figures import Figures
    from bev_preheat_studies.robustness.car_study import CarResult

# Number of trips, days or cars by kind of study; the routes of days.
DEFAULT_TRIPS = {'': 300, 'days': 200, 'signals': 20}
ROUTES_OF_DAYS = 'reference', 'alpine_pass', 'city_stop_and_go', 'motorway_3h', 'winter_commute'
# (low, high) that the options allow.
LIMITS = {
    'trips': (1, 100_000),
    'only': (0, 2**31),
    'seed': (0, 2**31),
    # The node's own limits on lease, timeout and command period.
    'period': (0.1, 10.0),
    'traffic': (0.0, 0.5),
}
# Rows of the table: heading, value from a method's figures, format.
ROWS = (
    ('Arrival error, 5 % [K]', lambda figures: figures['arrival_error_k']['5 %'], '+.2f'),
    ('… median', lambda figures: figures['arrival_error_k']['median'], '+.2f'),
    ('… 95 %', lambda figures: figures['arrival_error_k']['95 %'], '+.2f'),
    ('… worst', lambda figures: figures['arrival_error_k']['worst'], '+.2f'),
    ('Switch-ons, mean', lambda figures: figures['switch_ons']['mean'], '.2f'),
    ('… most', lambda figures: figures['switch_ons']['most'], 'd'),
    ('Heating energy, mean [Wh]', lambda figures: figures['heating_energy_wh'], '.1f'),
    ('… trips compared', lambda figures: figures['heating_excess']['trips'], 'd'),
    ('… above plan with true car, mean [%]', lambda figures: _percent(figures['heating_excess']['mean']),
     '+.2f'),
    ('… above plan with true car, 95 % [%]', lambda figures: _percent(figures['heating_excess']['95 %']),
     '+.2f'),
    ('Battery energy, mean [Wh]', lambda figures: figures['battery_energy_wh'], '.1f'),
    ('… above plan with true car, mean [%]', lambda figures: _percent(figures['battery_excess']['mean']),
     '+.2f'),
    ('Time at partial heater power, mean [s]', lambda figures: figures['partial_duty_s']['mean'], '.1f'),
    ('… most', lambda figures: figures['partial_duty_s']['most'], '.1f'),
    ('Drives with a heater fault reported', lambda figures: figures['verdicts'], 'd'),
    ('Drives in which a real fault has an effect', lambda figures: figures['fault']['shown'], 'd'),
    ('… is found [%]', lambda figures: _percent(figures['fault']['found']), '.0f'),
    ('… after, median [s]', lambda figures: figures['fault']['median_s'], '.0f'),
    ('… after, most [s]', lambda figures: figures['fault']['most_s'], '.0f'),
    ('… not found, effect at most [s]', lambda figures: figures['fault']['missed_most_s'], '.0f'),
    ('Refused inputs', lambda figures: figures['refused_inputs'], 'd'),
    ('Updates without a plan', lambda figures: figures['updates_without_plan'], 'd'),
    ('Trips with an empty battery', lambda figures: figures['ran_empty'], 'd'),
    ('Planner, CPU per update [ms]', lambda figures: 1e3 * figures['planner_cpu_per_update_s'],
     '.2f'),
)


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
    parser.add_argument('--only', type=int, metavar='NUMBER',
                        help='run a single trip, or day, of the study; --plot then draws the trip over time')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    add_study_arguments(parser)
    compared = MethodNames(*COMPARED)
    parser.add_argument('--methods', nargs='+', choices=compared, type=compared.checked, default=list(COMPARED),
                        metavar='METHOD', help='of %(choices)s; a planning method drives as in the planner '
                        f'(default: {", ".join(COMPARED)})')
    completed_by(VEHICLES, parser.add_argument(
        '--vehicle', default='reference', metavar='NAME|FILE',
        help='vehicle before it is varied (default: %(default)s)'))
    completed_by(ROUTES, parser.add_argument(
        '--route', nargs='+', metavar='NAME|FILE',
        help='route before it is varied, or legs/NAME; trips use several routes alternately, days at random '
        '(default: reference; with --days the five of config/routes)'))
    parser.add_argument('--fault', choices=tuple(FAULTS), default='none',
                        help='a real heater fault that starts during the drive (default: %(default)s)')
    parser.add_argument('--plant', choices=tuple(PLANTS), default='nominal',
                        help='effects of the true car that the model leaves out: a heater that lags, coolant that '
                        'must be heated, a sensor that lags, a current ripple that is not measured '
                        '(default: %(default)s)')
    parser.add_argument('--temperature', type=float, default=-7.0, metavar='DEGC',
                        help='battery temperature at the start [degC] (default: %(default)s)')
    parser.add_argument('--soc', type=float, default=0.9, metavar='0..1',
                        help='state of charge at the start (default: %(default)s)')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature on arrival [degC] (default: the vehicle's)")
    parser.add_argument('--period', type=float, default=1.0, metavar='S',
                        help='period of battery states and of commands [s] '
                        '(default: %(default)s)')
    parser.add_argument('--no-power', action='store_true',
                        help='battery states carry neither voltage nor current')
    parser.add_argument('--traffic', type=float, default=0.0, metavar='SHARE',
                        help="largest relative deviation of a trip's duration from its route's, which the trip "
                        'planner does not report (default: %(default)s)')
    parser.add_argument('--progress', action='store_true',
                        help='the car reports its position on the route')
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Run the study or a single trip; returns 0 whether or not the requirements are met."""
    _choose_defaults(arguments)
    conditions = _conditions(arguments)
    check_study_arguments(
        arguments, (vehicle_file(arguments.vehicle), *map(route_source, arguments.route)))
    if arguments.days or arguments.signals:
        return _run_of_kind(arguments, conditions)
    # Without duplicates, in the order of the command line.
    methods = list(dict.fromkeys(arguments.methods))
    if arguments.only is not None:
        if arguments.results is not None or arguments.cluster is not None:
            raise InvalidInput('--results and --cluster are for a whole study; --only runs a single trip here')
        return _run_one(arguments, conditions, methods)
    results = []
    with (keeping_what_is_finished() as ending,
          kept_results(arguments.results, _study(arguments, conditions, methods), result_from) as kept,
          study_executor(arguments) as executor,
          progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                       TimeElapsedColumn()) as progress):
        task = progress.add_task('trips', total=arguments.trips)

        def report(result: CarResult) -> None:
            results.append(result)
            progress.update(task, advance=1)

        run_study(conditions, arguments.trips, arguments.seed, executor, methods, report,
                  kept.finished, kept.keep)
    if results:
        _give_out(arguments, results, methods, ending)
    ending.tell(len(results), arguments.trips, 'trips', (arguments.json, arguments.plot),
                arguments.results)
    return 0


def _choose_defaults(arguments: Namespace) -> None:
    """Fill in defaults that depend on the kind of study; refuse options that it draws itself."""
    kind = 'days' if arguments.days else 'signals' if arguments.signals else ''
    if arguments.trips is None:
        arguments.trips = DEFAULT_TRIPS[kind]
    if arguments.route is None:
        arguments.route = list(ROUTES_OF_DAYS) if kind == 'days' else ['reference']
    refused = {'--plot': arguments.plot is not None, '--progress': arguments.progress,
               '--no-power': arguments.no_power, '--traffic': arguments.traffic != 0.0,
               '--fault': kind == 'signals' and arguments.fault != 'none',
               '--only': kind == 'signals' and arguments.only is not None}
    names = [name for name, is_given in refused.items() if kind and is_given]
    if names:
        raise InvalidInput(f'{", ".join(names)}: not allowed with --{kind}')


def _run_of_kind(arguments: Namespace, conditions: Conditions) -> int:
    """Run the study of days or of signals."""
    if arguments.days:
        from bev_preheat_studies.commands.robustness_days import run_days_study
        return run_days_study(arguments, conditions, _described(arguments), _study(arguments, conditions, ()))
    from bev_preheat_studies.commands.robustness_signals import run_signals_study
    return run_signals_study(arguments, conditions, _described(arguments), _study(arguments, conditions, ()))


def _give_out(arguments: Namespace, results: list[CarResult], methods: Sequence[str],
              ending: InterruptedEnding) -> None:
    summary = summarise_drives(results, methods)
    if arguments.json:
        write_json(arguments.json, {**_described(arguments), 'trips': arguments.trips,
                                    'complete': ending.is_complete,
                                    'summary': summary,
                                    'results': [asdict(result) for result in results]})
    if arguments.plot:
        from bev_preheat_studies.drawing.robustness_figure import draw_robustness
        draw_robustness(arguments.plot, results, methods)
    console = result_console(arguments.json)
    console.print(_drawn_sentence(), soft_wrap=True)
    if not ending.is_complete:
        console.print(f'Interrupted: only part of the study has run, {len(results)} of '
                      f'{arguments.trips} trips.')
    print_summary(console, summary, methods)


def _run_one(arguments: Namespace, conditions: Conditions, methods: Sequence[str]) -> int:
    with progress_console().status('driving …'):
        result, courses = drive_car(conditions, arguments.seed, arguments.only, methods)
    if arguments.json:
        write_json(arguments.json, {
            **_described(arguments), 'result': asdict(result),
            'courses': {method: {name: values.tolist() for name, values in vars(course).items()}
                        for method, course in courses.items()}})
    if arguments.plot:
        from bev_preheat_studies.drawing.robustness_figure import draw_trip_course
        draw_trip_course(arguments.plot, result, courses, conditions.goal.target_temperature_c)
    console = result_console(arguments.json)
    console.print(_drawn_sentence(), soft_wrap=True)
    print_trip(console, result)
    return 0


def _conditions(arguments: Namespace) -> Conditions:
    problems = []
    for name, (low, high) in LIMITS.items():
        value = getattr(arguments, name)
        if value is not None and not low <= value <= high:
            problems.append(f'--{name}: {value:g} is not allowed; it must be {low:g} ... {high:g}')
    if problems:
        raise InvalidInput(problems)
    vehicle = load_planned_vehicle(arguments.vehicle)
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
                      not arguments.no_power, arguments.plant, arguments.fault, arguments.traffic,
                      arguments.progress)


def _study(arguments: Namespace, conditions: Conditions, methods: Sequence[str]) -> dict[str, Any]:
    """Return the study's identity for its results file; the number of trips may change."""
    return {'study': 'robustness', 'seed': arguments.seed, 'methods': list(methods),
            'vehicle': f'{conditions.vehicle.name} ({digest_of(conditions.vehicle)})',
            **{f'route {number}': f'{Path(name).stem} ({digest_of(route)})' for number, (name, route) in enumerate(
                zip(arguments.route, conditions.routes), start=1)},
            **asdict(conditions.state), **asdict(conditions.goal),
            **{name: value for name, value in vars(conditions).items()
               if name not in ('vehicle', 'routes', 'state', 'goal')},
            'drawn': _drawn()}


def _drawn() -> dict[str, Any]:
    return {'spread': SPREAD, 'propulsion_power_variability': PROPULSION_POWER_VARIABILITY,
            'temperature_noise_k': TEMPERATURE_NOISE_K,
            'temperature_resolution_k': TEMPERATURE_RESOLUTION_K}


def _drawn_sentence() -> str:
    """Return a sentence on the distributions."""
    spread = ', '.join(f'{name.replace("_", " ")} ±{100 * share:.0f} %'
                       for name, share in SPREAD.items())
    return (f'Drawn for each trip: {spread}, all uniform; propulsion power varies from segment to '
            f'segment (standard deviation of the logarithm {PROPULSION_POWER_VARIABILITY:g}). '
            f'Measured temperature: noise {TEMPERATURE_NOISE_K:g} K, then rounded to '
            f'{TEMPERATURE_RESOLUTION_K:g} K.')


def _described(arguments: Namespace) -> dict[str, Any]:
    """Return the conditions for a JSON file."""
    return {'seed': arguments.seed, 'vehicle': arguments.vehicle, 'route': arguments.route,
            'plant': arguments.plant, 'fault': arguments.fault,
            'temperature_c': arguments.temperature, 'soc': arguments.soc,
            'target_temperature_c': arguments.target, 'period_s': arguments.period,
            'reports_power': not arguments.no_power, 'traffic': arguments.traffic,
            'tells_position': arguments.progress, 'drawn': _drawn()}


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def print_summary(console: Console, summary: Figures, methods: Sequence[str]) -> None:
    """Print the tables of a summary."""
    informed = summary['informed']
    console.print(f'plan with the true car ("informed"): '
                  f'{informed["heating_energy_wh"]:.1f} Wh of heating, '
                  f'{informed["battery_energy_wh"]:.1f} Wh from the battery on average; arrival '
                  f'error {informed["arrival_error_k"]["worst"]:+.3f} K at worst', soft_wrap=True)
    print_figures(console, 'In closed loop', ('', *methods), [
        (heading, *(_text(figure(summary[method]), form) for method in methods))
        for heading, figure, form in ROWS])
    print_records(console, 'Requirements', ('', 'bound', *methods), [
        (row[0]['name'], row[0]['bound'], *map(_judged, row))
        for row in zip(*(summary[method]['requirements'] for method in methods))],
        ('left', 'left', *('right' for _ in methods)))
    for method in methods:
        worst = ', '.join(f'{what} {number}'
                          for what, number in summary[method]['worst_trips'].items())
        console.print(f'{method}: extreme trips (--only NUMBER): {worst}', soft_wrap=True)


def _judged(requirement: Figures) -> Text:
    value = requirement['value']
    if requirement['met'] is None:
        return Text('no trip to compare')
    text = _text(value, 'd' if isinstance(value, int) else '+.2f')
    colour, verdict = ('green', 'met') if requirement['met'] else ('red', 'not met')
    return Text.assemble(f'{text} {requirement["unit"]}'.rstrip(), ' ', (verdict, colour))


def _text(value: float | None, form: str) -> str:
    return '–' if value is None else format(value, form)


def print_trip(console: Console, result: CarResult) -> None:
    """Print one trip."""
    car = ', '.join(f'{name.replace("_", " ")} {getattr(result.mismatch, name):.3f}'
                    for name in SPREAD)
    pace = '' if result.pace == 1.0 else f"; takes {result.pace:.3f} of its route's time"
    console.print(f'trip {result.number}: {car}{pace}', soft_wrap=True)
    drives = {'informed': result.informed, **result.methods}
    print_figures(console, None, ('', *drives), [
        (heading, *(_text(getattr(drive, field), form) for drive in drives.values()))
        for heading, field, form in (('Arrival error [K]', 'arrival_error_k', '+.2f'),
                                     ('Arrival SoC', 'arrival_soc', '.4f'),
                                     ('Heating energy [Wh]', 'heating_energy_wh', '.1f'),
                                     ('Battery energy [Wh]', 'battery_energy_wh', '.1f'),
                                     ('First switch-on [s]', 'first_switch_on_s', '.0f'),
                                     ('Switch-ons', 'switch_ons', 'd'),
                                     ('Partial duty [s]', 'partial_duty_s', '.1f'),
                                     ('Refused inputs', 'refused_inputs', 'd'))])
