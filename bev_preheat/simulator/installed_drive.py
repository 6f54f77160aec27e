# SPDX-License-Identifier: Apache-2.0
"""Drive a scenario with the installed planner and vehicle_simulator, over ROS."""

from __future__ import annotations

from contextlib import contextmanager, ExitStack
import math
import os
from pathlib import Path
import tempfile
import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.diagnostics import values_of
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.simulated_drive import (
    ARRIVED,
    lost_commands_sentence,
    outcome_from_diagnostics,
)
from bev_preheat.nodes.listening import listening
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.simulation.evaluation import DriveRecord, fill_phases, PhaseEnd, SIGNALS
from bev_preheat.simulation.supervised_drive import START_NS
from bev_preheat.simulator.installed_processes import NodeProcess, reserved_domain_id
from bev_preheat.simulator.kept_recording import KeptRecording
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from typing import Any

    from rclpy.node import Node

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.nodes.listening import Listener
    from bev_preheat.simulation.scenario import Scenario

START_S = START_NS / NS_PER_S
HEATER_ENTRY, SIGNALS_ENTRY = 'planner: heater', 'planner: signals'
# Real time for discovery, and between two messages of the simulator [s].
START_LIMIT_S = 120.0
SILENCE_LIMIT_S = 120.0
POLL_S = 0.05
# Messages of a topic that wait between two polls.
MOST_UNREAD = 1000
# At 60 times real time a clock message that is 20 ms late is 1.2 s late; the simulator's time runs
# no further ahead of the planner than this.
HURRIED = {'clock_tolerance': 2.0}


class ScenarioFailed(Exception):
    """A process ended, or its messages stopped; the text names the process and the reason."""


class _Recorder:
    """Fills a DriveRecord from the topics; `ends` are the ends of the drive's phases."""

    def __init__(self, node: Node, target_c: float) -> None:
        self.record = DriveRecord(target_c)
        self.ends: list[PhaseEnd] = []
        self.has_ended = False
        self.heard_s = time.monotonic() + START_LIMIT_S
        self.without_command_s = 0.0
        self._temperature_c = math.nan
        every_plan = QoSProfile(depth=MOST_UNREAD, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._node, self._listens_to_states = node, False
        self._subscriptions = [
            node.create_subscription(HvchCommand, 'hvch_command', self._on_command, MOST_UNREAD),
            node.create_subscription(PreheatPlan, 'preheat_plan', self._on_plan, every_plan),
            node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, MOST_UNREAD)]

    def let_start(self) -> None:
        """Subscribe to battery states, as the second listener, once the planner publishes."""
        if not self._listens_to_states and all(
                subscription.get_publisher_count() for subscription in self._subscriptions):
            self._listens_to_states = True
            self._node.create_subscription(BatteryState, 'battery_state', self._on_state, MOST_UNREAD)

    def _on_state(self, message: BatteryState) -> None:
        self._temperature_c = message.temperature

    def _on_command(self, message: HvchCommand) -> None:
        reason = Status(message.reason).name
        instant_s = _instant_s(message)
        if instant_s > 0.0:
            self.record.commands.append((instant_s, message.battery_heating_power, reason))
            self.record.statuses.add(reason)
            if message.battery_heating_power > 0.0 and self._temperature_c > self.record.hottest_heated_c:
                self.record.hottest_heated_c = self._temperature_c

    def _on_plan(self, message: PreheatPlan) -> None:
        if _instant_s(message) > 0.0:
            self.record.statuses.add(Status(message.status).name)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = values_of(status)
            if status.name == HEATER_ENTRY and not self.has_ended:
                self.record.note_heater(_instant_s(message), values['heater'])
            elif status.name == SIGNALS_ENTRY and _instant_s(message) > 0.0:
                self.record.regimes.append((_instant_s(message), values['regime']))
                self.record.note_signals(_instant_s(message), [
                    name for name in SIGNALS if any(key.startswith(f'{name} in doubt') for key in values)])
        outcome = outcome_from_diagnostics(message)
        if outcome is not None and not self.has_ended:
            self.heard_s, self.without_command_s = time.monotonic(), outcome.without_command_s
            self.ends = list(outcome.ends)
            self.has_ended = outcome.state == ARRIVED


