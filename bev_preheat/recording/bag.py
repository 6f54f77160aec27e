# SPDX-License-Identifier: Apache-2.0
"""Recordings of `ros2 bag`, MCAP or SQLite: the planner's topics, and steps from its commands."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby, zip_longest
from operator import itemgetter
from pathlib import Path
import sqlite3
from typing import Any

from bev_preheat.control.events import BATTERY_STATE, ROUTE_PLAN
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import beginning_of, mcap_messages
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.inputs import INPUTS
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.recording.flight import Flight, Given, ROS2_BAG
from bev_preheat.recording.records import (
    Beginning,
    COMMAND,
    definition,
    OWN,
    read_message,
    RecordedStep,
    SEPARATOR,
    SOURCE_COMMAND,
)

MCAP, SQLITE = b'\x89MCAP0\r\n', b'SQLite format 3\0'
SUFFIXES = ('.mcap', '.db3')
COMPRESSED = ('.zstd', '.zst')
TYPES = {**{topic: each.type_name for topic, each in INPUTS.items()}, COMMAND: 'bev_preheat_msgs/msg/HvchCommand',
         SOURCE_COMMAND: 'bev_preheat_msgs/msg/HeatSourceCommand'}
# A message with a younger stamp than this came to the planner before the recorder noted it [ns].
TRANSPORT_NS = 50_000_000
# The recorder's clock is the planner's if stamps and times of arrival differ by less [ns].
SAME_CLOCK_NS = NS_PER_S // 2


def bag_messages(path: Path, remarks: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    """
    Yield topic, type, time of arrival [ns] and bytes of the messages of the topics in TYPES.

    Raises InvalidInput, naming the file, if it cannot be read, or if a type of ours has other fields there.
    """
    for file in files_of(path):
        before = len(remarks)
        read = _sqlite_messages if beginning_of(file).startswith(SQLITE) else _mcap
        is_empty = True
        for message in read(file, remarks):
            is_empty = False
            yield message
        if is_empty and len(remarks) > before:
            # The remark says why there is nothing.
            raise InvalidInput(remarks[before].partition(';')[0] + ', and nothing before can be used')


def files_of(path: Path) -> list[Path]:
    """Return the files of a recording, or of the folder that `ros2 bag` wrote, in order; raises InvalidInput."""
    if not path.is_dir():
        return [path]
    try:
        there = sorted(path.iterdir())
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error
    files = [file for file in there if file.suffix in SUFFIXES]
    if not files:
        packed = [file.name for file in there if file.suffix in COMPRESSED]
        raise InvalidInput(f'{path}: has no .mcap and no .db3 file' + (
            f'; decompress {packed[0]} first (zstd -d)' if packed else ''))
    return files


def is_bag(path: Path) -> bool:
    """Return whether a path is a folder or a file of `ros2 bag`, by its first bytes."""
    return (path / 'metadata.yaml').is_file() if path.is_dir() else beginning_of(path).startswith((MCAP, SQLITE))


def _is_wanted(topic: str, type_name: str) -> bool:
    return TYPES.get(topic.rpartition('/')[2]) == type_name


def _mcap(path: Path, remarks: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    def note(problem: str) -> None:
        remarks.append(f'{path}: {problem}; the messages before are used')

    checked: set[str] = set()
    for topic, type_name, received_ns, data, text in mcap_messages(path, note):
        if _is_wanted(topic, type_name):
            if type_name not in checked:
                checked.add(type_name)
                check_fields(path, type_name, text.decode('utf-8', 'replace'))
            yield topic, type_name, received_ns, data


def _sqlite_messages(path: Path, remarks: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    # A recorder that was killed leaves a journal beside the file; without one nothing is written beside it.
    how = 'mode=ro' if path.with_name(f'{path.name}-wal').exists() else 'mode=ro&immutable=1'
    try:
        base = sqlite3.connect(f'{path.resolve().as_uri()}?{how}', uri=True)
    except sqlite3.Error as error:
        raise InvalidInput(f'{path}: cannot be read: {error}') from error
    try:
        wanted = {number: (topic, type_name) for number, topic, type_name in base.execute(
            'SELECT id, name, type FROM topics') if _is_wanted(topic, type_name)}
        texts = _sqlite_texts(base)
        for _, type_name in wanted.values():
            if type_name in texts:
                check_fields(path, type_name, texts[type_name])
        numbers = ','.join(str(int(number)) for number in wanted)
        for number, received_ns, data in base.execute(
                'SELECT topic_id, timestamp, data FROM messages '
                f'WHERE topic_id IN ({numbers}) ORDER BY timestamp, id'):
            yield *wanted[number], int(received_ns), bytes(data)
    except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
        remarks.append(f'{path}: is damaged ({error}); the messages before are used')
    finally:
        base.close()


def _sqlite_texts(base: sqlite3.Connection) -> dict[str, str]:
    """Return the definitions of types; {} in recordings of a ROS that did not write them."""
    try:
        return {str(name): str(text) for name, text in base.execute(
            'SELECT topic_type, encoded_message_definition FROM message_definitions')}
    except sqlite3.Error:
        return {}


def check_fields(path: Path, type_name: str, text: str) -> None:
    """Raise InvalidInput if a type of ours was recorded with other fields than it has here."""
    package, _, name = type_name.partition('/msg/')
    # ROS's own types keep their fields.
    if package != OWN or not text.strip():
        return
    recorded, here = fields_of(text), fields_of(definition(package, name).decode())
    if recorded != here:
        other = next((line for line in (*recorded, *here) if (line in recorded) != (line in here)), 'their order')
        raise InvalidInput(f'{path}: {type_name} was recorded with other fields than this version has '
                           f'({quoted(other)}); replay it with the version that wrote it')


def fields_of(text: str) -> list[str]:
    """Return the fields of a message definition, without comments, constants and the types in it."""
    lines = text.partition(SEPARATOR)[0].splitlines()
    stripped = [' '.join(line.partition('#')[0].split()) for line in lines]
    # `string<=256 name` has a bound, `uint8 NAME=1` is a constant.
    return [line for line in stripped if line and '=' not in line.replace('<=', '')]


def read_topics(path: Path, beginning: Beginning, namespace: str | None = None) -> Flight:
    """
    Return the Flight of a ros2 bag; `beginning` has the vehicle file and the parameters of the recorded planner.

    `namespace` is needed if the topics of several planners are there. Raises InvalidInput, naming the file, if it
    cannot be read or has no battery_state.
    """
    remarks: list[str] = []
    found: dict[str, list[tuple[int, str, str, bytes]]] = {}
    for topic, type_name, received_ns, data in bag_messages(path, remarks):
        prefix, _, name = topic.rpartition('/')
        found.setdefault(prefix, []).append((received_ns, name, type_name, data))
    messages = _of_namespace(path, found, namespace)
    commands, inputs = _in_time(messages)
    topics = set(map(_topic, inputs))
    if BATTERY_STATE not in topics:
        raise InvalidInput(f'{path}: has no battery_state; a planner without it never heats')
    remarks.append('the recording has no learned factors and no instants of steps; the instants are those of '
                   'its commands' if commands else
                   'the recording has no hvch_command: there are no commands to reproduce')
    if ROUTE_PLAN not in topics:
        remarks.append('the recording has no route_plan')
    given = _steps(_from_start(inputs, commands), commands) if commands else with_repeats(inputs, beginning)
    return Flight(replace(beginning, now_ns=given[0].step.now_ns), tuple(given), (path,), remarks=tuple(remarks),
                  source=ROS2_BAG, has_commands=bool(commands), power_tolerance_w=1.0)


def _of_namespace(path: Path, found: dict[str, list[tuple[int, str, str, bytes]]],
                  namespace: str | None) -> list[tuple[int, str, str, bytes]]:
    if not found:
        raise InvalidInput(f'{path}: has no message of the topics {", ".join(TYPES)}')
    if namespace is not None:
        wanted = '' if namespace.strip('/') == '' else f'/{namespace.strip("/")}'
        if wanted not in found:
            raise InvalidInput(f'--namespace: {quoted(namespace)} is not in the recording, which has '
                               f'{", ".join(prefix or "/" for prefix in sorted(found))}')
        return found[wanted]
    planners = [prefix for prefix, messages in found.items()
                if any(name in (COMMAND, ROUTE_PLAN) for _, name, _, _ in messages)] or [*found]
    if len(planners) > 1:
        raise InvalidInput(f'{path}: has the topics of several planners; name one by --namespace: '
                           f'{", ".join(prefix or "/" for prefix in sorted(planners))}')
    # Inputs may be shared by planners in namespaces.
    prefix = planners[0]
    own = {name for _, name, _, _ in found[prefix]}
    shared = [message for message in found.get('', []) if message[1] not in own] if prefix else []
    return sorted([*found[prefix], *shared], key=lambda message: message[0])


def _in_time(messages: list[tuple[int, str, str, bytes]]) -> tuple[list[RecordedStep], list[Given]]:
    """Return the steps with the commands, and those with the inputs, in the planner's time, each in order."""
    commands: list[tuple[int, tuple[float, int, int]]] = []
    inputs: list[Given] = []
    # Powers of other heat sources by stamp, end of lease and reason, which the command of the HVCH has, too.
    sources: dict[tuple[int, ...], dict[str, float]] = {}
    # How far the planner's clock is ahead of the recorder's; simulated time may be far off.
    ahead_ns = 0
    for received_ns, topic, type_name, data in messages:
        message = read_message(type_name, data)
        if topic in (COMMAND, SOURCE_COMMAND):
            stamp_ns, power_w = nanoseconds(message.header.stamp), float(message.battery_heating_power)
            values = power_w, nanoseconds(message.valid_until), int(message.reason)
            if topic == COMMAND:
                ahead_ns = stamp_ns - received_ns
                commands.append((stamp_ns, values))
            elif power_w > 0.0:
                sources.setdefault((stamp_ns, *values[1:]), {})[str(message.name)] = power_w
            continue
        stamp_ns = _stamp_ns(message)
        if abs(ahead_ns) > SAME_CLOCK_NS or (not commands and abs(stamp_ns - received_ns) > SAME_CLOCK_NS
                                             and topic == BATTERY_STATE):
            is_stamped = topic != ROUTE_PLAN and stamp_ns
            now_ns = stamp_ns if is_stamped else received_ns + ahead_ns
        else:
            now_ns = stamp_ns if 0 <= received_ns - stamp_ns <= TRANSPORT_NS else received_ns
        inputs.append(Given(RecordedStep(now_ns, events=({'kind': topic},)), (type_name, data)))
    steps = [RecordedStep(now_ns, command=values, sources=tuple(sources.get((now_ns, *values[1:]), {}).items()))
             for now_ns, values in sorted(commands, key=itemgetter(0))]
    return steps, sorted(inputs, key=_instant_ns)


