# SPDX-License-Identifier: Apache-2.0
"""
The records of a recording: types of messages with their texts, the first records of a file, steps as plain values.

A step is one call of `Supervisor.step`, `fail` or `stop`. Events that came as a ROS message are recorded by their
topic only: the message itself is in the recording just before the step.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
import re
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.control.departures import clock_time, DailyPrice, GridPrices, PricePeriod, zone_of
from bev_preheat.control.events import (
    ActivationChanged,
    DeparturesSkipped,
    Event,
    PreheatingSwitched,
    PreparationEnded,
    PreparationWanted,
    Reconfigured,
    RivalsChanged,
    RouteUnreadable,
)
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.estimation.prior import Lags, Learned
from bev_preheat.files.input_files import installed_prefix
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bev_preheat.control.decision import Command

# Of the planner's inputs and outputs, by package.
OWN = 'bev_preheat_msgs'
LONGEST_REASON = 200
SEPARATOR = '=' * 80
# A field's type: package/Type or Type, with or without bounds of an array or a text.
FIELD = re.compile(r'^\s*(?:(?P<package>\w+)/)?(?P<name>[A-Z]\w*)(?:\[[^\]]*\])?\s+\w+')


def read_message(type_name: str, data: bytes) -> Any:
    """Return the message of bytes (CDR); raises InvalidInput, naming the type, if they are damaged."""
    from rclpy.serialization import deserialize_message
    known = message_type(type_name)
    try:
        return deserialize_message(data, known)
    except Exception as error:
        # rclpy raises errors of many kinds for damaged bytes.
        reason = shortened(f'{type(error).__name__}: {" ".join(str(error).split())}', LONGEST_REASON)
        raise InvalidInput(f'a message of type {type_name} in the recording is damaged, or of another version: '
                           f'{reason}') from error


def message_type(name: str) -> Any:
    """Return the class of a message type such as sensor_msgs/msg/BatteryState; raises InvalidInput if unknown."""
    package, _, short = name.partition('/msg/')
    found = getattr(import_module(f'{package}.msg'), short, None) if package in (OWN, 'sensor_msgs') else None
    if found is None:
        raise InvalidInput(f'message type {quoted(name)} of the recording is not known here')
    return found


def definition(package: str, name: str) -> bytes:
    """Return the text of a message type and of those in it (ros2msg); raises InvalidInput if one is missing."""
    texts: dict[tuple[str, str], str] = {}
    waiting = [(package, name)]
    while waiting:
        key = waiting.pop(0)
        if key not in texts:
            texts[key] = _text(*key)
            fields = (FIELD.match(line.partition('#')[0]) for line in texts[key].splitlines())
            waiting += [(found['package'] or key[0], found['name']) for found in fields if found]
    first, *others = texts.items()
    parts = [first[1], *(f'{SEPARATOR}\nMSG: {key[0]}/{key[1]}\n{text}' for key, text in others)]
    return '\n'.join(parts).encode()


def _text(package: str, name: str) -> str:
    prefix = installed_prefix(package)
    if prefix is None:
        raise InvalidInput(f'the message definitions of {package} are not installed')
    path = prefix / 'share' / package / 'msg' / f'{name}.msg'
    try:
        return path.read_text(encoding='utf-8')
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


@contextmanager
def sound(what: str) -> Iterator[None]:
    """Raise InvalidInput, which names the damaged record, where plain values have another form."""
    try:
        yield
    except (LookupError, TypeError, ValueError) as error:
        raise InvalidInput(f'{what} is damaged: {type(error).__name__}: {error}') from error


def _whole(number: Any) -> int | None:
    return None if number is None else int(number)


# Of the records of this version. Older ones are read as long as their numbers are listed in READ_FORMATS.
DRIVE_FORMAT = 2
READ_FORMATS = (2,)


@dataclass(frozen=True, eq=False)
class Beginning:
    """
    What replays need besides the planner's state.

    `life` identifies the planner's process, `part` counts its files from 0. `vehicle_file` is the text of the
    vehicle file and `parameters` has the node's parameters by name. `now_ns` is the node's clock [ns],
    `uses_sim_time` whether that is /clock.
    """

    version: str
    node: str
    life: str
    part: int
    now_ns: int
    uses_sim_time: bool
    parameters: dict[str, Any]
    vehicle_file: str

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {'format': DRIVE_FORMAT, **vars(self)}

    @classmethod
    def from_dictionary(cls, values: dict[str, Any]) -> Beginning:
        """Return the Beginning of plain values; raises InvalidInput on another format, or damage."""
        if values.get('format') not in READ_FORMATS:
            raise InvalidInput(
                f'the recording has format {quoted(str(values.get("format")))} of version '
                f'{quoted(str(values.get("version")))}; this version reads format '
                f'{", ".join(map(str, READ_FORMATS))}; replay it with the version that wrote it')
        with sound("the recording's beginning"):
            return cls(str(values['version']), str(values['node']), str(values['life']), int(values['part']),
                       int(values['now_ns']), bool(values['uses_sim_time']),
                       dict(values['parameters']), str(values['vehicle_file']))


class RecordedState(NamedTuple):
    """
    The planner's State after a step, as bytes (`control.state_bytes`).

    `goal` is the number of its preparation goal in the recording, None without one; `route_ns` [ns] is the instant
    at which the message of its route is recorded, None without a route.
    """

    state: bytes
    goal: int | None = None
    route_ns: int | None = None

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {**self._asdict(), 'state': b64encode(self.state).decode()}

    @classmethod
    def from_dictionary(cls, values: dict[str, Any]) -> RecordedState:
        """Return the RecordedState of plain values; raises InvalidInput if they are damaged."""
        with sound('a state of the recording'):
            return cls(b64decode(values['state']), _whole(values['goal']), _whole(values['route_ns']))


def learned_values(learned: Learned | None) -> dict[str, Any] | None:
    """Return a Learned as plain values; numbers keep every digit."""
    return None if learned is None else {
        'factors': learned.factors.tolist(), 'covariance': learned.covariance.tolist(),
        'lags': None if learned.lags is None else {
            'logs': learned.lags.logs.tolist(), 'variances': learned.lags.variances.tolist()}}


def learned_of(values: Any) -> Learned | None:
    """Return the Learned of plain values; raises KeyError, TypeError or ValueError if they are damaged."""
    if values is None:
        return None
    factors, covariance = np.array(values['factors'], dtype=float), np.array(values['covariance'], dtype=float)
    if covariance.shape != (len(factors), len(factors)) or not np.isfinite(covariance).all():
        raise ValueError('covariance does not fit the factors')
    lags = values['lags']
    return Learned(factors, covariance, None if lags is None else Lags(
        np.array(lags['logs'], dtype=float), np.array(lags['variances'], dtype=float)))


# Topics of the planner's output.
COMMAND, SOURCE_COMMAND = 'hvch_command', 'heat_source_command'
WANTED, ENDED, RECONFIGURED, REFUSED_ROUTE = (
    'PreparationWanted', 'PreparationEnded', 'Reconfigured', 'RouteRefused')
# Events whose fields are plain values.
PLAIN_EVENTS: dict[str, Any] = {each.__name__: each for each in (
    ActivationChanged, PreheatingSwitched, RivalsChanged, DeparturesSkipped)}
STEP, FAIL, STOP = 'step', 'fail', 'stop'


@dataclass(frozen=True)
class RecordedStep:
    """
    One recorded call of the Supervisor at an instant [ns of the node's clock].

    `call` is STEP, FAIL or STOP, `events` are those of the step as plain values, and `what` is the sentence of
    FAIL. `command` is the answer, None: no command was published; `status` the number of the published
    decision's planning.status.Status, None: no decision. `sources` are name and power [W] of other heat sources.
    """

    now_ns: int
    call: str = STEP
    events: tuple[dict[str, Any], ...] = ()
    what: str = ''
    command: tuple[float, int, int] | None = None
    status: int | None = None
    sources: tuple[tuple[str, float], ...] = ()

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values."""
        return dict(vars(self))

    def command_w(self, name: str) -> float:
        """Return the commanded power of a heat source [W]; 0 without a command."""
        powers_w = {} if self.command is None else {HVCH: self.command[0], **dict(self.sources)}
        return powers_w.get(name, 0.0)

    @classmethod
    def from_dictionary(cls, values: Any) -> RecordedStep:
        """Return the step of plain values; raises InvalidInput, naming the field, if they are not a step's."""
        with sound('a step of the recording'):
            command = values['command']
            return cls(int(values['now_ns']), str(values['call']), tuple(map(dict, values['events'])),
                       str(values['what']),
                       None if command is None else (float(command[0]), int(command[1]), int(command[2])),
                       _whole(values['status']),
                       tuple((str(name), float(power_w)) for name, power_w in values.get('sources', ())))


def command_values(command: Command | None) -> tuple[float, int, int] | None:
    """Return a Command as power [W], end of its lease [ns] and number of its reason; None for None."""
    return None if command is None else (
        command.battery_heating_power_w, command.valid_until_ns, int(command.reason))


@dataclass
class GoalNumbers:
    """Numbers of the PreparationGoals of a recording: a goal equals only itself."""

    numbers: dict[PreparationGoal, int] = field(default_factory=dict)

    def number(self, goal: PreparationGoal) -> int:
        """Return the number of a goal; a new one for a goal that was not there yet."""
        return self.numbers.setdefault(goal, len(self.numbers))

    def goal(self, number: int) -> PreparationGoal:
        """Return the goal of a number; raises InvalidInput if the recording has none."""
        for goal, known in self.numbers.items():
            if known == number:
                return goal
        raise InvalidInput(f'preparation goal {number} is not in the recording; its beginning is missing')


def event_values(event: Event, goals: GoalNumbers, has_message: bool) -> dict[str, Any]:
    """
    Return an event as plain values; `has_message`: its message is recorded before it.

    Parameters are those of the node, which the caller adds: an event carries only the values derived from them.
    """
    match event:
        case PreparationWanted(goal):
            plain = asdict(replace(goal, prices=None))
            return {'kind': WANTED, 'goal': goals.number(goal), **plain, 'prices': _price_values(goal.prices)}
        case PreparationEnded(goal, ending, explanation):
            return {'kind': ENDED, 'goal': None if goal is None else goals.number(goal), 'ending': int(ending),
                    'explanation': explanation}
        case Reconfigured():
            return {'kind': RECONFIGURED}
        case RouteUnreadable(error) if not has_message:
            return {'kind': REFUSED_ROUTE, 'problems': list(error.problems)}
    name = type(event).__name__
    if name in PLAIN_EVENTS:
        return {'kind': name, **asdict(event)}
    hint = getattr(event, 'hint', '')
    return {'kind': event.source, **({'hint': hint} if hint else {})}


def _price_values(prices: GridPrices | None) -> dict[str, Any] | None:
    """Return GridPrices as plain values, the time zone by its IANA name."""
    return None if prices is None else {
        'zone': str(prices.zone), 'daily': [(f'{each.clock:%H:%M}', each.price_per_kwh) for each in prices.daily],
        'dated': list(map(tuple, prices.dated)), 'currency': prices.currency}


def _prices_of(values: Any) -> GridPrices | None:
    return None if values is None else GridPrices(
        zone_of(values['zone']), tuple(DailyPrice(clock_time(clock), price) for clock, price in values['daily']),
        tuple(PricePeriod(*period) for period in values['dated']), values['currency'])


def event_of(values: dict[str, Any], goals: GoalNumbers) -> Event:
    """Return the event of plain values that came without a message; raises InvalidInput, naming the kind."""
    kind = values.get('kind')
    fields = {name: value for name, value in values.items() if name not in ('kind', 'goal')}
    with sound(f'event {quoted(str(kind))} of the recording'):
        if kind in PLAIN_EVENTS:
            event: Event = PLAIN_EVENTS[kind](**fields)
            return event
        if kind == WANTED:
            goal = PreparationGoal(**{**fields, 'prices': _prices_of(fields.get('prices'))})
            goals.numbers[goal] = int(values['goal'])
            return PreparationWanted(goal)
        if kind == ENDED:
            number = values['goal']
            return PreparationEnded(None if number is None else goals.goal(number),
                                    PreparationEnding(values['ending']), str(values['explanation']))
        if kind == REFUSED_ROUTE:
            return RouteUnreadable(InvalidInput([str(problem) for problem in values['problems']]))
    raise InvalidInput(f'event {quoted(str(kind))} of the recording is not known to this version')
