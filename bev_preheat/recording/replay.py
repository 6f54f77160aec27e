# SPDX-License-Identifier: Apache-2.0
"""A flight put through the planner's step again, as it was or with changes, to which the battery responds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

from bev_preheat.control.events import BATTERY_STATE, Event, Reconfigured, ROUTE_PLAN
from bev_preheat.control.heater import HEATER_STATUS, SOURCE_STATUS
from bev_preheat.control.settings import FIELD_OF_PARAMETER, Settings, settings_of
from bev_preheat.control.state import State
from bev_preheat.control.state_bytes import state_of
from bev_preheat.control.supervisor import StepOutput, Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.inputs import INPUTS, RouteIntake
from bev_preheat.recording.battery_response import BatteryResponse, SourceHeat
from bev_preheat.recording.changes import Changes, with_keys
from bev_preheat.recording.comparison import Comparison
from bev_preheat.recording.course import Course
from bev_preheat.recording.flight import Flight, Given, InputRemarks, Period, Start, WHOLE
from bev_preheat.recording.heater_account import alter_status, RecordedHeat
from bev_preheat.recording.history import History
from bev_preheat.recording.records import (
    event_of,
    FAIL,
    GoalNumbers,
    learned_of,
    read_message,
    RECONFIGURED,
    RecordedStep,
    STOP,
)
from bev_preheat.vehicle import vehicle_contents
from bev_preheat.vehicle.description import HVCH, Vehicle
from bev_preheat.vehicle.loading import vehicle_of_text

RECORDED_VEHICLE = 'the recorded vehicle file'


class Played(NamedTuple):
    """A step: instant [ns], StepOutput, State after it; power [W] recorded without a planner, None: it has one."""

    now_ns: int
    output: StepOutput
    state: State
    recorded_w: float | None = None


class Player:
    """
    A Supervisor that is given recorded steps one after the other.

    `alter(message)` may change a battery state before it is read, `alter_heater(message)` an answer of a heat
    source's controller; None: they stay as recorded.
    """

    def __init__(self, flight: Flight, changes: Changes = Changes(),
                 alter: Callable[[Any], None] | None = None,
                 alter_heater: Callable[[Any], None] | None = None) -> None:
        """Start as the planner did, or from its recorded state; raises InvalidInput on vehicle or parameters."""
        self._changes, self._alter, self._alter_heater = changes, alter, alter_heater
        self._beginning, self._number = flight.beginning, 0
        self._vehicles: dict[str, Vehicle] = {}
        self._routes, self._goals = RouteIntake(), GoalNumbers()
        # The planner's states at the start, and after steps that are missing.
        self._starts = {start.at: start for start in flight.starts
                        if start.at == 0 or any(0 < gap <= start.at for gap in flight.gaps)}
        self._supervisor = Supervisor(
            self._vehicle(self._beginning.vehicle_file), self._settings(self._beginning.parameters))
        self._go_on_from(self._starts.pop(0, None))

    @property
    def state(self) -> State:
        """The State after the latest step."""
        return self._supervisor.state

    def play(self, given: Given) -> Played:
        """Take a recorded step; raises InvalidInput if its message or its events cannot be read."""
        step, now_ns = given.step, given.step.now_ns
        self._go_on_from(self._starts.pop(self._number, None))
        self._number += 1
        if step.call == FAIL:
            output = self._supervisor.fail(now_ns, step.what)
        elif step.call == STOP:
            output = self._supervisor.stop(now_ns)
        else:
            output = self._supervisor.step(now_ns, *(self._event(values, given) for values in step.events))
        if output.decision is not None:
            # As the node does to publish the plan.
            self._supervisor.later_decisions()
        return Played(now_ns, output, self._supervisor.state)

    def _go_on_from(self, start: Start | None) -> None:
        """Go on from a recorded state, changed as the Changes say; None: as it is."""
        if start is None:
            return
        state = state_of(start.recorded.state)
        if start.recorded.goal is not None and state.preparation.goal is not None:
            self._goals.numbers[state.preparation.goal] = start.recorded.goal
        if self._changes.has_recorded_vehicle:
            self._vehicles = {self._beginning.vehicle_file: state.vehicle}
        mission = state.inbox.latest_mission
        if start.route is not None and mission is not None:
            message = read_message(*start.route)
            for change in self._changes.signals:
                change.alter_route(message)
            self._routes.remember(mission, message)
        self._supervisor.go_on_from(state)
        if self._changes.is_nothing:
            return
        vehicle, settings = self._vehicle(self._beginning.vehicle_file), self._settings(self._beginning.parameters)
        if state.now_ns:
            self._supervisor.step(state.now_ns, Reconfigured(
                vehicle, settings, self._routes.read_again(state.inbox, vehicle, settings)))
        elif self._changes.has_recorded_vehicle:
            self._supervisor.go_on_from(state._replace(inbox=state.inbox._replace(settings=settings)))
        else:
            # Another vehicle file starts without learned values.
            self._supervisor = Supervisor(
                vehicle, settings, last_seen=state.last_seen, choices=state.inbox.choices)

    def _event(self, values: dict[str, Any], given: Given) -> Event:
        kind, hint = values.get('kind'), str(values.get('hint', ''))
        state = self._supervisor.state
        if kind == RECONFIGURED:
            # A recorded Learned is that of another file; a changed vehicle keeps its own learned values.
            vehicle, settings = self._vehicle(str(values['vehicle_file'])), self._settings(values['parameters'])
            return Reconfigured(vehicle, settings, self._routes.read_again(state.inbox, vehicle, settings),
                                learned_of(values['learned']) if self._changes.has_recorded_vehicle else None)
        if kind not in INPUTS:
            return event_of(values, self._goals)
        if given.message is None:
            raise InvalidInput('a step of the recording has lost its message')
        message = read_message(*given.message)
        if kind == ROUTE_PLAN:
            for change in self._changes.signals:
                change.alter_route(message)
        elif kind in (HEATER_STATUS, SOURCE_STATUS) and self._alter_heater is not None:
            self._alter_heater(message)
        elif kind == BATTERY_STATE:
            if self._alter is not None:
                self._alter(message)
            for change in self._changes.signals:
                change.alter_battery(message)
        return INPUTS[kind].event(message, state, self._routes, hint)

    def _vehicle(self, text: str) -> Vehicle:
        """Return the Vehicle of a file's text, or the changed one; the same object for the same text."""
        if text not in self._vehicles:
            name, keys = self._changes.vehicle, self._changes.vehicle_keys
            contents = text if name is None else vehicle_contents(name).decode('utf-8', 'replace')
            self._vehicles[text] = vehicle_of_text(with_keys(contents, keys), name or RECORDED_VEHICLE)
        return self._vehicles[text]

    def _settings(self, parameters: Mapping[str, Any]) -> Settings:
        recorded = {name: value for name, value in parameters.items() if name in FIELD_OF_PARAMETER}
        return settings_of({**recorded, **self._changes.parameters})


