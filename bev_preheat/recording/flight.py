# SPDX-License-Identifier: Apache-2.0
"""A planner's recorded inputs and answers in order, read from the flight recorder's files; the part shown."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from datetime import datetime, time, UTC
import json
from pathlib import Path
from statistics import median
import struct
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.control.events import BATTERY_STATE, ROUTE_PLAN
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import mcap_messages
from bev_preheat.messages.inputs import INPUTS
from bev_preheat.numerics import NS_PER_DAY, NS_PER_S
from bev_preheat.optional_packages import require
from bev_preheat.planning.explanation import duration_text
from bev_preheat.recording.records import Beginning, RecordedState, RecordedStep
from bev_preheat.recording.ring import recordings_in
from bev_preheat.recording.writer import BEGINNING_CHANNEL, GAP_CHANNEL, STATE_CHANNEL, STEP_CHANNEL

if TYPE_CHECKING:
    from bev_preheat.recording.replay import Played

# A clock that jumps on from below a day by more than a day had not been set [ns].
CLOCK_UNSET_NS = 86_400_000_000_000
# Kinds of recordings.
FLIGHT_RECORDER, ROS2_BAG, LOG = 'flight recorder', 'ros2 bag', 'log'
# Longer pauses between two steps are no drive [ns].
LONGEST_PAUSE_NS = 60 * NS_PER_S


@dataclass(frozen=True, eq=False)
class Given:
    """A RecordedStep, and the message that its event came in: its type and its bytes (CDR); None without one."""

    step: RecordedStep
    message: tuple[str, bytes] | None = None


class Start(NamedTuple):
    """The RecordedState before a place in a Flight's `given`; type and bytes of its route's message, or None."""

    at: int
    recorded: RecordedState
    route: tuple[str, bytes] | None = None


@dataclass(frozen=True, eq=False)
class Flight:
    """
    A planner's inputs and answers, in order.

    `paths` are the files. `remarks` are sentences on missing parts. `gaps` are the indices in `given` before
    which steps are missing; `starts` are the Starts, from which a planner may be played. `source` is the kind of
    the recording. Without `has_commands` there is nothing to reproduce; then commands in `given` are the heater's
    recorded power. Commands count as the same if their powers differ by at most `power_tolerance_w` [W].
    """

    beginning: Beginning
    given: tuple[Given, ...]
    paths: tuple[Path, ...]
    gaps: tuple[int, ...] = ()
    remarks: tuple[str, ...] = ()
    source: str = FLIGHT_RECORDER
    has_commands: bool = True
    power_tolerance_w: float = 0.0
    starts: tuple[Start, ...] = ()

    @property
    def begin(self) -> int:
        """The index of the first step after the clock was set; simulated time is 0 before."""
        instants = [given.step.now_ns for given in self.given]
        return next((index for index, (before, after) in enumerate(zip(instants, instants[1:]), start=1)
                     if before < CLOCK_UNSET_NS < after - before), 0)

    @property
    def start_ns(self) -> int:
        """The instant of that step [ns]."""
        return self.given[self.begin].step.now_ns

    def from_instant(self, now_ns: int) -> Flight:
        """Return the Flight from the latest Start on that all steps from an instant [ns] on follow."""
        first = next((index for index, given in enumerate(self.given) if given.step.now_ns >= now_ns), 0)
        index = max((start.at for start in self.starts if start.at <= first), default=0)
        return replace(
            self, given=self.given[index:], gaps=tuple(gap - index for gap in self.gaps if gap >= index),
            starts=tuple(start._replace(at=start.at - index) for start in self.starts if start.at >= index))

    @property
    def is_log(self) -> bool:
        """Whether no planner was there: the recorded battery was not heated by its commands."""
        return self.source == LOG


def read_flight(path: str | Path) -> Flight:
    """Return the Flight of a file and its process's later ones, or of a folder's latest; raises InvalidInput."""
    require('mcap')
    flight, *others = map(_read_part, _parts_of(Path(path)))
    for number, part in enumerate(others, start=1):
        at, remarks = len(flight.given), part.remarks
        gaps = [at + gap for gap in part.gaps]
        if part.beginning.part != flight.beginning.part + number:
            gaps.insert(0, at)
            remarks = *remarks, f'{part.paths[0].name}: the file before it is missing'
        flight = replace(
            flight, given=flight.given + part.given, paths=flight.paths + part.paths, gaps=(*flight.gaps, *gaps),
            remarks=flight.remarks + remarks,
            starts=(*flight.starts, *(start._replace(at=at + start.at) for start in part.starts)))
    return flight


def _parts_of(path: Path) -> list[Path]:
    """Return the files of the process of a file, from that one on; of a folder, those of the latest process."""
    if path.is_dir():
        found = recordings_in(path)
        if not found:
            others = ', '.join(sorted(each.name for each in path.iterdir() if each.suffix in ('.mcap', '.db3')))
            raise InvalidInput(f'{path}: has no recording of the flight recorder'
                               f'{others and f"; name a file: {others}"}')
        life = _life(found[-1])
        return [each for each in found if _life(each) == life]
    if not path.is_file():
        raise InvalidInput(f'{path}: does not exist; name a recording or the folder of recordings')
    try:
        siblings = recordings_in(path.parent)
    except OSError:
        siblings = []
    if path.resolve() not in [each.resolve() for each in siblings]:
        return [path]
    return [each for each in siblings if _life(each) == _life(path) and each.name >= path.name]


def _life(path: Path) -> str:
    return path.name.rsplit('_', 1)[0]


def _read_part(path: Path) -> Flight:
    beginning: Beginning | None = None
    given: list[Given] = []
    gaps: list[int] = []
    remarks: list[str] = []
    latest: dict[str, tuple[str, bytes]] = {}
    routes: dict[int, tuple[str, bytes]] = {}
    starts: list[Start] = []

    def note(problem: str) -> None:
        remarks.append(f'{path.name}: {problem}; the messages before are used')

    for channel, type_name, now_ns, data, _ in mcap_messages(path, note):
        if channel == BEGINNING_CHANNEL:
            beginning = Beginning.from_dictionary(_plain(path, data))
        elif channel == GAP_CHANNEL:
            gaps.append(len(given))
            remarks.append(f'{path.name}: {_plain(path, data).get("dropped")} steps were not written, because the '
                           'disk was too slow or full; after them the replay may differ')
        elif channel == STATE_CHANNEL:
            recorded = RecordedState.from_dictionary(_plain(path, data))
            starts.append(Start(len(given), recorded, None if recorded.route_ns is None else
                                routes.get(recorded.route_ns)))
        elif channel == STEP_CHANNEL:
            step = RecordedStep.from_dictionary(_plain(path, data))
            # An event of a message has its topic as kind.
            topic = next(iter(INPUTS.keys() & {event.get('kind') for event in step.events}), None)
            given.append(Given(step, None if topic is None else latest.get(topic)))
        else:
            topic = channel.rpartition('/')[2]
            latest[topic] = type_name, data
            if topic == ROUTE_PLAN:
                routes[now_ns] = type_name, data
    if beginning is None:
        raise InvalidInput(f'{path}: is not a recording of the flight recorder, or its beginning is lost')
    return Flight(beginning, tuple(given), (path,), tuple(gaps), tuple(remarks), starts=tuple(starts))


def _plain(path: Path, data: bytes) -> Any:
    try:
        values = json.loads(data)
    except ValueError as error:
        raise InvalidInput(f'{path}: a record is damaged: {error}') from error
    if not isinstance(values, dict):
        raise InvalidInput(f'{path}: a record is damaged')
    return values


class Period(NamedTuple):
    """From an instant to another [ns], both included."""

    from_ns: int = -2**63
    to_ns: int = 2**63

    @property
    def length_s(self) -> float:
        """Its length [s]."""
        return (self.to_ns - self.from_ns) / NS_PER_S

    def has(self, now_ns: int) -> bool:
        """Return whether an instant [ns] lies within it."""
        return self.from_ns <= now_ns <= self.to_ns


WHOLE = Period()


def instant_of(option: str, text: str, start_ns: int) -> int:
    """Return the instant [ns] of seconds from the start or a time of day (UTC); raises InvalidInput."""
    try:
        if ':' not in text:
            return start_ns + round(float(text) * NS_PER_S)
        start = datetime.fromtimestamp(start_ns / NS_PER_S, UTC)
        at = datetime.combine(start.date(), time.fromisoformat(text), UTC)
        # A recording may go past midnight.
        at_ns = round(at.timestamp() * NS_PER_S)
        return at_ns if at_ns >= start_ns - NS_PER_S else at_ns + NS_PER_DAY
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f'{option}: {quoted(text)} is not allowed; it must be seconds from the start of the '
                           'recording, such as 1500, or a time of day (UTC), 00:00:00 ... 23:59:59') from error


def period_of(flight: Flight, begin: str | None, end: str | None) -> Period:
    """Return the Period from `begin` to `end` (None: open); raises InvalidInput if it has no step."""
    instants = [given.step.now_ns for given in flight.given]
    start_ns = flight.start_ns
    period = Period(WHOLE.from_ns if begin is None else instant_of('--from', begin, start_ns),
                    WHOLE.to_ns if end is None else instant_of('--to', end, start_ns))
    if period.from_ns > period.to_ns:
        raise InvalidInput(f'--to: {quoted(str(end))} is before --from, {quoted(str(begin))}')
    if not any(period.has(now_ns) for now_ns in instants):
        option, at_ns = ('--to', period.to_ns) if period.to_ns < min(instants) else ('--from', period.from_ns)
        raise InvalidInput(f'{option}: {no_step_words(flight, at_ns)}')
    return period


def no_step_words(flight: Flight, at_ns: int) -> str:
    """Return the sentence on an instant [ns] without a step, with the allowed ones."""
    longest_s = (max(given.step.now_ns for given in flight.given) - flight.start_ns) / NS_PER_S
    return (f'the recording has no step at {moment(at_ns)}; it is {duration_text(longest_s)} long, from '
            f'{moment(flight.start_ns)} on: give seconds from its start, 0 ... {longest_s:.0f}, or a time of day '
            '(UTC)')


def driven_ns(flight: Flight, period: Period = WHOLE) -> int:
    """Return how long [ns] the steps of a Period take, without pauses and jumps of the clock."""
    instants = [given.step.now_ns for given in flight.given if period.has(given.step.now_ns)]
    return sum(min(max(after - before, 0), LONGEST_PAUSE_NS) for before, after in zip(instants, instants[1:]))


def moment(now_ns: int) -> str:
    """Return an instant [ns] as text."""
    return datetime.fromtimestamp(now_ns / NS_PER_S, UTC).strftime('%Y-%m-%d %H:%M:%S UTC')


# A clock that goes back by less is only read in two threads [ns].
CLOCK_NOISE_NS = 50_000_000
# The planner makes a step at least this often, unless it sleeps [ns].
STEPS_WITHIN_NS = 15 * NS_PER_S
# Ages and delays below these are usual [s].
USUAL_AGE_S, USUAL_DELAY_S = 0.5, 60.0
# A state is missing if the interval between two is longer than the usual one by this factor; that is worth a word
# beyond this share of the states.
MISSING_FACTOR, USUAL_SHARE_MISSING = 1.5, 0.02
# Offsets of the sensor that the estimation subtracts [K].
USUAL_OFFSET_K = 0.5
MOST_KEPT, NAMED_PROBLEMS = 100_000, 3
# CDR: four bytes, then the stamp of the header as seconds and nanoseconds.
STAMP = struct.Struct('<4xiI')


class InputRemarks:
    """Looks at the inputs of a drive, step by step; `sentences` names the unusual inputs."""

    def __init__(self) -> None:
        self._latest_ns: int | None = None
        self._back: list[str] = []
        self._pauses: list[str] = []
        self._stamp_ns: int | None = None
        # Of the latest states: age on arrival, and interval from the state before [s].
        self._ages_s: deque[float] = deque(maxlen=MOST_KEPT)
        self._intervals_s: deque[float] = deque(maxlen=MOST_KEPT)
        self._overtaken = 0
        self._delay_s = self._offset_k = 0.0
        # The first sentence on each signal in doubt.
        self._doubts: dict[str, str] = {}

    def add(self, given: Given, played: Played) -> None:
        """Add a step."""
        self._look_at_clock(given.step.now_ns)
        if given.message is not None and any(event.get('kind') == BATTERY_STATE for event in given.step.events):
            self._look_at_state(given.step.now_ns, given.message[1])
        mission, estimate = played.state.active_mission, played.state.estimate
        if mission is not None and abs(mission.delay_ns) > abs(self._delay_s) * NS_PER_S:
            self._delay_s = mission.delay_ns / NS_PER_S
        if estimate is not None and abs(estimate.sensor_offset_k) > abs(self._offset_k):
            self._offset_k = estimate.sensor_offset_k
        for verdict in played.state.signal_verdicts:
            self._doubts.setdefault(
                verdict.signal, f'signal in doubt from {moment(verdict.since_ns)} on: {verdict.sentence}')

    def _look_at_clock(self, now_ns: int) -> None:
        before_ns, self._latest_ns = self._latest_ns, now_ns
        if before_ns is None:
            return
        if now_ns < before_ns - CLOCK_NOISE_NS:
            self._back.append(f'by {(before_ns - now_ns) / NS_PER_S:.1f} s at {moment(before_ns)}')
        elif now_ns > before_ns + STEPS_WITHIN_NS:
            self._pauses.append(f'{duration_text((now_ns - before_ns) / NS_PER_S)} from {moment(before_ns)} on')

    def _look_at_state(self, now_ns: int, message: bytes) -> None:
        if len(message) < STAMP.size or message[1] != 1:
            return
        seconds, nanoseconds = STAMP.unpack_from(message)
        stamp_ns, before_ns = seconds * NS_PER_S + nanoseconds, self._stamp_ns
        if before_ns is not None and 0 < before_ns - stamp_ns < STEPS_WITHIN_NS:
            self._overtaken += 1
            return
        self._stamp_ns = stamp_ns
        self._ages_s.append((now_ns - stamp_ns) / NS_PER_S)
        if before_ns is not None and stamp_ns > before_ns:
            self._intervals_s.append((stamp_ns - before_ns) / NS_PER_S)

    @property
    def sentences(self) -> list[str]:
        """The unusual inputs, a sentence each."""
        found = []
        if self._back:
            found.append(f'the clock went back {_times(self._back)}')
        if self._pauses:
            found.append('the planner made no step, because it slept or its clock was set forward: '
                         f'{_times(self._pauses)}')
        if self._ages_s and median(self._ages_s) > USUAL_AGE_S:
            found.append(f'battery_state arrives {median(self._ages_s):.1f} s old (median)')
        if self._intervals_s:
            usual_s = median(self._intervals_s)
            missing = sum(interval_s > MISSING_FACTOR * usual_s for interval_s in self._intervals_s)
            missing -= self._overtaken
            if missing > USUAL_SHARE_MISSING * len(self._intervals_s):
                found.append(f'battery_state comes every {usual_s:g} s, and is missing {missing} times; the '
                             f'longest interval is {max(self._intervals_s):.1f} s')
        if self._overtaken:
            found.append(f'{self._overtaken} battery states were overtaken by later ones')
        if abs(self._delay_s) > USUAL_DELAY_S:
            found.append(f'the vehicle was up to {duration_text(abs(self._delay_s))} '
                         f'{"behind" if self._delay_s > 0.0 else "ahead of"} its route; the planner learned it '
                         'from power or position, not from a new route_plan')
        if abs(self._offset_k) > USUAL_OFFSET_K:
            found.append(f'the temperature sensor reads up to {abs(self._offset_k):.1f} K too '
                         f'{"warm" if self._offset_k > 0.0 else "cold"}, as the estimation found')
        return found + list(self._doubts.values())


def _times(found: list[str]) -> str:
    more = len(found) - NAMED_PROBLEMS
    return ', '.join(found[:NAMED_PROBLEMS]) + (f' and {more} more times' if more > 0 else '')
