# SPDX-License-Identifier: Apache-2.0
"""`preheat prepare`: the preparations of a week without a planner, and departures that are skipped."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

from bev_preheat.commands.output import check_output_arguments, write_json
from bev_preheat.commands.program import FAILED
from bev_preheat.commands.situation import load_planned_vehicle
from bev_preheat.commands.terminal import print_records, result_console
from bev_preheat.control.departure_week import prepare_week
from bev_preheat.control.departures import dated_instant_ns, in_words, local
from bev_preheat.control.departures_file import load_departures, load_grid_prices
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import WH_PER_KWH
from bev_preheat.optional_packages import require_ros

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from datetime import tzinfo

    from bev_preheat.control.departure_week import PreparedDeparture

# Options that only this part of the subcommand reads.
OFFLINE = ('prices', 'vehicle', 'temperature', 'soc', 'since', 'json', 'plot')
# Options of a goal for a running planner.
OF_GOAL = ('at', 'minutes', 'target')


def add_departure_arguments(parser: ArgumentParser) -> None:
    """Add the options for departures."""
    skips = parser.add_mutually_exclusive_group()
    skips.add_argument('--skip-next', action='store_true',
                       help="skip the next departure of the planner's parameter departures; each call skips "
                       'one more')
    skips.add_argument('--skip-none', action='store_true', help='take back every skip')
    week = parser.add_argument_group('the preparations of a week, without a planner')
    week.add_argument('--departures', metavar='FILE', help='print the preparations of the departures in this file')
    week.add_argument('--prices', metavar='FILE', help='prices of energy from the grid')
    week.add_argument('--vehicle', metavar='NAME|FILE',
                      help='vehicle: a name in config/vehicles or a YAML file (default: reference)')
    week.add_argument('--temperature', type=float, metavar='DEGC', help='battery temperature when a preparation '
                      'may begin [degC] (default: the ambient temperature)')
    week.add_argument('--soc', type=float, metavar='0..1', help='state of charge then (default: 0.8)')
    week.add_argument('--from', dest='since', metavar='DATE', help='begin at this time, "YYYY-MM-DD HH:MM", local '
                      'or with an offset (default: now)')
    week.add_argument('--json', metavar='FILE', help='write the result as JSON; - is standard output, and tables '
                      'then go to standard error')
    week.add_argument('--plot', metavar='FILE', help='draw the week (PNG, SVG, PDF)')


def check_departure_arguments(arguments: Namespace) -> None:
    """Raise InvalidInput if options are combined that do not belong together."""
    if arguments.departures is None:
        for name in OFFLINE:
            if getattr(arguments, name) is not None:
                raise InvalidInput(f'--{"from" if name == "since" else name}: is for --departures only')
        return
    for name in OF_GOAL:
        if getattr(arguments, name) is not None:
            raise InvalidInput(f'--{"in" if name == "minutes" else name}: is not allowed with --departures')
    for name in ('plugged_in', 'skip_next', 'skip_none'):
        if getattr(arguments, name):
            raise InvalidInput(f'--{name.replace("_", "-")}: is not allowed with --departures')


def run_week(arguments: Namespace) -> int:
    """Print and draw the preparations of a week; return the exit status."""
    departures = load_departures(arguments.departures)
    prices = None if arguments.prices is None else load_grid_prices(arguments.prices)
    check_output_arguments(arguments, [path for path in (arguments.departures, arguments.prices) if path])
    vehicle = load_planned_vehicle(arguments.vehicle or 'reference')
    prepared = prepare_week(
        vehicle, departures, prices, _from_ns(arguments, departures.zone),
        0.8 if arguments.soc is None else arguments.soc, arguments.ambient, arguments.temperature)
    currency = '' if prices is None else prices.currency
    title = f'vehicle {vehicle.name}, departures of {os.path.basename(arguments.departures)}'
    if arguments.json:
        write_json(arguments.json, {'currency': currency, 'departures': [one.as_dictionary() for one in prepared]})
    if arguments.plot:
        from bev_preheat.drawing.departures_figure import draw_week
        draw_week(arguments.plot, prepared, prices, departures.zone, title)
    console = result_console(arguments.json)
    if not prepared:
        console.say('No departure within a week.')
        return 0
    unit = f' [{currency}]' if currency else ''
    print_records(
        console, title, ('departure', 'energy from', 'battery [degC]', 'heating', 'heater [kWh]', f'cost{unit}',
                         f'latest{unit}'), [_row(one, departures.zone) for one in prepared],
        ('left', 'left', 'right', 'left', 'right', 'right', 'right'))
    paid = [(one.cost, one.latest_cost) for one in prepared
            if one.cost is not None and one.latest_cost is not None]
    if paid:
        cost, latest = (sum(each) for each in zip(*paid))
        console.say(f'From the grid: {cost:.2f} {currency or "in total"}; heating as late as possible '
                    f'would cost {latest:.2f}.')
    return 0


def _from_ns(arguments: Namespace, zone: tzinfo) -> int:
    if arguments.since is None:
        return time.time_ns()
    try:
        return dated_instant_ns(arguments.since, zone)
    except InvalidInput as error:
        raise InvalidInput(f'--from: {error}') from error


def _row(one: PreparedDeparture, zone: tzinfo) -> tuple[str, ...]:
    departure, plan = one.occurrence.departure, one.plan
    heating = ', '.join(f'{local(begin, zone):%H:%M}-{local(end, zone):%H:%M}' for begin, end in one.heating_ns())
    return (f'{departure.name}, {in_words(one.occurrence.instant_ns, zone)}',
            'grid' if departure.is_plugged_in else 'battery',
            f'{plan.arrival_temperature_c:.1f} of {plan.target_temperature_c:.1f}', heating or 'none',
            f'{plan.energy_wh.hvch_electric / WH_PER_KWH:.2f}',
            '–' if one.cost is None else f'{one.cost:.2f}',
            '–' if one.latest_cost is None else f'{one.latest_cost:.2f}')


def run_skip(arguments: Namespace, planner: str) -> int:
    """Skip the next departure of a running planner, or none; return the exit status."""
    require_ros()
    from rclpy.exceptions import InvalidNamespaceException

    from bev_preheat.monitoring.departure_skip import skip_departure
    from bev_preheat.nodes.listening import listening
    try:
        with listening(f'prepare_{os.getpid()}', namespace=arguments.namespace) as listener:
            is_done, sentence = skip_departure(listener, planner, arguments.skip_next)
    except InvalidNamespaceException as error:
        raise InvalidInput(f'--namespace: {arguments.namespace!r}: {error}') from error
    result_console().say(sentence)
    return 0 if is_done else FAILED
