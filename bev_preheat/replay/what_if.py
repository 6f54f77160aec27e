# SPDX-License-Identifier: Apache-2.0
"""A flight replayed as it was, or with changes; the battery follows the changed command."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.replay.comparison import compare, Comparison
from bev_preheat.replay.course import Course
from bev_preheat.replay.deviation import Deviation
from bev_preheat.replay.player import Changes, Played, Player

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    from bev_preheat.flight_recorder.steps import RecordedStep
    from bev_preheat.replay.flight_file import Flight, Given


class Replayed(NamedTuple):
    """A Course, and how it compares with the recorded commands."""

    course: Course
    comparison: Comparison


def replay(flight: Flight, tell: Callable[[int], object] = lambda steps: None) -> Replayed:
    """Return the Replayed flight, unchanged; `tell(steps)` is called now and then with the steps done."""
    course = Course()
    comparison = compare(_noted(played_steps(flight, Player(flight.beginning)), course, tell))
    return Replayed(course, comparison)


def replay_changed(flight: Flight, changes: Changes, tell: Callable[[int], object] = lambda steps: None) -> Course:
    """
    Return the Course with Changes.

    Battery states differ from the recorded ones by the heat that the changed command brings (`Deviation`).
    """
    course = Course()
    closed_loop = _ChangedBattery(flight, changes)
    for _ in _noted(closed_loop.steps(), course, tell):
        pass
    return course


def played_steps(flight: Flight, player: Player) -> Iterator[tuple[Given, Played]]:
    """Yield each recorded step with its replay."""
    for given in flight.given:
        yield given, player.play(given)


def _noted(steps: Iterator[tuple[Given, Played]], course: Course,
           tell: Callable[[int], object]) -> Iterator[tuple[Given, Played]]:
    for number, (given, played) in enumerate(steps, start=1):
        course.add(played)
        if number % 100 == 0:
            tell(number)
        yield given, played


class _ChangedBattery:
    """Plays with Changes, and lets the battery deviate by the difference of the commands."""

    def __init__(self, flight: Flight, changes: Changes) -> None:
        self._flight = flight
        self._player = Player(flight.beginning, changes, self._alter)
        # The car is the one that was recorded; a changed vehicle file is only what the planner believes.
        self._deviation = Deviation(Player(flight.beginning).state.vehicle)
        self._recorded_w, self._recorded_until_ns = 0.0, 0
        self._now_ns = 0

    def steps(self) -> Iterator[tuple[Given, Played]]:
        for given in self._flight.given:
            self._now_ns = given.step.now_ns
            played = self._player.play(given)
            self._take(given.step)
            yield given, played

    def _take(self, step: RecordedStep) -> None:
        if step.command is not None:
            self._recorded_w, self._recorded_until_ns = step.command[0], step.command[1]

    def _alter(self, message: Any) -> None:
        command = self._player.state.latest_command
        changed_w = 0.0 if command is None or command.valid_until_ns < self._now_ns \
            else command.battery_heating_power_w
        recorded_w = 0.0 if self._recorded_until_ns < self._now_ns else self._recorded_w
        self._deviation.advance(self._now_ns, changed_w - recorded_w, message.percentage, message.temperature)
        self._deviation.alter(message)
