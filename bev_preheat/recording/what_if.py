# SPDX-License-Identifier: Apache-2.0
"""A flight replayed as it was, or with changes; the battery follows the changed command."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.recording.comparison import Comparison
from bev_preheat.recording.course import Course
from bev_preheat.recording.deviation import Deviation
from bev_preheat.recording.flight import InputRemarks, Period, WHOLE
from bev_preheat.recording.heater_account import alter_status, HeaterShares
from bev_preheat.recording.player import Player

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

    from bev_preheat.recording.changes import Changes
    from bev_preheat.recording.flight import Flight, Given
    from bev_preheat.recording.history import History
    from bev_preheat.recording.player import Played

# Steps between two reports to a watcher.
REPORTED_EACH = 100


class Replayed(NamedTuple):
    """A Course, its Comparison with the recorded commands, sentences on unusual inputs, and the HeaterShares."""

    course: Course
    comparison: Comparison
    remarks: tuple[str, ...]
    heater: HeaterShares


class Watcher(NamedTuple):
    """Who follows a replay: `tell(steps)` is called now and then, `history` collects a report's curves."""

    tell: Callable[[int], object] = lambda steps: None
    history: History | None = None

    def see(self, course: Course, played: Played) -> None:
        """Add a step to the Course and the History."""
        course.add(played)
        if self.history is not None:
            self.history.add(played)


NOBODY = Watcher()


class _RecordedHeat:
    """The recorded power [W]: that of the latest command until the end of its lease."""

    _power_w, _until_ns = 0.0, 0

    def take(self, given: Given) -> None:
        if given.step.command is not None:
            self._power_w, self._until_ns = given.step.command[:2]

    def at(self, now_ns: int) -> float:
        return self._power_w if self._until_ns >= now_ns else 0.0


def replay(flight: Flight, period: Period = WHOLE, watcher: Watcher = NOBODY) -> Replayed:
    """Return the Replayed flight, unchanged; a log's course has the recorded power of the heater."""
    course, inputs, heater, player = Course(), InputRemarks(), HeaterShares(flight), Player(flight)
    comparison, heat = Comparison(tolerance_w=flight.power_tolerance_w), _RecordedHeat()
    for number, given, is_shown in _steps(flight, period, watcher):
        played = player.play(given)
        heater.add(played)
        heat.take(given)
        if flight.has_commands and period.has(given.step.now_ns):
            comparison.add(number, given.step, played.output.command)
        if is_shown:
            inputs.add(given, played)
            watcher.see(course, played._replace(
                recorded_w=heat.at(given.step.now_ns) if flight.is_log else None))
    return Replayed(course, comparison, tuple(inputs.sentences), heater)


def replay_changed(flight: Flight, changes: Changes, period: Period = WHOLE,
                   watcher: Watcher = NOBODY, heater: HeaterShares | None = None) -> Course:
    """
    Return the Course with Changes.

    Battery states differ from the recorded ones by the heat that the changed command brings (`Deviation`).
    `heater` has the share of a command that the heater delivers; None: the whole command.
    """
    course, heat, shares = Course(), _RecordedHeat(), HeaterShares(flight) if heater is None else heater
    # The car stays as recorded; a changed vehicle file changes only the planner's model.
    vehicle = Player(flight).state.vehicle
    if vehicle.heat_sources:
        raise InvalidInput(f'{vehicle.name}: its drive cannot be replayed with changes, because the heat of its '
                           'heat_sources in another drive is not computed')
    deviation = Deviation(vehicle)
    now_ns, share = 0, 1.0

    def changed_w() -> float:
        command = player.state.latest_command
        return 0.0 if command is None or command.valid_until_ns < now_ns else command.battery_heating_power_w

    def alter(message: Any) -> None:
        deviation.advance(now_ns, share * (changed_w() - heat.at(now_ns)), message.percentage, message.temperature)
        deviation.alter(message)

    player = Player(flight, changes, alter, lambda message: alter_status(message, changed_w(), share))
    for number, given, is_shown in _steps(flight, period, watcher):
        now_ns, share = given.step.now_ns, shares.at(number)
        played = player.play(given)
        heat.take(given)
        if is_shown:
            watcher.see(course, played)
    return course


def _steps(flight: Flight, period: Period, watcher: Watcher) -> Iterator[tuple[int, Given, bool]]:
    """Yield number and Given of each step up to the end of a Period, and whether the step lies in it."""
    begin = flight.begin
    for number, given in enumerate(flight.given):
        if given.step.now_ns > period.to_ns:
            return
        yield number, given, number >= begin and period.has(given.step.now_ns)
        if number % REPORTED_EACH == 0:
            watcher.tell(number)
