# SPDX-License-Identifier: Apache-2.0
"""A scenario driven in this process and recorded as the node records: real messages, without DDS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

from bev_preheat.control.events import Event
from bev_preheat.control.inputs import Mission, Progress
from bev_preheat.control.supervisor import StepOutput, Supervisor
from bev_preheat.messages.battery_state import battery_event, reading_message
from bev_preheat.messages.inputs import RouteIntake
from bev_preheat.messages.preheat_plan import plan_message, temperature_message
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.messages.route_progress import progress_event, progress_message
from bev_preheat.nodes.flight_recording import FlightRecorder, Setup
from bev_preheat.recording.ring import KeptRecording
from bev_preheat.simulation.scenario import Scenario
from bev_preheat.simulation.scenario_drive import drive_scenario, DriveRecord
from bev_preheat.simulation.sensors import Reading
from bev_preheat.simulation.supervised_drive import START_NS, Wire
from bev_preheat.vehicle import vehicle_contents

# A folder of one drive is never too large [MB].
UNBOUNDED_MB = 1e9
# Steps between two waits for the disk: fewer than the writer holds.
STEPS_AT_ONCE = 1000


def drive_recorded(scenario: Scenario, recording: Path, warn: Callable[[str], object],
                   progress: Callable[[float, float], object] = lambda time_s, total_s: None) -> DriveRecord:
    """
    Return the DriveRecord of a Scenario, and keep the planner's flight recording in the file `recording`.

    Needs the package mcap. `warn` takes sentences on failed writes; `progress(time_s, total_s)` is
    called during the drive. Raises OSError.
    """
    kept = KeptRecording(recording)
    with ExitStack() as stack:
        folder = str(kept.parameters(stack)['flight_recorder'])
        wires: list[MessageWire] = []

        def wire(supervisor: Supervisor) -> MessageWire:
            wires.append(MessageWire(supervisor, scenario, folder, warn))
            return wires[-1]

        record = drive_scenario(scenario, progress, wire)
        for each in wires:
            each.close()
        kept.keep()
    return record


class MessageWire(Wire):
    """Makes each input a message, reads it as the node does, and records the steps."""

    def __init__(self, supervisor: Supervisor, scenario: Scenario, folder: str,
                 warn: Callable[[str], object]) -> None:
        super().__init__(supervisor)
        self._supervisor, self._capacity_ah = supervisor, scenario.vehicle.battery.capacity_ah
        self._routes = RouteIntake()
        # The events of an instant are made before the first of them is a step.
        self._coming: list[tuple[Event, Any]] = []
        self._steps = 0
        self._recorder = FlightRecorder('/planner', True, '/{}'.format, warn, warn)
        self._recorder.attach(
            folder, UNBOUNDED_MB, Setup(dict(scenario.planner), vehicle_contents(scenario.vehicle_name)),
            supervisor.state, START_NS)

    def route(self, mission: Mission) -> Event:
        """Return the event of a route plan."""
        return self._carried(route_plan_message(mission),
                             lambda message: self._routes.read(message, self._supervisor.state.inbox))

    def progress(self, progress: Progress) -> Event:
        """Return the event of a position."""
        return self._carried(progress_message(progress), progress_event)

    def battery(self, reading: Reading, stamp_ns: int) -> Event:
        """Return the event of a battery state."""
        return self._carried(reading_message(reading, self._capacity_ah, stamp_ns), battery_event)

    def stepped(self, now_ns: int, events: Sequence[Event], output: StepOutput) -> None:
        """Record a step."""
        message = None
        if events:
            event, message = self._coming.pop(0)
            assert event is events[0]
        self._recorder.note(self._supervisor.state, now_ns, tuple(events), message, output)
        if output.decision is not None:
            plan = plan_message(output.decision, self._supervisor.state.active_mission, now_ns,
                                self._supervisor.later_decisions())
            self._recorder.note_plan(now_ns, plan, temperature_message(output.decision, now_ns))
        self._steps += 1
        if self._steps % STEPS_AT_ONCE == 0:
            self._recorder.catch_up()

    def close(self) -> None:
        """Write the rest of the recording."""
        self._recorder.catch_up()
        self._recorder.close()

    def _carried(self, message: Any, read: Callable[[Any], Event]) -> Event:
        """Return the event of a message as it comes out of DDS: some fields have fewer digits there."""
        carried = deserialize_message(serialize_message(message), type(message))
        self._coming.append((read(carried), carried))
        return self._coming[-1][0]
