# SPDX-License-Identifier: Apache-2.0
"""`preheat route`: makes a route file from a description of a trip, from any route, or from drive logs."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
import shlex

import numpy as np

from bev_preheat.commands.parser import completed_by, given_options, option_group, option_of, Subparsers
from bev_preheat.commands.situation import (
    add_route_options,
    add_signal_arguments,
    add_vehicle_argument,
    in_steps,
    LESS_COMMON,
    ROUTE_OPTIONS,
    route_options,
)
from bev_preheat.commands.terminal import print_records, result_console
from bev_preheat.drawing.figure import save_figure
from bev_preheat.drawing.inputs_figure import make_route_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import AnyPath, check_outputs, expanded, OutputFile, PICTURE_SUFFIXES
from bev_preheat.identification.recorded_route import load_drive_logs
from bev_preheat.interface.inputs import route_or_log
from bev_preheat.numerics import FloatArray, JOULES_PER_WH
from bev_preheat.route import Route
from bev_preheat.route.csv_file import rounded, save_route
from bev_preheat.route.for_vehicle import ambient_of, LEGS_SUFFIXES
from bev_preheat.route.legs import legs_file, load_legs
from bev_preheat.route.road_load import compare_averages
from bev_preheat.route.sources.journey import ChargingStop, Journey
from bev_preheat.route.sources.registry import has_powers, read_journey
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.loading import load_vehicle, vehicle_file

DEFAULT_STEP_S = 30.0


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand to those of `preheat`."""
    parser = subparsers.add_parser(
        'route', help='make a route file from navigation, a drive cycle, a description of a trip or drive logs',
        description='Make a route file from any file with a route, from the legs of a road, or from drive logs.')
    source = parser.add_mutually_exclusive_group(required=True)
    completed_by('routes/legs', source.add_argument(
        '--legs', metavar='NAME|FILE',
        help='description of a trip: a name in config/routes/legs or a YAML file'))
    source.add_argument('--from', dest='source', metavar='FILE',
                        help='file with a route, of any format; recognised by its content')
    source.add_argument('--log', action='extend', nargs='+', metavar='FILE',
                        help='drive logs, joined in this order')
    parser.add_argument('--output', required=True, metavar='FILE',
                        help='route file to write (CSV)')
    add_vehicle_argument(parser, 'the car that drives; with --log: for its auxiliary power;')
    add_route_options(parser)
    parser.add_argument('--plot', metavar='FILE',
                        help='draw speed, power and ambient temperature (PNG, PDF, SVG)')
    parser.add_argument('--step', type=float, metavar='SECONDS',
                        help=f'duration of a segment (default {DEFAULT_STEP_S:g})')
    add_signal_arguments(option_group(parser, 'drive logs'))
    option_group(parser, LESS_COMMON).add_argument(
        '--averages', type=float, action='extend', nargs='+', metavar='SECONDS',
        help='of a drive cycle: compare its energy with that of mean speeds over these durations')
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Make the route file, print a summary, and return the exit status."""
    vehicle = load_vehicle(arguments.vehicle)
    name, route, remarks, inputs, stops = _load(arguments, vehicle)
    check_outputs([OutputFile('--output', arguments.output),
                   OutputFile('--plot', arguments.plot, PICTURE_SUFFIXES)],
                  [vehicle_file(arguments.vehicle), *inputs])
    comparison = _comparison(arguments, vehicle) if arguments.averages else []
    route = rounded(route)
    comments = [f'Route {name}, made by:', f'    {_command(arguments)}', *remarks]
    save_route(arguments.output, route, comments, made_for=vehicle.name, stops=stops)
    console = result_console(soft_wrap=True)
    print_records(console, f'Route {name}', ('quantity', 'value'), _summary(route), ('left', 'right'))
    console.say(*(f'note: {remark}' for remark in remarks))
    console.say(f'written: {arguments.output}')
    if comparison:
        print_records(console, 'Propulsion from mean speeds, against the samples', (
            'means over', 'energy', 'deviation', 'without accelerations', 'mean magnitude', 'root mean square'),
            comparison, ['right'] * 6)
    if arguments.plot:
        save_figure(make_route_figure(name, route), arguments.plot)
        console.say(f'drawn: {arguments.plot}')
    return 0


def _load(arguments: Namespace,
          vehicle: Vehicle) -> tuple[str, Route, Sequence[str], Sequence[AnyPath], Sequence[ChargingStop]]:
    """Return name, Route and remarks for the arguments, the files that were read, and the charging stops."""
    if arguments.log is None and (arguments.signals is not None or arguments.repair):
        raise InvalidInput('--signals and --repair: only with --log')
    if arguments.legs:
        _refuse_route_options(arguments)
        if arguments.step is not None:
            raise InvalidInput('--step: not allowed with --legs, whose file states segment_duration_s')
        made = load_legs(arguments.legs, vehicle)
        return made.name, made.route, made.remarks, [legs_file(arguments.legs)], ()
    if arguments.source:
        return _driven(arguments, vehicle)
    _refuse_route_options(arguments)
    step_s = DEFAULT_STEP_S if arguments.step is None else arguments.step
    logs = [expanded(path) for path in arguments.log]
    logged = load_drive_logs(logs, vehicle.defaults, step_s, arguments.signals, arguments.repair)
    return ' + '.join(Path(path).stem for path in logs), logged.route, logged.remarks, logs, ()


def _refuse_route_options(arguments: Namespace) -> None:
    """Raise InvalidInput if an option for --from is given without it."""
    given = given_options(arguments, (*ROUTE_OPTIONS, 'averages'))
    if given:
        raise InvalidInput(f'{", ".join(given)}: only with --from; descriptions of legs and drive logs have their '
                           'own temperatures and times')


def _driven(arguments: Namespace,
            vehicle: Vehicle) -> tuple[str, Route, Sequence[str], Sequence[AnyPath], Sequence[ChargingStop]]:
    path = expanded(arguments.source)
    if Path(path).suffix.lower() in LEGS_SUFFIXES:
        raise InvalidInput(f'--from {arguments.source}: is a description of legs; use --legs {arguments.source}')
    loaded = route_or_log(path if '/' in path else f'./{path}', vehicle, route_options(arguments))
    if has_powers(loaded.file):
        raise InvalidInput(f'--from {arguments.source}: is a route file with powers already; use it as it is: '
                           f'--route {arguments.source}')
    if arguments.step is not None and loaded.stops:
        raise InvalidInput('--step: not for a route with charging stops, which lie between its segments')
    route = loaded.route if arguments.step is None else in_steps(loaded.route, arguments)
    return Path(path).stem, route, loaded.remarks, [loaded.file], loaded.stops


def _command(arguments: Namespace) -> str:
    words = ['preheat', 'route']
    for name in ('legs', 'from', 'log', 'signals', 'vehicle', *ROUTE_OPTIONS, 'step', 'output'):
        value = getattr(arguments, 'source' if name == 'from' else name)
        if value is not None:
            words += [option_of(name), *map(str, value if isinstance(value, list) else [value])]
    return shlex.join([*words, '--repair'] if arguments.repair else words)


def _comparison(arguments: Namespace, vehicle: Vehicle) -> list[tuple[str, ...]]:
    """Return the rows that compare a drive cycle with the estimate from its mean speeds."""
    options = route_options(arguments)
    path = Path(expanded(arguments.source))
    journey = read_journey(path, options)
    assert isinstance(journey, Journey)
    ambient_c = ambient_of(journey, options, path)
    rows: list[tuple[str, ...]] = []
    for step_s in arguments.averages:
        exact, estimated, plain = compare_averages(journey.motion, vehicle, ambient_c, step_s)
        if not rows:
            rows.append(('samples', f'{exact.energy_wh:.0f} Wh', '', '', f'{exact.magnitude_w / 1e3:.2f} kW',
                         f'{exact.rms_w / 1e3:.2f} kW'))
        rows.append((
            f'{step_s:g} s', f'{estimated.energy_wh:.0f} Wh', _deviation(estimated.energy_wh, exact.energy_wh),
            _deviation(plain.energy_wh, exact.energy_wh), _deviation(estimated.magnitude_w, exact.magnitude_w),
            _deviation(estimated.rms_w, exact.rms_w)))
    return rows


def _deviation(value: float, true: float) -> str:
    return f'{100.0 * (value / true - 1.0):+.1f} %' if true else '-'


def _summary(route: Route) -> list[tuple[str, str]]:
    duration_s, power_w = route.duration_s, route.propulsion_power_w
    total_s = route.total_duration_s
    energy_wh = power_w * duration_s / JOULES_PER_WH
    rms_w = np.sqrt(route.propulsion_power_rms_w**2 @ duration_s / total_s)
    ambient_c = route.ambient_temperature_c
    return [
        ('segments', f'{len(route)}'),
        ('duration', f'{total_s / 60.0:.1f} min'),
        ('distance', f'{route.distance_m / 1000.0:.2f} km'),
        ('mean speed', f'{3.6 * route.distance_m / total_s:.1f} km/h'),
        ('propulsion power, mean', f'{power_w @ duration_s / total_s / 1000.0:.2f} kW'),
        ('propulsion power, root mean square', f'{rms_w / 1000.0:.2f} kW'),
        ('propulsion power, segments from', f'{power_w.min() / 1000.0:.1f} kW'),
        ('propulsion power, segments to', f'{power_w.max() / 1000.0:.1f} kW'),
        ('energy of driving segments', f'{energy_wh[energy_wh > 0.0].sum():.0f} Wh'),
        ('energy of regenerating segments', f'{energy_wh[energy_wh < 0.0].sum():.0f} Wh'),
        ('cabin heating', _energy(route.cabin_heating_power_w, duration_s)),
        ('auxiliaries', _energy(route.auxiliary_power_w, duration_s)),
        ('ambient temperature', f'{ambient_c.min():.1f} ... {ambient_c.max():.1f} degC')]


def _energy(power_w: FloatArray, duration_s: FloatArray) -> str:
    return f'{power_w @ duration_s / JOULES_PER_WH:.0f} Wh'
