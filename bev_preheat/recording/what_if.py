# SPDX-License-Identifier: Apache-2.0
"""A flight replayed as it was, or with changes; the battery follows the changed command."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.recording.comparison import compare, Comparison
from bev_preheat.recording.course import Course
from bev_preheat.recording.deviation import Deviation
from bev_preheat.recording.heater_share import alter_status, HeaterShares
from bev_preheat.recording.inputs import InputRemarks
from bev_preheat.recording.period import Period, WHOLE
from bev_preheat.recording.player import Changes, Played, Player

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

    from bev_preheat.recording.flight_file import Flight, Given
    from bev_preheat.recording.history import History
    from bev_preheat.recording.recorded_steps import RecordedStep


class Replayed(NamedTuple):
    """A Course, its Comparison with the recorded commands, sentences on unusual inputs, and the HeaterShares."""

    course: Course
    comparison: Comparison
    remarks: tuple[str, ...] = ()
    heater: HeaterShares | None = None


class Watcher(NamedTuple):
    """Who follows a replay: `tell(steps)` is called now and then, `history` collects a report's curves."""

    tell: Callable[[int], object] = lambda steps: None
    history: History | None = None


NOBODY = Watcher()


def replay(flight: Flight, period: Period = WHOLE, watcher: Watcher = NOBODY) -> Replayed:
    """Return the Replayed flight, unchanged; a log's course has the recorded power of the heater."""
    course, inputs, heater = Course(), InputRemarks(), HeaterShares(flight)
    steps = _until(_heeded(played_steps(flight, Player(flight)), heater), period)
    comparison = compare(_watched(_noted(steps, course, period, watcher, flight), inputs, period, flight), period,
                         flight.power_tolerance_w, flight.has_commands)
    return Replayed(course, comparison, tuple(inputs.sentences), heater)


def replay_changed(flight: Flight, changes: Changes, period: Period = WHOLE,
                   watcher: Watcher = NOBODY, heater: HeaterShares | None = None) -> Course:
    """
    Return the Course with Changes.

    Battery states differ from the recorded ones by the heat that the changed command brings (`Deviation`).
    `heater` has the share of a command that the heater delivers; None: the whole command.
    """
    course = Course()
    closed_loop = _ChangedBattery(flight, changes, HeaterShares(flight) if heater is None else heater)
    for _ in _noted(_until(closed_loop.steps(), period), course, period, watcher, flight, has_planner=True):
        pass
    return course


def played_steps(flight: Flight, player: Player) -> Iterator[tuple[Given, Played]]:
    """Yield each recorded step with its replay."""
    for given in flight.given:
        yield given, player.play(given)


def _heeded(steps: Iterator[tuple[Given, Played]], heater: HeaterShares) -> Iterator[tuple[Given, Played]]:
    for given, played in steps:
        heater.add(played)
        yield given, played


def _until(steps: Iterator[tuple[Given, Played]], period: Period) -> Iterator[tuple[Given, Played]]:
    """Yield the steps up to the first one after a Period."""
    for given, played in steps:
        if given.step.now_ns > period.to_ns:
            return
        yield given, played


def _noted(steps: Iterator[tuple[Given, Played]], course: Course, period: Period, watcher: Watcher,
           flight: Flight, has_planner: bool = False) -> Iterator[tuple[Given, Played]]:
    # The recorded power of a log's heater holds until the next one.
    power_w, until_ns = 0.0, 0
    begin, is_log = flight.begin, flight.is_log and not has_planner
    for number, (given, played) in enumerate(steps, start=1):
        if given.step.command is not None:
            power_w, until_ns = given.step.command[:2]
        if number > begin and period.has(given.step.now_ns):
            recorded_w = (power_w if until_ns >= given.step.now_ns else 0.0) if is_log else None
            course.add(played, recorded_w)
            if watcher.history is not None:
                watcher.history.add(played, recorded_w)
        if number % 100 == 0:
            watcher.tell(number)
        yield given, played


def _watched(steps: Iterator[tuple[Given, Played]], inputs: InputRemarks, period: Period,
             flight: Flight) -> Iterator[tuple[Given, Played]]:
    begin = flight.begin
    for number, (given, played) in enumerate(steps, start=1):
        if number > begin and period.has(given.step.now_ns):
            inputs.add(given, played)
        yield given, played


class _ChangedBattery:
    """Plays with Changes, and lets the battery deviate by the difference of the commands."""

    def __init__(self, flight: Flight, changes: Changes, heater: HeaterShares) -> None:
        self._flight, self._heater, self._share = flight, heater, 1.0
        self._player = Player(flight, changes, self._alter, self._alter_heater)
        # The car stays as recorded; a changed vehicle file changes only the planner's model.
        self._deviation = Deviation(Player(flight).state.vehicle)
        self._recorded_w, self._recorded_until_ns = 0.0, 0
        self._now_ns = 0

    def steps(self) -> Iterator[tuple[Given, Played]]:
        for number, given in enumerate(self._flight.given):
            self._now_ns, self._share = given.step.now_ns, self._heater.at(number)
            played = self._player.play(given)
            self._take(given.step)
            yield given, played

    def _take(self, step: RecordedStep) -> None:
        if step.command is not None:
            self._recorded_w, self._recorded_until_ns = step.command[0], step.command[1]

    def _alter(self, message: Any) -> None:
        recorded_w = 0.0 if self._recorded_until_ns < self._now_ns else self._recorded_w
        self._deviation.advance(self._now_ns, self._share * (self._changed_w() - recorded_w), message.percentage,
                                message.temperature)
        self._deviation.alter(message)

    def _alter_heater(self, message: Any) -> None:
        alter_status(message, self._changed_w(), self._share)

    def _changed_w(self) -> float:
        command = self._player.state.latest_command
        return 0.0 if command is None or command.valid_until_ns < self._now_ns else command.battery_heating_power_w