def _stamp_ns(message: Any) -> int:
    header = getattr(message, 'header', None)
    stamp = header.stamp if header is not None else getattr(message, 'stamp', None)
    return 0 if stamp is None else nanoseconds(stamp)


def _topic(given: Given) -> str:
    return str(given.step.events[0]['kind'])


def _instant_ns(given: Given) -> int:
    return given.step.now_ns


def _from_start(inputs: list[Given], commands: list[RecordedStep]) -> list[Given]:
    """Return the inputs from the planner's start on, whose first commands name missing inputs; else all inputs."""
    reasons = [(step.now_ns, step.command[2]) for step in commands if step.command is not None]
    first_ns, first_reason = reasons[0]
    if first_reason not in (Status.NO_ROUTE, Status.NO_BATTERY_STATE):
        return inputs
    kept = [each for each in inputs if each.step.now_ns >= first_ns]
    for topic, unknown in ((BATTERY_STATE, (Status.NO_ROUTE, Status.NO_BATTERY_STATE)),
                           (ROUTE_PLAN, (Status.NO_ROUTE,))):
        before = [each for each in inputs if _topic(each) == topic and each.step.now_ns < first_ns]
        known_ns = next((now_ns for now_ns, reason in reasons if reason not in unknown), None)
        if before and known_ns is not None and not any(
                _topic(each) == topic and each.step.now_ns <= known_ns for each in kept):
            # It was on its way, or latched.
            kept.insert(0, replace(before[-1], step=replace(before[-1].step, now_ns=known_ns)))
    return sorted(kept, key=_instant_ns)