def _instant_s(message: Any) -> float:
    """Seconds after the start; 0 while the clock is held, negative before the planner receives it."""
    return (nanoseconds(message.header.stamp) - START_NS) / NS_PER_S


def log_files(scenario: Scenario, folder: AnyPath) -> list[Path]:
    """Return the paths of the logs of planner and vehicle_simulator, in a folder."""
    return [Path(folder) / f'{scenario.name}.{name}.log' for name in ('planner', 'vehicle_simulator')]


def drive_with_nodes(scenario: Scenario, name_or_file: str, speed_up: float | None = None,
                     log_folder: AnyPath | None = None, recording: Path | None = None) -> DriveRecord:
    """
    Return the DriveRecord of a Scenario that the installed executables drive.

    The scenario was loaded from `name_or_file`; `speed_up` simulated seconds pass in each real one (None: in
    lockstep, the same drive on every computer); the logs go to `log_folder`, the planner's flight recording to the
    file `recording` (None: it does not record). Raises ScenarioFailed if the drive does not finish, or loses
    commands.
    """
    with tempfile.TemporaryDirectory() as temporary, reserved_domain_id() as domain_id, ExitStack() as stack:
        kept = None if recording is None else KeptRecording(recording)
        planner_log, simulator_log = log_files(scenario, log_folder or temporary)
        environment = {'ROS_DOMAIN_ID': str(domain_id),
                       'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        with _environment(environment), listening('scenario', domain_id) as listener:
            recorder = _Recorder(listener.node, scenario.goal.target_temperature_c)
            planner_arguments = ['-p', 'use_sim_time:=true',
                                 '-p', f'vehicle:={scenario.vehicle_name}']
            recorded = {} if kept is None else kept.parameters(stack)
            tolerance = {} if speed_up is None else HURRIED
            for parameter, value in {**tolerance, **scenario.planner, **recorded}.items():
                planner_arguments += ['-p', f'{parameter}:={_text(value)}']
            with NodeProcess('planner', planner_arguments, planner_log) as planner, NodeProcess(
                    'vehicle_simulator',
                    ['-p', f'scenario:={name_or_file}', '-p', f'start_time:={START_S}',
                     *(('-p', 'lockstep:=true') if speed_up is None else (
                         '-p', f'speed_up:={float(speed_up)}', '-p', 'wait_for_planner:=true')),
                     # Planner and recorder: messages before the recorder's subscription are lost.
                     '-p', 'wait_for_listeners:=2', '-p', 'exit_on_arrival:=true'],
                    simulator_log) as simulator:
                _follow(listener, recorder, simulator, planner)
            if speed_up is not None and recorder.without_command_s > 0.0:
                raise ScenarioFailed(f'{scenario.name}: the drive ended, '
                                     f'{lost_commands_sentence(recorder.without_command_s, speed_up)}')
            if kept is not None:
                kept.keep()
            fill_phases(recorder.record, scenario, recorder.ends)
            return recorder.record


def _follow(listener: Listener, recorder: _Recorder, simulator: NodeProcess, planner: NodeProcess) -> None:
    """Return once the drive is over."""
    while simulator.exit_status is None:
        if planner.exit_status is not None:
            raise ScenarioFailed(f'planner ended with exit status {planner.exit_status}: '
                                 f'{planner.output()[-2000:]}')
        if time.monotonic() > recorder.heard_s + SILENCE_LIMIT_S:
            raise ScenarioFailed(f'no message of vehicle_simulator for {SILENCE_LIMIT_S:g} s: '
                                 f'{simulator.output()[-2000:]}{planner.output()[-2000:]}')
        recorder.let_start()
        listener.listen(POLL_S)
    # Messages that were in transit at the end.
    listener.listen(POLL_S)
    if simulator.exit_status != 0:
        raise ScenarioFailed(f'vehicle_simulator ended with exit status '
                             f'{simulator.exit_status}: {simulator.output()[-2000:]}')


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables, which the processes inherit, during the block."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
