# SPDX-License-Identifier: Apache-2.0
"""`preheat prepare`: asks a running planner for a warm battery by an instant; a week of departures without one."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from datetime import datetime, timedelta, tzinfo
from functools import partial
import math
import os
import re
import signal
import time
from types import FrameType
from typing import TYPE_CHECKING

from bev_preheat.commands.output import add_json_argument, check_output_arguments, write_results
from bev_preheat.commands.parser import given_options, Subparsers
from bev_preheat.commands.program import FAILED, INTERRUPTED, say
from bev_preheat.commands.situation import load_planned_vehicle
from bev_preheat.commands.terminal import print_records, progress_bar, result_console
from bev_preheat.control.departures import (
    CLOCK,
    dated_instant_ns,
    in_words,
    load_departures,
    load_grid_prices,
    local,
)
from bev_preheat.control.preparation import prepare_week, PreparedDeparture
from bev_preheat.drawing.drive_figure import make_week_figure
from bev_preheat.errors import InvalidInput, located, quoted
from bev_preheat.numerics import WH_PER_KWH
from bev_preheat.optional_packages import require_ros
from bev_preheat.planning.explanation import OF_GOAL as WORDS_OF_GOAL
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K

if TYPE_CHECKING:
    from bev_preheat.control.preparation_goal import PreparationGoal
    from bev_preheat.monitoring.planner_client import PreparationClient
    from bev_preheat_msgs.action import PrepareBattery

NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')
LONGEST_MIN = 24 * 60.0
# A closed terminal ends the command like Ctrl-C.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# The table counts no time until the departure, as a goal does.
OF_DEPARTURE = WORDS_OF_GOAL._replace(arrival='the battery leaves at {temperature} degC')
# Options that only this part of the subcommand reads.
OFFLINE = ('prices', 'vehicle', 'temperature', 'soc', 'from', 'json', 'plot')
# Options of a goal for a running planner, and all for one.
OF_GOAL = ('at', 'in', 'target', 'max_arrival_temperature', 'plugged_in')
SKIPS = ('skip_next', 'skip_none')
OF_PLANNER = (*OF_GOAL, *SKIPS, 'namespace', 'node')


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'prepare', help='ask a running planner to warm the battery by an instant',
        description='Ask a running planner for a warm battery at an instant, or as soon as possible, and show the '
        'progress; Ctrl-C cancels. Exit status: 0 if the battery got warm, 1 if it did not, 2 if the goal was '
        'refused or no planner answers. With --departures: print the preparations of a week, without a planner.')
    when = parser.add_mutually_exclusive_group()
    when.add_argument('--at', metavar='HH:MM', help='when the battery must be warm, by the clock of this computer '
                      '(default: as soon as possible)')
    when.add_argument('--in', type=float, metavar='MINUTES', help='the same, in minutes from now')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature [degC] (default: the planner's)")
    parser.add_argument('--max-arrival-temperature', type=float, metavar='DEGC',
                        help='highest battery temperature then [degC] (default: any)')
    parser.add_argument('--ambient', type=float, metavar='DEGC', help='ambient temperature until then [degC] '
                        '(default: that of the route, or the last known)')
    parser.add_argument('--plugged-in', action='store_true',
                        help='the vehicle stands, and the grid supplies the heater')
    parser.add_argument('--namespace', help='namespace of the planner (default: /)')
    parser.add_argument('--node', metavar='NAME', help='node name of the planner (default: planner)')
    add_departure_arguments(parser)
    parser.set_defaults(run=run)


class EndSignals:
    """Whether SIGINT, SIGTERM or SIGHUP has come within the block; a second one raises KeyboardInterrupt."""

    have_come = False

    def __enter__(self) -> EndSignals:
        self._before = {number: signal.signal(number, self._hear) for number in END_SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if self.have_come:
            # A blocked output must end, too.
            raise KeyboardInterrupt
        self.have_come = True


def seconds_until(clock: str, now: datetime) -> float:
    """Return the seconds from now until the clock shows HH:MM next; raise InvalidInput."""
    match = CLOCK.fullmatch(clock)
    if match is None:
        raise InvalidInput(f'--at: {quoted(clock)} is not allowed; it must be HH:MM, 0:00 ... 23:59')
    then = now.replace(hour=int(match[1]), minute=int(match[2]), second=0, microsecond=0)
    if then <= now:
        then += timedelta(days=1)
    return (then - now).total_seconds()


def run(arguments: Namespace) -> int:
    """Send the goal and follow its progress; returns the exit status."""
    check_departure_arguments(arguments)
    if arguments.departures is not None:
        return run_week(arguments)
    node, namespace = 'planner' if arguments.node is None else arguments.node, arguments.namespace or '/'
    if NAME.fullmatch(node) is None:
        raise InvalidInput(f'--node: {quoted(node)} is not allowed; it must be letters, digits and '
                           '_, no digit first')
    minutes = getattr(arguments, 'in')
    if minutes is not None and not 0.0 < minutes <= LONGEST_MIN:
        raise InvalidInput(f'--in: {minutes:g} is not allowed; it must be above 0 and at most {LONGEST_MIN:g} min')
    # A message has NaN for "not given".
    if arguments.max_arrival_temperature is not None and math.isnan(arguments.max_arrival_temperature):
        raise InvalidInput('--max-arrival-temperature: nan is not allowed; it must be a number')
    ready_in_s = (seconds_until(arguments.at, datetime.now()) if arguments.at is not None
                  else None if minutes is None else 60.0 * minutes)
    require_ros()
    try:
        # Handle signals from here on, because importing ROS is slow, too.
        with EndSignals() as signals:
            from bev_preheat.control.preparation_goal import PreparationGoal
            from bev_preheat.monitoring.planner_client import PreparationClient, skip_departure
            from bev_preheat.nodes.listening import listening
            prefix = namespace.strip('/')
            planner = f'/{prefix}/{node}' if prefix else f'/{node}'
            with listening(f'prepare_{os.getpid()}', namespace=namespace) as listener:
                if arguments.skip_next or arguments.skip_none:
                    is_done, sentence = skip_departure(listener, planner, arguments.skip_next)
                    result_console().say(sentence)
                    return 0 if is_done else FAILED
                return _pursue(PreparationClient(listener, planner, lambda: signals.have_come), PreparationGoal(
                    target_c=arguments.target, is_plugged_in=arguments.plugged_in, ambient_c=arguments.ambient,
                    maximum_arrival_temperature_c=arguments.max_arrival_temperature), ready_in_s)
    except KeyboardInterrupt:
        # A second signal: do not wait for the planner's answer.
        return INTERRUPTED


def _pursue(client: PreparationClient, goal: PreparationGoal, ready_in_s: float | None) -> int:
    from rich.progress import BarColumn, TextColumn

    from bev_preheat.control.preparation_goal import PreparationEnding
    from bev_preheat.monitoring.planner_client import feedback_line
    if not client.send(goal, ready_in_s):
        say('preheat: interrupted')
        return INTERRUPTED
    console = result_console()
    told, is_cancelled = None, False
    with progress_bar(TextColumn('{task.description}'), BarColumn()) as progress:
        task = progress.add_task('waiting for the planner', total=1.0)

        def show(feedback: PrepareBattery.Feedback) -> None:
            nonlocal told
            line = feedback_line(feedback)
            first_c = progress.tasks[0].fields.setdefault('first_c', feedback.battery_temperature)
            rise_k = feedback.predicted_battery_temperature - first_c
            progress.update(task, description=line, completed=min(max(
                (feedback.battery_temperature - first_c) / rise_k, 0.0), 1.0) if rise_k > 0.0 else 0.0)
            if feedback.status != told and not console.is_interactive:
                told = feedback.status
                console.say(line)

        result = client.follow(show)
        if result is None:
            is_cancelled = client.cancel()
    if result is None:
        say('preheat: interrupted; the goal is cancelled and its heating off' if is_cancelled else
            'preheat: interrupted; the planner has not confirmed that the goal is cancelled')
        return INTERRUPTED
    if result.code == PreparationEnding.REFUSED:
        raise InvalidInput(result.explanation.removesuffix('.'))
    console.say(result.explanation)
    return 0 if result.reached else FAILED


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
    week.add_argument('--from', metavar='DATE', help='begin at this time, "YYYY-MM-DD HH:MM", local '
                      'or with an offset (default: now)')
    add_json_argument(week)
    week.add_argument('--plot', metavar='FILE', help='draw the week (PNG, SVG, PDF)')


def check_departure_arguments(arguments: Namespace) -> None:
    """Raise InvalidInput if options are combined that do not belong together."""
    if arguments.departures is None:
        for option in given_options(arguments, OFFLINE):
            raise InvalidInput(f'{option}: is for --departures only')
        for skip in given_options(arguments, SKIPS):
            for option in given_options(arguments, (*OF_GOAL, 'ambient')):
                raise InvalidInput(f'{option}: is not allowed with {skip}')
        return
    for option in given_options(arguments, OF_PLANNER):
        raise InvalidInput(f'{option}: is not allowed with --departures')


def run_week(arguments: Namespace) -> int:
    """Print and draw the preparations of a week; return the exit status."""
    departures = load_departures(arguments.departures)
    prices = None if arguments.prices is None else load_grid_prices(arguments.prices)
    check_output_arguments(arguments, [path for path in (arguments.departures, arguments.prices) if path])
    vehicle = load_planned_vehicle(arguments.vehicle or 'reference')
    prepared = prepare_week(
        vehicle, departures, prices, _from_ns(getattr(arguments, 'from'), departures.zone),
        0.8 if arguments.soc is None else arguments.soc, arguments.ambient, arguments.temperature)
    currency = '' if prices is None else prices.currency
    title = f'vehicle {vehicle.name}, departures of {os.path.basename(arguments.departures)}'
    console = write_results(arguments, lambda: {
        'currency': currency, 'departures': [one.as_dictionary() for one in prepared]},
        lambda: make_week_figure(prepared, prices, departures.zone, title))
    if not prepared:
        console.say('No departure within a week.')
        return 0
    unit = f' [{currency}]' if currency else ''
    print_records(
        console, title, ('departure', 'energy from', 'battery [degC]', 'heating', 'heater [kWh]', f'cost{unit}',
                         f'latest{unit}'), [_row(one, departures.zone) for one in prepared],
        ('left', 'left', 'right', 'left', 'right', 'right', 'right'))
    # The table has no column for cooling.
    told = {one.occurrence.departure.name: one.plan for one in reversed(prepared)
            if one.plan.shortfall_k > SHORTFALL_TOLERANCE_K or one.plan.cooling_start_s is not None}
    console.say(*(f'{name}: {plan.sentence(plan, words=OF_DEPARTURE)}' for name, plan in sorted(told.items())))
    without = sum(one.occurrence.departure.is_plugged_in and one.cost is None for one in prepared)
    if prices is not None and without:
        console.say(f'note: {arguments.prices}: has no prices for {without} of {len(prepared)} preparations')
    paid = [(one.cost, one.latest_cost) for one in prepared
            if one.cost is not None and one.latest_cost is not None]
    if paid:
        cost, latest = (sum(each) for each in zip(*paid))
        console.say(f'From the grid: {cost:.2f} {currency or "in total"}; heating as late as possible '
                    f'would cost {latest:.2f}.')
    return 0


def _from_ns(text: str | None, zone: tzinfo) -> int:
    with located('--from'):
        return time.time_ns() if text is None else dated_instant_ns(text, zone)


def _row(one: PreparedDeparture, zone: tzinfo) -> tuple[str, ...]:
    departure, plan = one.occurrence.departure, one.plan
    # The clock changes within some intervals.
    heating = ', '.join(f'{begin:%H:%M}-{end:%H:%M}' if begin.tzname() == end.tzname() else
                        f'{begin:%H:%M %Z}-{end:%H:%M %Z}'
                        for begin, end in (map(partial(local, zone=zone), each) for each in one.heating_ns()))
    return (f'{departure.name}, {in_words(one.occurrence.instant_ns, zone)}',
            'grid' if departure.is_plugged_in else 'battery',
            f'{plan.arrival_temperature_c:.1f} of {plan.target_temperature_c:.1f}', heating or 'none',
            f'{plan.energy_wh.hvch_electric / WH_PER_KWH:.2f}',
            '–' if one.cost is None else f'{one.cost:.2f}',
            '–' if one.latest_cost is None else f'{one.latest_cost:.2f}')
