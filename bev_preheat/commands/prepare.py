# SPDX-License-Identifier: Apache-2.0
"""`preheat prepare`: asks a running planner to warm the battery by an instant, with or without a route."""

from __future__ import annotations

from datetime import datetime, timedelta
import os
import re
from typing import TYPE_CHECKING

from bev_preheat.commands.departures import (
    add_departure_arguments,
    check_departure_arguments,
    run_skip,
    run_week,
)
from bev_preheat.commands.program import FAILED, INTERRUPTED, say
from bev_preheat.control.departures import CLOCK
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.optional_packages import require_ros

if TYPE_CHECKING:
    from argparse import Namespace

    from bev_preheat.commands.arguments import Subparsers
    from bev_preheat.monitoring.preparation import PreparationClient, Wanted
    from bev_preheat_msgs.action import PrepareBattery

NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')
LONGEST_MIN = 24 * 60.0


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
    when.add_argument('--in', dest='minutes', type=float, metavar='MINUTES', help='the same, in minutes from now')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature [degC] (default: the planner's)")
    parser.add_argument('--ambient', type=float, metavar='DEGC', help='ambient temperature until then [degC] '
                        '(default: that of the route, or the last known)')
    parser.add_argument('--plugged-in', action='store_true',
                        help='the vehicle stands, and the grid supplies the heater')
    parser.add_argument('--namespace', default='/', help='namespace of the planner (default: %(default)s)')
    parser.add_argument('--node', default='planner', metavar='NAME',
                        help='node name of the planner (default: %(default)s)')
    add_departure_arguments(parser)
    parser.set_defaults(run=run)


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
    if NAME.fullmatch(arguments.node) is None:
        raise InvalidInput(f'--node: {quoted(arguments.node)} is not allowed; it must be letters, digits and '
                           '_, no digit first')
    minutes = arguments.minutes
    if minutes is not None and not 0.0 < minutes <= LONGEST_MIN:
        raise InvalidInput(f'--in: {minutes:g} is not allowed; it must be above 0 and at most '
                           f'{LONGEST_MIN:g} min')
    ready_in_s = (seconds_until(arguments.at, datetime.now()) if arguments.at is not None
                  else None if minutes is None else 60.0 * minutes)
    prefix = arguments.namespace.strip('/')
    planner = f'/{prefix}/{arguments.node}' if prefix else f'/{arguments.node}'
    if arguments.skip_next or arguments.skip_none:
        return run_skip(arguments, planner)
    require_ros()
    from bev_preheat.monitoring.end_signals import end_signals
    try:
        # Handle signals from here on, because importing ROS is slow, too.
        with end_signals() as signals:
            from rclpy.exceptions import InvalidNamespaceException

            from bev_preheat.monitoring.preparation import PreparationClient, Wanted
            from bev_preheat.nodes.listening import listening
            try:
                with listening(f'prepare_{os.getpid()}', namespace=arguments.namespace) as listener:
                    return _pursue(PreparationClient(listener, planner, signals), Wanted(
                        ready_in_s, arguments.target, arguments.ambient, arguments.plugged_in))
            except InvalidNamespaceException as error:
                raise InvalidInput(f'--namespace: {arguments.namespace!r}: {error}') from error
    except KeyboardInterrupt:
        # A second signal: do not wait for the planner's answer.
        return INTERRUPTED


def _pursue(client: PreparationClient, wanted: Wanted) -> int:
    from rich.progress import BarColumn, TextColumn

    from bev_preheat.commands.terminal import progress_bar, result_console
    from bev_preheat.control.preparation_goal import PreparationEnding
    from bev_preheat.monitoring.preparation import feedback_line
    if not client.send(wanted):
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
