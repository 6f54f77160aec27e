# SPDX-License-Identifier: Apache-2.0
"""`preheat replay`: a recording put through the planner's step again."""

from __future__ import annotations

from argparse import Namespace
from difflib import get_close_matches
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from bev_preheat.commands.output import add_json_argument, json_output, write_json
from bev_preheat.commands.parser import completed_by, option_group, Subparsers
from bev_preheat.commands.terminal import print_records, progress_bar, result_console
from bev_preheat.control.settings import FIELD_OF_PARAMETER
from bev_preheat.errors import InvalidInput, located, quoted
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile, write_whole
from bev_preheat.optional_packages import require, require_ros
from bev_preheat.recording.changes import (
    ALIASES,
    Changes,
    keys_of_text,
    signal_change,
    SignalChange,
    SIGNALS,
    UNITS,
)

if TYPE_CHECKING:
    from bev_preheat.commands.replay_output import Result
    from bev_preheat.recording.flight import Flight, Period
    from bev_preheat.recording.history import History

DIFFERENT = 1
VEHICLE = 'vehicle'
# Parameters that no step reads: changed, they change nothing.
UNREAD = {'command_period': 'the steps are at the recorded instants',
          'compiled_core': 'plans are the same with the core and without'}


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'replay', help='put a recording through the planner again, as it was or with changes',
        description='Replay a recording and compare each command: exit status 0 if all are the same, 1 if one '
        'differs, 2 if the recording is refused. With changes (--change, --vehicle, --method, --set) the changed '
        'drive stands beside the recorded one. For ros2 bag and logs, --vehicle, --method and --set describe the '
        'planner, and --change alone is a change.')
    parser.add_argument('recording', metavar='RECORDING',
                        help='a file of the flight recorder; its folder, for the latest drive; a recording of '
                        'ros2 bag (MCAP, SQLite); or a log, with --route')
    parser.add_argument('--explain', metavar='T', help='why the planner gave its command at T')
    parser.add_argument('--from', metavar='T', dest='begin',
                        help='compare and show from T on: seconds from the start, or HH:MM:SS (UTC)')
    parser.add_argument('--to', metavar='T', dest='end', help='end at T')
    parser.add_argument('--report', metavar='OUT.html',
                        help='page to write, one self-contained file with curves to zoom into')
    add_json_argument(parser)
    changes = option_group(parser, 'changes')
    changes.add_argument('--change', metavar='WHAT=VALUE', action='append', default=[], dest='changes',
                         help='a signal (target=30, temperature=+2, soc=*0.98, current=none, '
                         'ambient_temperature=-5: 5 K colder, ambient_temperature==-5: -5 degC), vehicle=FILE, a '
                         'key of the vehicle file (hvch.maximum_power_w=5000), or a parameter; may be repeated')
    completed_by('vehicles', changes.add_argument(
        '--vehicle', metavar='NAME|FILE', help='another vehicle file'))
    changes.add_argument('--method', metavar='NAME', help='another planning method')
    changes.add_argument('--set', metavar='PARAMETER=VALUE', action='append', default=[], dest='parameters',
                         help="another value of a planner's parameter; may be repeated")
    others = option_group(parser, 'logs and recordings of ros2 bag')
    others.add_argument('--route', metavar='NAME|FILE', help='route of a log: a file of any format')
    completed_by('signals', others.add_argument(
        '--signals', metavar='NAME|FILE', help='signal map of a log (default: the map that recognises it)'))
    others.add_argument('--namespace', metavar='NAME', help='planner of a ros2 bag with several')
    expected = option_group(parser, 'expected figures')
    expected.add_argument('--expect', metavar='EXPECTED.json',
                          help='compare with these figures: exit status 1 if one deviates')
    expected.add_argument('--write-expected', metavar='EXPECTED.json',
                          help='write the figures of this replay, with usual tolerances, for --expect')
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Replay, print and write the result; returns the exit status."""
    require_ros()
    require('mcap')
    if arguments.report is not None:
        require('jinja2')
    outputs = [json_output(arguments.json), OutputFile('--report', arguments.report, ('.html',)),
               OutputFile('--write-expected', arguments.write_expected, ('.json',))]
    path = Path(expanded(arguments.recording))
    inputs = [path, *([] if arguments.expect is None else [arguments.expect])]
    check_outputs(outputs, inputs)
    expected = None
    if arguments.expect is not None:
        from bev_preheat.recording.comparison import load_expectation
        expected = load_expectation(arguments.expect)
    flight, changes = read(path, arguments)
    if not flight.given:
        raise InvalidInput(f'{path}: has no step of the planner')
    if arguments.explain is not None:
        return run_explanation(arguments, flight, changes)
    from bev_preheat.commands import replay_output
    from bev_preheat.recording.flight import period_of
    period = period_of(flight, arguments.begin, arguments.end)
    if changes.is_nothing:
        flight = flight.from_instant(period.from_ns)
    result, histories = replayed(flight, changes, period, arguments.report is not None)
    if arguments.json:
        write_json(arguments.json, replay_output.as_dictionary(result))
    if arguments.report is not None:
        from bev_preheat.monitoring.pages import report_text
        write_whole(arguments.report, report_text(replay_output.report_words(result, histories), *histories))
    console = result_console(arguments.json)
    replay_output.print_result(console, result)
    if arguments.report is not None:
        console.say(f'written: {arguments.report}')
    # If the question is what if, a recording that is not reproduced is no failure.
    is_what_if = result.changed is not None and not result.changes.is_nothing
    is_good = is_what_if or result.is_good is not False
    return run_expectation(arguments, expected, result, 0 if is_good else DIFFERENT)


def read(path: Path, arguments: Namespace) -> tuple[Flight, Changes]:
    """Return the Flight of a recording, and the Changes; raises InvalidInput if one is refused."""
    from bev_preheat.recording.recordings import has_planner, open_recording, Sources
    planner = planner_of(arguments)
    # Options that change a recorded planner describe an unrecorded one.
    changes = changes_of(arguments, planner if has_planner(path) else Changes())
    return open_recording(path, planner, Sources(
        arguments.route, arguments.signals, arguments.namespace)), changes


def replayed(flight: Flight, changes: Changes, period: Period,
             has_report: bool) -> tuple[Result, tuple[History, ...]]:
    """Return the Result in a Period, and the History of each drive; () without a report."""
    from bev_preheat.commands.replay_output import Result
    from bev_preheat.recording.flight import driven_ns
    from bev_preheat.recording.replay import replay, replay_changed
    is_changed = flight.is_log or not changes.is_nothing
    steps, length_ns = len(flight.given), driven_ns(flight, period)
    histories = []
    if has_report:
        from bev_preheat.recording.history import History
        histories = [History(length_ns) for _ in range(2 if is_changed else 1)]
    with progress_bar() as bar:
        task = bar.add_task('replaying', total=steps * (2 if is_changed else 1))
        as_it_was = replay(flight, period, lambda done: bar.update(task, completed=done),
                           histories[0] if histories else None)
        changed = replay_changed(flight, changes, period, lambda done: bar.update(task, completed=steps + done),
                                 histories[1] if histories else None, as_it_was.heater) if is_changed else None
    return Result(flight, as_it_was, changes, changed), tuple(histories)


def run_expectation(arguments: Namespace, expected: dict[str, tuple[Any, float]] | None, result: Result,
                    status: int) -> int:
    """Write the figures, or compare them with the expected ones; returns the exit status."""
    if expected is None and arguments.write_expected is None:
        return status
    from bev_preheat.recording.comparison import deviations, expectation, figures
    console = result_console(arguments.json)
    comparison = result.replayed.comparison if result.flight.has_commands and result.changed is None else None
    values = figures(comparison, result.courses[-1])
    if arguments.write_expected is not None:
        write_json(arguments.write_expected, expectation(values))
        console.say(f'written: {arguments.write_expected}')
    if expected is None:
        return status
    found = deviations(expected, values)
    if not found:
        console.say(f'as expected: {len(expected)} figures of {arguments.expect}')
        return 0
    more = '' if len(found) == 1 else f'; {len(found)} of {len(expected)} figures deviate'
    console.say(f'not as expected: {found[0].sentence()}{more}')
    return DIFFERENT


def run_explanation(arguments: Namespace, flight: Flight, changes: Changes) -> int:
    """Print why the planner gave its command at an instant; returns the exit status."""
    others = {'--from': arguments.begin, '--to': arguments.end, '--report': arguments.report,
              '--expect': arguments.expect, '--write-expected': arguments.write_expected}
    for option, value in others.items():
        if value is not None:
            raise InvalidInput(f'{option}: not allowed with --explain')
    if not changes.is_nothing:
        raise InvalidInput('--explain: is for the recording as it was, without changes')
    from bev_preheat.recording.explanation import explain
    from bev_preheat.recording.flight import instant_of, moment
    why = explain(flight, instant_of('--explain', arguments.explain, flight.start_ns))
    if arguments.json:
        write_json(arguments.json, {
            'now_ns': why.now_ns, 'answer': why.answer,
            'sections': {heading: [list(row) for row in rows] for heading, rows in why.sections.items()}})
    console = result_console(arguments.json)
    console.say(f'{moment(why.now_ns)}: {why.answer}')
    for heading, rows in why.sections.items():
        if rows:
            print_records(console, heading, ('', ''), rows)
    return 0


def planner_of(arguments: Namespace) -> Changes:
    """Return the Changes of `--vehicle`, `--method` and `--set`; raises InvalidInput for unknown parameters."""
    parameters: dict[str, Any] = {}
    for text in arguments.parameters:
        name, sign, value = text.partition('=')
        if not sign or name not in FIELD_OF_PARAMETER:
            raise InvalidInput(f'--set: {quoted(text)} is not allowed{_meant(name)}; it must be PARAMETER=VALUE, '
                               f'with a parameter of {", ".join(FIELD_OF_PARAMETER)}')
        _add(parameters, name, _value('--set', name, value), '--set')
    if arguments.method is not None:
        _add(parameters, 'method', _value('--method', 'method', arguments.method), '--method')
    return Changes(arguments.vehicle, parameters=parameters)


def changes_of(arguments: Namespace, planner: Changes) -> Changes:
    """Return the Changes of `--change`, on top of those of the planner; raises InvalidInput, naming the change."""
    vehicle, parameters = planner.vehicle, dict(planner.parameters)
    signals, keys = list[SignalChange](), dict[str, Any]()
    for text in arguments.changes:
        name, sign, value = text.partition('=')
        name = ALIASES.get(name, name)
        if sign and name == VEHICLE:
            vehicle = _add({} if vehicle is None else {VEHICLE: vehicle}, VEHICLE, value, '--change')
        elif sign and name in FIELD_OF_PARAMETER:
            _add(parameters, name, _value('--change', name, value), '--change')
        elif sign and name in SIGNALS:
            with located('--change'):
                change = signal_change(name, value)
            before = [each for each in signals if each.signal == name and each != change]
            if before and change.replaces:
                raise InvalidInput(f'--change: {change.in_words()} contradicts {before[-1].in_words()}, which is '
                                   'given as well; leave one out')
            signals.append(change)
        elif sign and '.' in name:
            _add(keys, name, _number_or_text(value), '--change')
        else:
            signals_in_words = ', '.join(f'{signal} [{unit or "0 ... 1"}]' for signal, (unit, *_) in UNITS.items())
            raise InvalidInput(f'--change: {quoted(text)} is not allowed{_meant(name)}; it must be SIGNAL=VALUE, '
                               f'=+NUMBER, =-NUMBER or =*NUMBER with a signal of {signals_in_words}, or '
                               'vehicle=FILE, or KEY=VALUE with a dotted key of the vehicle file, or '
                               'PARAMETER=VALUE')
    for name in UNREAD.keys() & parameters:
        raise InvalidInput(f'{name}: is not allowed as a change, because it changes nothing: {UNREAD[name]}')
    return Changes(vehicle, keys, parameters, tuple(signals))


def _number_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _add(values: dict[str, Any], name: str, value: Any, option: str) -> Any:
    """Add a value, and return it; raises InvalidInput if another option has given a different one."""
    if (before := values.setdefault(name, value)) != value:
        raise InvalidInput(f'{option}: {name}: {value} contradicts {before}, which is given as well; leave one '
                           'out')
    return value


def _meant(name: str) -> str:
    """Return the names that a person may have meant, as a part of a message; '' for none."""
    from bev_preheat.vehicle import vehicle_contents
    meant: dict[str, str] = {known: known for known in (*FIELD_OF_PARAMETER, VEHICLE)}
    meant |= {known: f'--change {ALIASES.get(known, known)}' for known in (*SIGNALS, *ALIASES)}
    # Keys by their last part too.
    for key in keys_of_text(vehicle_contents('reference').decode()):
        for known in (key, key.rpartition('.')[2]):
            meant.setdefault(known, f'--change {key}')
    near = dict.fromkeys(meant[known] for known in get_close_matches(name, meant, 3, 0.6))
    return f'; did you mean {" or ".join(f"{each}=..." for each in near)}?' if near else ''


def _value(option: str, name: str, text: str) -> Any:
    from bev_preheat.nodes.parameters import check, IN_WORDS
    from bev_preheat.nodes.planner_parameters import PARAMETERS
    [parameter] = [each for each in PARAMETERS if each.name == name]
    kind = type(parameter.default)
    try:
        value = text if kind is str else float(text) if kind is float else json.loads(text)
    except ValueError:
        value = None
    if not isinstance(value, kind):
        raise InvalidInput(f'{option}: {name}: {quoted(text)} is not allowed; it must be {IN_WORDS[kind]}')
    check([parameter], {name: value})
    return value