# Steps between two reports to a watcher.
REPORTED_EACH = 100


class Replayed(NamedTuple):
    """A Course, its Comparison with the recorded commands, sentences on unusual inputs, and the RecordedHeat."""

    course: Course
    comparison: Comparison
    remarks: tuple[str, ...]
    heater: RecordedHeat


class _Commanded:
    """The recorded power [W] of each heat source: that of the latest command until the end of its lease."""

    _step: RecordedStep | None = None

    def take(self, given: Given) -> None:
        if given.step.command is not None:
            self._step = given.step

    def at(self, now_ns: int, name: str = HVCH) -> float:
        step = self._step
        return 0.0 if step is None or step.command is None or step.command[1] < now_ns else step.command_w(name)


def replay(flight: Flight, period: Period = WHOLE, tell: Callable[[int], object] = lambda steps: None,
           history: History | None = None) -> Replayed:
    """
    Return the Replayed flight, unchanged; a log's course has the recorded power of the heater.

    `tell(steps)` is called now and then; `history` collects the curves of a report.
    """
    course, inputs, player = Course(), InputRemarks(), Player(flight)
    heater = RecordedHeat(flight, player.state.vehicle)
    comparison, heat = Comparison(tolerance_w=flight.power_tolerance_w), _Commanded()
    for number, given, is_shown in _steps(flight, period, tell):
        played = player.play(given)
        heater.add(played)
        heat.take(given)
        if flight.has_commands and period.has(given.step.now_ns):
            comparison.add(number, given.step, played.output.command)
        if is_shown:
            inputs.add(given, played)
            shown = played._replace(recorded_w=heat.at(given.step.now_ns) if flight.is_log else None)
            course.add(shown)
            if history is not None:
                history.add(shown)
    return Replayed(course, comparison, tuple(inputs.sentences), heater)


def replay_changed(flight: Flight, changes: Changes, period: Period = WHOLE,
                   tell: Callable[[int], object] = lambda steps: None, history: History | None = None,
                   heater: RecordedHeat | None = None) -> Course:
    """
    Return the Course with Changes; `tell` and `history` as for `replay`.

    Battery states differ from the recorded ones by the heat that the changed commands bring (`BatteryResponse`).
    `heater` has the shares of their commands that the heat sources deliver; None: the whole commands.
    """
    course, heat = Course(), _Commanded()
    # The car stays as recorded; a changed vehicle file changes only the planner's model.
    vehicle = Player(flight).state.vehicle
    if vehicle.heat_sources and flight.is_log:
        raise InvalidInput(f'{vehicle.name}: a log has no powers of its heat_sources; name a vehicle file without')
    recorded = RecordedHeat(flight, vehicle) if heater is None else heater
    response, sources = BatteryResponse(vehicle), SourceHeat(vehicle)
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
                                  (changed_w, recorded_c + response.temperature_k)))
        response.advance(now_ns, after_w - before_w, after_heat_w - before_heat_w, message.percentage, recorded_c)
        response.alter(message)

    def alter_answer(message: Any) -> None:
        name = getattr(message, 'name', HVCH)
        alter_status(message, changed_w(name), recorded.share_at(now_at, name))

    player = Player(flight, changes, alter, alter_answer)
    for number, given, is_shown in _steps(flight, period, tell):
        now_ns, now_at = given.step.now_ns, number
        played = player.play(given)
        heat.take(given)
        if is_shown:
            course.add(played)
            if history is not None:
                history.add(played)
    return course


def _steps(flight: Flight, period: Period, tell: Callable[[int], object]) -> Iterator[tuple[int, Given, bool]]:
    """Yield number and Given of each step up to the end of a Period, and whether the step lies in it."""
    begin = flight.begin
    for number, given in enumerate(flight.given):
        if given.step.now_ns > period.to_ns:
            return
        yield number, given, number >= begin and period.has(given.step.now_ns)
        if number % REPORTED_EACH == 0:
            tell(number)