def _steps(inputs: list[Given], commands: list[RecordedStep]) -> list[Given]:
    """Return a step for each command, with the input just before it, which it answers at once."""
    given: list[Given] = []
    begin = 0
    for now_ns, group in groupby(commands, key=lambda step: step.now_ns):
        answers = list(group)
        end = bisect_right(inputs, now_ns, key=_instant_ns)
        # The answers to the first inputs are missing from the recording.
        answered = max(begin, end - len(answers))
        given += inputs[begin:answered]
        # Simulated time may stand while several inputs are answered.
        given += [Given(answer) if each is None else Given(replace(answer, events=each.step.events), each.message)
                  for each, answer in zip_longest(inputs[answered:end], answers)]
        begin = end
    return given + inputs[begin:]


def with_repeats(given: list[Given], beginning: Beginning) -> list[Given]:
    """Return the steps with further ones where more than a command period of the planner passes."""
    period_ns = round(NS_PER_S * beginning.parameters.get('command_period', Settings.command_period_s))
    filled: list[Given] = []
    for each in given:
        if filled:
            now_ns = filled[-1].step.now_ns + period_ns
            # A clock that jumped by more than a day is not filled.
            while now_ns < each.step.now_ns < filled[-1].step.now_ns + 86400 * NS_PER_S:
                filled.append(Given(RecordedStep(now_ns)))
                now_ns += period_ns
        filled.append(each)
    return filled
