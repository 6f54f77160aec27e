# SPDX-License-Identifier: Apache-2.0
"""A flight replayed as it was, or with changes; the battery follows the changed command."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.recording.comparison import Comparison
from bev_preheat.recording.course import Course
from bev_preheat.recording.deviation import Deviation, SourceHeat
from bev_preheat.recording.flight import InputRemarks, Period, WHOLE
from bev_preheat.recording.heater_account import alter_status, RecordedHeat
from bev_preheat.recording.player import Player
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

    from bev_preheat.recording.changes import Changes
    from bev_preheat.recording.flight import Flight, Given
    from bev_preheat.recording.history import History
    from bev_preheat.recording.player import Played
    from bev_preheat.recording.records import RecordedStep

# Steps between two reports to a watcher.
REPORTED_EACH = 100


class Replayed(NamedTuple):
    """A Course, its Comparison with the recorded commands, sentences on unusual inputs, and the RecordedHeat."""

    course: Course
    comparison: Comparison
    remarks: tuple[str, ...]
    heater: RecordedHeat


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


class _Commanded:
    """The recorded power [W] of each heat source: that of the latest command until the end of its lease."""

    _step: RecordedStep | None = None

    def take(self, given: Given) -> None:
        if given.step.command is not None:
            self._step = given.step

    def at(self, now_ns: int, name: str = HVCH) -> float:
        step = self._step
        return 0.0 if step is None or step.command is None or step.command[1] < now_ns else step.command_w(name)


def replay(flight: Flight, period: Period = WHOLE, watcher: Watcher = NOBODY) -> Replayed:
    """Return the Replayed flight, unchanged; a log's course has the recorded power of the heater."""
    course, inputs, player = Course(), InputRemarks(), Player(flight)
    heater = RecordedHeat(flight, player.state.vehicle)
    comparison, heat = Comparison(tolerance_w=flight.power_tolerance_w), _Commanded()
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
                   watcher: Watcher = NOBODY, heater: RecordedHeat | None = None) -> Course:
    """
    Return the Course with Changes.

    Battery states differ from the recorded ones by the heat that the changed commands bring (`Deviation`).
    `heater` has the shares of their commands that the heat sources deliver; None: the whole commands.
    """
    course, heat = Course(), _Commanded()
    # The car stays as recorded; a changed vehicle file changes only the planner's model.
    vehicle = Player(flight).state.vehicle
    if vehicle.heat_sources and flight.is_log:
        raise InvalidInput(f'{vehicle.name}: a log has no powers of its heat_sources; name a vehicle file without')
    recorded = RecordedHeat(flight, vehicle) if heater is None else heater
    deviation, sources = Deviation(vehicle), SourceHeat(vehicle)
    names = HVCH, *(source.name for source in vehicle.heat_sources)
    now_ns = now_at = 0

    def changed_w(name: str = HVCH) -> float:
        command = player.state.latest_command
        return 0.0 if command is None or command.valid_until_ns < now_ns else command.power_w(name)

    def alter(message: Any) -> None:
        recorded_c, air_c = message.temperature, recorded.ambient_c(now_at)
        (before_w, before_heat_w), (after_w, after_heat_w) = (
            sources.of({name: recorded.share_at(now_at, name) * power_w(name) for name in names}, air_c, at_c)
            for power_w, at_c in ((partial(heat.at, now_ns), recorded_c),
                                  (changed_w, recorded_c + deviation.temperature_k)))
        deviation.advance(now_ns, after_w - before_w, after_heat_w - before_heat_w, message.percentage, recorded_c)
        deviation.alter(message)

    def alter_answer(message: Any) -> None:
        name = getattr(message, 'name', HVCH)
        alter_status(message, changed_w(name), recorded.share_at(now_at, name))

    player = Player(flight, changes, alter, alter_answer)
    for number, given, is_shown in _steps(flight, period, watcher):
        now_ns, now_at = given.step.now_ns, number
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
