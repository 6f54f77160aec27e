# SPDX-License-Identifier: Apache-2.0
"""`preheat replay`: a recording put through the planner's step again."""

from __future__ import annotations

from datetime import datetime, time, UTC
import json
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.commands.completion import completed_by, VEHICLES
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.terminal import print_figures, print_records, progress_bar, result_console
from bev_preheat.control.settings import FIELD_OF_PARAMETER
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.output_files import check_outputs
from bev_preheat.optional_packages import require, require_ros
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from argparse import Namespace

    from rich.console import Console

    from bev_preheat.commands.arguments import Subparsers
    from bev_preheat.replay.course import Course
    from bev_preheat.replay.flight_file import Flight
    from bev_preheat.replay.player import Changes
    from bev_preheat.replay.what_if import Replayed

DIFFERENT = 1
NS_PER_S = 1_000_000_000
NS_PER_DAY = 86400 * NS_PER_S


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'replay', help='put a recording through the planner again, as it was or with changes',
        description="Put a recording of the flight recorder through the planner's step again, and compare each "
        'command with the recorded one: exit status 0 if all are the same, 1 if one differs, 2 if the recording '
        'is refused. '
        'With changes (--vehicle, --method, --set) the changed drive stands beside the recorded one.')
    parser.add_argument('recording', metavar='RECORDING',
                        help='a file of the flight recorder, or its folder: then the latest drive of the planner')
    completed_by(VEHICLES, parser.add_argument(
        '--vehicle', metavar='NAME|FILE', help='change: another vehicle file'))
    parser.add_argument('--method', metavar='NAME', help='change: another planning method')
    parser.add_argument('--set', metavar='PARAMETER=VALUE', action='append', default=[], dest='parameters',
                        help="change: another value of a planner's parameter; may be repeated")
    parser.add_argument('--explain', metavar='T',
                        help='why the planner gave its command at T: seconds from the start of the recording, or '
                        'HH:MM:SS (UTC)')
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Replay, print and write the result; returns the exit status."""
    require_ros()
    require('mcap')
    check_outputs([json_output(arguments.json)], (arguments.recording,))
    changes = changes_of(arguments)
    from bev_preheat.replay.flight_file import read_flight
    from bev_preheat.replay.what_if import replay, replay_changed
    flight = read_flight(arguments.recording)
    if not flight.given:
        raise InvalidInput(f'{arguments.recording}: has no step of the planner')
    if arguments.explain is not None:
        return run_explanation(arguments, flight, changes)
    with progress_bar() as bar:
        task = bar.add_task('replaying', total=len(flight.given) * (1 if changes.is_nothing else 2))
        replayed = replay(flight, lambda steps: bar.update(task, completed=steps))
        changed = None if changes.is_nothing else replay_changed(
            flight, changes, lambda steps: bar.update(task, completed=len(flight.given) + steps))
    if arguments.json:
        write_json(arguments.json, as_dictionary(replayed, changed, flight.remarks))
    console = result_console(arguments.json)
    for remark in flight.remarks:
        console.print(f'note: {remark}', markup=False, soft_wrap=True)
    print_courses(console, replayed.course, changed)
    return print_comparison(console, replayed) if changed is None else 0


def run_explanation(arguments: Namespace, flight: Flight, changes: Changes) -> int:
    """Print why the planner gave its command at an instant; returns the exit status."""
    if not changes.is_nothing:
        raise InvalidInput('--explain: is for the recording as it was, without --vehicle, --method and --set')
    from bev_preheat.replay.explanation import explain
    why = explain(flight, instant_of(arguments.explain, flight.given[0].step.now_ns))
    if arguments.json:
        write_json(arguments.json, {
            'now_ns': why.now_ns, 'answer': why.answer,
            'sections': {section.heading: [list(row) for row in section.rows] for section in why.sections}})
    console = result_console(arguments.json)
    console.print(f'{moment(why.now_ns)}: {why.answer}', markup=False, soft_wrap=True)
    for section in why.sections:
        if section.rows:
            print_records(console, section.heading, ('', ''), section.rows)
    return 0


def instant_of(text: str, start_ns: int) -> int:
    """Return the instant [ns] of seconds from the start or of a time of day; raises InvalidInput."""
    try:
        if ':' not in text:
            return start_ns + round(float(text) * NS_PER_S)
        start = datetime.fromtimestamp(start_ns / NS_PER_S, UTC)
        at = datetime.combine(start.date(), time.fromisoformat(text), UTC)
        # A recording may go past midnight.
        at_ns = round(at.timestamp() * NS_PER_S)
        return at_ns if at_ns >= start_ns - NS_PER_S else at_ns + NS_PER_DAY
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f'--explain: {quoted(text)} is not allowed; it must be seconds from the start of the '
                           'recording, or HH:MM:SS') from error


def changes_of(arguments: Namespace) -> Changes:
    """Return the Changes of the command line; raises InvalidInput if a parameter is unknown or not a value."""
    from bev_preheat.replay.player import Changes
    parameters: dict[str, Any] = {}
    for text in arguments.parameters:
        name, sign, value = text.partition('=')
        if not sign or name not in FIELD_OF_PARAMETER:
            raise InvalidInput(f'--set: {quoted(text)} is not allowed; it must be PARAMETER=VALUE, with a '
                               f'parameter of {", ".join(FIELD_OF_PARAMETER)}')
        parameters[name] = _value(name, value)
    if arguments.method is not None:
        parameters['method'] = _value('method', arguments.method)
    return Changes(arguments.vehicle, parameters)


def _value(name: str, text: str) -> Any:
    from bev_preheat.nodes.parameters import check, IN_WORDS
    from bev_preheat.nodes.planner_node import PARAMETERS
    [parameter] = [each for each in PARAMETERS if each.name == name]
    kind = type(parameter.default)
    try:
        value = text if kind is str else float(text) if kind is float else json.loads(text)
    except ValueError:
        value = None
    if not isinstance(value, kind):
        raise InvalidInput(f'--set: {name}: {quoted(text)} is not allowed; it must be {IN_WORDS[kind]}')
    check([parameter], {name: value})
    return value


def as_dictionary(replayed: Replayed, changed: Course | None, remarks: tuple[str, ...]) -> dict[str, Any]:
    """Return the result for JSON."""
    comparison = replayed.comparison
    first = comparison.first
    return {
        'reproduced': comparison.is_reproduced, 'commands': comparison.commands, 'different': comparison.different,
        'largest_difference_w': comparison.largest_w,
        'first_difference': None if first is None else first._asdict(),
        'remarks': list(remarks), 'recorded': replayed.course.as_dictionary(),
        'changed': None if changed is None else changed.as_dictionary()}


def print_courses(console: Console, recorded: Course, changed: Course | None) -> None:
    """Print the figures of one or two Courses side by side."""
    courses = [recorded] if changed is None else [recorded, changed]
    start_ns = recorded.instants[0].now_ns
    rows = [
        ['begins', *(moment(course.instants[0].now_ns) for course in courses)],
        ['length', *(duration_text((course.instants[-1].now_ns - start_ns) / NS_PER_S) for course in courses)],
        ['heating begins after', *('never' if not course.heating else duration_text(
            (course.heating[0][0] - start_ns) / NS_PER_S) for course in courses)],
        ['switch-ons', *(str(len(course.heating)) for course in courses)],
        ['HVCH electric [Wh]', *(f'{course.energy_wh:.1f}' for course in courses)],
        ['arrival after', *('not in the recording' if course.arrival is None else duration_text(
            (course.arrival.now_ns - start_ns) / NS_PER_S) for course in courses)],
        ['arrival temp. [degC]', *(_arrival_text(course) for course in courses)],
        ['last prediction [degC]', *('none' if course.latest_prediction is None else
                                     f'{course.latest_prediction.predicted_c:.2f}' for course in courses)],
        ['last status', *(course.said[-1].status.name for course in courses)]]
    print_figures(console, None, ['', 'recorded', 'changed'][:len(courses) + 1], rows)


def _arrival_text(course: Course) -> str:
    arrival = course.arrival
    known = arrival is not None and not math.isnan(arrival.measured_c)
    return f'{arrival.measured_c:.2f}' if arrival is not None and known else 'not in the recording'


def print_comparison(console: Console, replayed: Replayed) -> int:
    """Print whether the recorded commands are reproduced; returns the exit status."""
    comparison, first = replayed.comparison, replayed.comparison.first
    if comparison.commands == 0:
        console.print('the recording has no command', markup=False)
        return DIFFERENT
    if first is None:
        console.print(f'reproduced: {comparison.commands} commands, each to the last digit', markup=False,
                      soft_wrap=True)
        return 0
    console.print(
        f'not reproduced: {comparison.different} of {comparison.commands} commands differ, by at most '
        f'{comparison.largest_w:.1f} W; the first at {moment(first.now_ns)}: recorded {first.recorded}, replayed '
        f'{first.replayed}', markup=False, soft_wrap=True)
    return DIFFERENT


def moment(now_ns: int) -> str:
    """Return an instant [ns] in words."""
    return datetime.fromtimestamp(now_ns / NS_PER_S, UTC).strftime('%Y-%m-%d %H:%M:%S UTC')
