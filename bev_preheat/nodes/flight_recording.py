# SPDX-License-Identifier: Apache-2.0
"""Records the planner's inputs and answers; see bev_preheat/recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import datetime, UTC
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Temperature

from bev_preheat.control.decision import Command
from bev_preheat.control.events import Event, Reconfigured, ROUTE_PLAN, RouteArrived
from bev_preheat.control.state import State
from bev_preheat.control.state_bytes import state_bytes
from bev_preheat.control.supervisor import StepOutput
from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import version
from bev_preheat.messages.diagnostics import judged
from bev_preheat.messages.heater import command_message, source_messages
from bev_preheat.messages.inputs import INPUTS
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.recording import records
from bev_preheat.recording.ring import check_folder
from bev_preheat.recording.writer import (
    BEGINNING_CHANNEL,
    Entry,
    Kind,
    Recording,
    RecordingWriter,
    STATE_CHANNEL,
    STEP_CHANNEL,
)
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, PreheatPlan, RoutePlan

PLAN, PREDICTION = 'preheat_plan', 'predicted_arrival_temperature'
TYPES = {**{topic: each.message_type for topic, each in INPUTS.items()}, records.COMMAND: HvchCommand,
         records.SOURCE_COMMAND: HeatSourceCommand, PLAN: PreheatPlan, PREDICTION: Temperature}
# A replay may start at a recorded state; each takes some milliseconds of the writing thread [ns].
STATE_PERIOD_NS = 60 * NS_PER_S
# Every plan follows from the inputs, so only some are written, for viewers [ns].
PLAN_PERIOD_NS = 10 * NS_PER_S
BYTES_PER_MB = 1_000_000


class Setup(NamedTuple):
    """Parameters of the node by name, and the bytes of its vehicle file."""

    parameters: dict[str, Any]
    vehicle_contents: bytes


class FlightRecorder:
    """Records a planner's steps if `flight_recorder` names a folder; never raises, never waits; see `problem`."""

    def __init__(self, planner: str, uses_sim_time: bool, topic_name: Callable[[str], str],
                 warn: Callable[[str], object], inform: Callable[[str], object]) -> None:
        """Take the planner's full name, whether its clock is /clock, the full names of its topics, and its log."""
        self._planner, self._uses_sim_time, self._topic_name = planner, uses_sim_time, topic_name
        self._warn, self._inform, self._life = warn, inform, ''
        self._topics: dict[str, str] = {}
        self._writer: RecordingWriter | None = None
        self._where: tuple[str, float] = ('', 0.0)
        self._goals = records.GoalNumbers()
        self._setup = Setup({}, b'')
        self._plan_due_ns, self._plan_status = 0, -1
        # After the latest recorded step, with its setup and the message of its route; used by the writing thread.
        self._state: State | None = None
        self._state_setup = self._setup
        self._route: Entry | None = None
        self._state_ns = 0
        self._failure, self._told = '', ''

    @property
    def problem(self) -> str:
        """The sentence on what keeps it from recording; '' if nothing does."""
        return self._failure or ('' if self._writer is None else self._writer.report)

    def attach(self, folder: str, megabytes: float, setup: Setup, state: State, now_ns: int,
               route: RoutePlan | None = None) -> None:
        """
        Record into a folder ('': record nothing) of at most `megabytes` [MB] from now on.

        `state` is the planner's State, `route` the message of its route. A folder that is used stays in use.
        """
        self._setup = setup
        if (folder, megabytes) == self._where:
            return
        self.close()
        self._where, self._failure = (folder, megabytes), ''
        if not folder:
            return
        started = datetime.now(UTC).strftime('%Y%m%dT%H%M%S')
        try:
            check_folder(folder)
            self._life, self._topics = uuid4().hex[:8], {topic: self._topic_name(topic) for topic in TYPES}
            kinds = {self._topics[topic]: _kind(message_type) for topic, message_type in TYPES.items()}
            self._state, self._state_setup, self._route = state, setup, None if route is None else Entry(
                self._topics[ROUTE_PLAN], now_ns, route)
            self._writer = RecordingWriter(
                Recording(Path(folder).expanduser(), round(megabytes * BYTES_PER_MB), self._life, started), kinds,
                lambda: self._head(now_ns))
        except Exception as error:
            self._failure = str(error) if isinstance(error, InvalidInput) else f'{type(error).__name__}: {error}'
        self.tell()

    def _head(self, now_ns: int) -> Iterable[Entry]:
        """Return the entries of a file's start; called by the writing thread."""
        state, setup = self._state, self._state_setup
        assert state is not None
        now_ns = state.now_ns or now_ns
        beginning = records.Beginning(
            version(), self._planner, self._life, 0, now_ns, self._uses_sim_time, setup.parameters,
            setup.vehicle_contents.decode('utf-8', 'replace'))
        yield Entry(BEGINNING_CHANNEL, now_ns, beginning.as_dictionary())
        if self._route is not None and state.inbox.latest_mission is not None:
            yield self._route
        yield self._state_entry(state, now_ns)

    def _state_entry(self, state: State, now_ns: int) -> Entry:
        self._state_ns = now_ns
        goal, route = state.preparation.goal, self._route
        return Entry(STATE_CHANNEL, now_ns, records.RecordedState(
            state_bytes(state), None if goal is None else self._goals.number(goal),
            None if route is None or state.inbox.latest_mission is None else route.now_ns).as_dictionary())

    def note(self, state: State, now_ns: int, events: tuple[Event, ...], message: Any, output: StepOutput,
             call: str = records.STEP, what: str = '') -> None:
        """Record a step: the State after it, its events, the message of the first (None: no event), its output."""
        if self._writer is not None:
            decision = output.decision
            self._writer.put_group(partial(
                self._entries, state, now_ns, events, message, output.command,
                None if decision is None else decision.status, call, what, self._setup))

    def _entries(self, state: State, now_ns: int, events: tuple[Event, ...], message: Any, command: Command | None,
                 status: Status | None, call: str, what: str, setup: Setup) -> Iterable[Entry]:
        """Return the entries of a step; called by the writing thread."""
        values = [_values(event, message is not None, self._goals, setup) for event in events]
        step = Entry(STEP_CHANNEL, now_ns, records.RecordedStep(
            now_ns, call, tuple(values), what, records.command_values(command), status,
            () if command is None else command.sources_w))
        entries = [step] if message is None else [Entry(self._topics[values[0]['kind']], now_ns, message), step]
        if command is not None:
            entries += [Entry(self._topics[records.SOURCE_COMMAND], now_ns, message)
                        for message in source_messages(command, state.vehicle, now_ns)]
            entries.append(Entry(self._topics[records.COMMAND], now_ns, command_message(command, now_ns)))
        latest = state.inbox.latest_mission
        if any(isinstance(event, RouteArrived) and event.mission is latest for event in events):
            self._route = entries[0]
        self._state, self._state_setup = state, setup
        if not 0 <= now_ns - self._state_ns < STATE_PERIOD_NS:
            entries.append(self._state_entry(state, now_ns))
        return entries

    def note_plan(self, now_ns: int, plan: PreheatPlan, prediction: Temperature | None) -> None:
        """Record a published plan and prediction if the status is new or PLAN_PERIOD_NS have passed."""
        writer, status = self._writer, plan.status
        if writer is None or (status == self._plan_status
                              and 0 <= self._plan_due_ns - now_ns <= PLAN_PERIOD_NS):
            return
        self._plan_status, self._plan_due_ns = status, now_ns + PLAN_PERIOD_NS
        writer.put(*(Entry(self._topics[topic], now_ns, message)
                     for topic, message in ((PLAN, plan), (PREDICTION, prediction)) if message is not None))

    def tell(self) -> None:
        """Log a new problem, or its end."""
        problem = self.problem
        if problem != self._told:
            if problem:
                self._warn(f'flight_recorder: {problem}.')
            else:
                self._inform('flight_recorder: recording again.')
            self._told = problem

    def entry(self) -> DiagnosticStatus | None:
        """Return the entry `flight recorder` of the diagnostics: WARN if it cannot record; None if it is off."""
        if not self._where[0]:
            return None
        path, dropped = ('', 0) if self._writer is None else (self._writer.path, self._writer.dropped)
        problem = self.problem or (f'{dropped} steps were not written' if dropped else '')
        return judged('flight recorder', [], [problem], 'recording', {'file': path, 'lost steps': str(dropped)})

    def catch_up(self) -> None:
        """Wait until the steps so far are written: for a drive that is faster than the disk."""
        if self._writer is not None:
            self._writer.catch_up()

    def close(self) -> None:
        """End the recording."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def _values(event: Event, has_message: bool, goals: records.GoalNumbers, setup: Setup) -> dict[str, Any]:
    values = records.event_values(event, goals, has_message)
    if isinstance(event, Reconfigured):
        values.update(parameters=setup.parameters, learned=records.learned_values(event.learned),
                      vehicle_file=setup.vehicle_contents.decode('utf-8', 'replace'))
    return values


def _kind(message_type: Any) -> Kind:
    package, name = message_type.__module__.partition('.')[0], message_type.__name__
    return Kind(f'{package}/msg/{name}', records.definition(package, name), 'ros2msg', 'cdr',
                lambda message: bytes(serialize_message(message)))
