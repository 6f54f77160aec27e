# SPDX-License-Identifier: Apache-2.0
"""Drives a scenario with the installed planner and vehicle_simulator, isolated from all other ROS traffic."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, ExitStack
from functools import partial
import math
import os
from pathlib import Path
import random
import socket
import subprocess
import tempfile
import time
from typing import Any

from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
import domain_coordinator
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.control.decision import Command
from bev_preheat.files.output_files import AnyPath, existing_file
from bev_preheat.messages.diagnostics import values_of
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.preheat_plan import charging_text
from bev_preheat.nodes.listening import Listener, listening
from bev_preheat.nodes.parameters import as_typed
from bev_preheat.nodes.simulated_drive import ARRIVED, outcome_from_diagnostics, SimulatedDriveReport
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.recording.ring import KeptRecording
from bev_preheat.simulation.scenario import Scenario
from bev_preheat.simulation.scenario_drive import DriveRecord, fill_phases, HEALTHY, SIGNALS
from bev_preheat.simulation.supervised_drive import START_NS
from bev_preheat.vehicle.description import HVCH
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, PreheatPlan

# Domains whose UDP ports lie below Linux's ephemeral ports; 0 is the default domain.
DOMAIN_IDS = range(1, 101)
# UDP ports of a DDS domain (DDSI-RTPS 9.6.1.1): 250 from here, the participants' from 10 on, two each.
FIRST_PORT = 7400
PORTS_PER_DOMAIN = 250
PARTICIPANT_PORTS = range(10, 250, 2)
# Ending takes half a second, longer on a busy computer.
SECONDS_TO_END = 15.0


@contextmanager
def reserved_domain_id() -> Iterator[int]:
    """
    Reserve an unused ROS_DOMAIN_ID of this machine during the block.

    Other callers of this function and of `domain_coordinator.domain_id()` respect the reservation; other
    programs may still pick the same. Raises RuntimeError if none is left.
    """
    # Not the module's seeded generator: two test runs with one seed would compete for domains.
    candidates = iter(random.SystemRandom().sample(DOMAIN_IDS, len(DOMAIN_IDS)))
    reservation = domain_coordinator.domain_id(lambda: _next_unused(candidates))
    domain_id = reservation.__enter__()
    try:
        yield domain_id
    finally:
        # An OSError of the block must not reach it: it would take the domain for one in use.
        reservation.__exit__(None, None, None)


def _next_unused(candidates: Iterator[int]) -> int:
    """Return the next candidate that has no running participant."""
    for domain_id in candidates:
        # The first participant may be gone while a later one still runs.
        if all(_is_free(FIRST_PORT + PORTS_PER_DOMAIN * domain_id + port) for port in PARTICIPANT_PORTS):
            return domain_id
    raise RuntimeError(f'ROS domains {DOMAIN_IDS[0]} ... {DOMAIN_IDS[-1]} are all in use')


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('127.0.0.1', port))
        except OSError:
            return False
    return True


class NodeProcess(subprocess.Popen[bytes]):
    """A running installed executable, whose output goes to a file; as a context manager it is ended."""

    def __init__(self, name: str, ros_arguments: Iterable[str], log_file: AnyPath) -> None:
        """
        Start `name` with the texts of `ros_arguments` behind --ros-args.

        It inherits the environment. Raises FileNotFoundError if the package is not built, InvalidInput if the
        log cannot be a file.
        """
        self.name, self.log_file = name, Path(log_file)
        executable = Path(get_package_prefix('bev_preheat')) / 'lib' / 'bev_preheat' / name
        # Opening a pipe would wait for a reader; opening a device may have side effects.
        existing_file(self.log_file)
        with open(self.log_file, 'wb') as log:
            super().__init__(
                [str(executable), '--ros-args', *ros_arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                # Plain text in the file, even if the caller has a terminal.
                env=dict(os.environ, RCUTILS_COLORIZED_OUTPUT='0'))

    def __exit__(self, *exception: object) -> None:
        self.end()

    @property
    def exit_status(self) -> int | None:
        """None while it runs; then 0 ... 255, or -N if signal N ended it."""
        return self.poll()

    def output(self) -> str:
        """Return its output so far."""
        return self.log_file.read_text(encoding='utf-8', errors='replace')

    def end(self) -> int:
        """End it with SIGTERM, if necessary with SIGKILL, and return the exit status."""
        if self.poll() is None:
            self.terminate()
            try:
                self.wait(SECONDS_TO_END)
            except BaseException as reason:
                # It took too long, or the caller was interrupted.
                self.kill()
                if not isinstance(reason, subprocess.TimeoutExpired):
                    raise
        return self.wait()


START_S = START_NS / NS_PER_S
HEATER_ENTRY, SOURCE_ENTRY, SIGNALS_ENTRY = 'planner: heater', 'planner: heat source ', 'planner: signals'
# Real time for discovery, and between two messages of the simulator [s].
START_LIMIT_S = 180.0
SILENCE_LIMIT_S = 120.0
POLL_S = 0.05
# Statuses of a planner without a trip to plan.
WITHOUT_TRIP = (Status.NO_ROUTE, Status.NO_BATTERY_STATE)
# Messages of a topic that wait between two polls.
MOST_UNREAD = 1000


class ScenarioFailed(Exception):
    """A process ended, or its messages stopped; the text names the process and the reason."""


class ObservedDrive:
    """
    A drive as observed on its topics; instants in s after its start.

    `states` holds (instant, temperature [deg C], state of charge), `predictions` (instant, arrival temperature
    [deg C]). `first_plan` is the first PreheatPlan with a trajectory, `plan` the latest one, `charging_plan` the
    latest one with a charging session from before any heating; None: not received yet. `target_c` is the latest
    target [deg C], `report` the simulator's latest, `recording` the path of the flight recording (None: without).
    """

    def __init__(self, node: Node, target_c: float, sources: Iterable[str]) -> None:
        """Listen on a Node to a drive to a target [deg C]; `sources` are the heat sources beside the HVCH."""
        self.record = DriveRecord(target_c)
        self.states: list[tuple[float, float, float]] = []
        self.predictions: list[tuple[float, float]] = []
        self.first_plan: PreheatPlan = None
        self.plan: PreheatPlan = None
        self.charging_plan: PreheatPlan = None
        self.target_c = math.nan
        self.report: SimulatedDriveReport | None = None
        self.recording: Path | None = None
        self.heard_s = time.monotonic() + START_LIMIT_S
        self._has_heated = False
        every_plan = QoSProfile(depth=MOST_UNREAD, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._node, self._listens_to_states = node, False
        self._subscriptions = [
            node.create_subscription(HvchCommand, 'hvch_command', partial(self._on_command, HVCH), MOST_UNREAD),
            node.create_subscription(PreheatPlan, 'preheat_plan', self._on_plan, every_plan),
            node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, MOST_UNREAD)]
        # Commands of each heat source, until those of all sources with the same stamp are there.
        self._parts: dict[str, deque[Any]] = {name: deque() for name in (HVCH, *sources)}
        if len(self._parts) > 1:
            self._subscriptions.append(node.create_subscription(
                HeatSourceCommand, 'heat_source_command',
                lambda message: self._on_command(message.name, message), MOST_UNREAD))

    def let_start(self) -> None:
        """Subscribe to battery states, as the second listener, once the planner publishes."""
        if not self._listens_to_states and all(
                subscription.get_publisher_count() for subscription in self._subscriptions):
            self._listens_to_states = True
            self._node.create_subscription(BatteryState, 'battery_state', self._on_state, MOST_UNREAD)

    @property
    def has_arrived(self) -> bool:
        """Whether the drive is over."""
        return self.report is not None and self.report.state == ARRIVED

    def _on_state(self, message: BatteryState) -> None:
        self.states.append((_instant_s(message), message.temperature, message.percentage))

    def _on_command(self, name: str, message: HvchCommand | HeatSourceCommand) -> None:
        self._parts[name].append(message)
        while all(self._parts.values()):
            latest_s = max(_instant_s(parts[0]) for parts in self._parts.values())
            if incomplete := [parts for parts in self._parts.values() if _instant_s(parts[0]) < latest_s]:
                # From before the subscription to the others.
                for parts in incomplete:
                    parts.popleft()
                continue
            heads = {source: parts.popleft() for source, parts in self._parts.items()}
            hvch = heads.pop(HVCH)
            if latest_s > 0.0:
                self.record.note_command(latest_s, Command(
                    hvch.battery_heating_power, nanoseconds(hvch.valid_until), Status(hvch.reason), tuple(
                        (source, part.battery_heating_power) for source, part in heads.items())),
                    self.states[-1][1] if self.states else -math.inf)

    def _on_plan(self, message: PreheatPlan) -> None:
        instant_s = _instant_s(message)
        if instant_s > 0.0:
            self.record.statuses.add(Status(message.status).name)
        if message.status in WITHOUT_TRIP or instant_s < 0.0:
            return
        self.plan = message
        if self.first_plan is None and message.time:
            self.first_plan = message
        if math.isfinite(message.predicted_arrival_temperature):
            self.predictions.append((instant_s, message.predicted_arrival_temperature))
        if math.isfinite(message.target_battery_temperature):
            self.target_c = message.target_battery_temperature
        # Commands may arrive earlier or later than the plan with the same stamp.
        if charging_text(message) and not self._has_heated:
            self.charging_plan = message
        self._has_heated |= message.heating_planned and nanoseconds(
            message.heating_start) <= nanoseconds(message.header.stamp)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        said = {status.name: values_of(status)['heater'] for status in message.status
                if status.name == HEATER_ENTRY or status.name.startswith(SOURCE_ENTRY)}
        if said and not self.has_arrived:
            self.record.note_heaters(_instant_s(message), said.pop(HEATER_ENTRY, HEALTHY), {
                name.removeprefix(SOURCE_ENTRY): verdict for name, verdict in said.items()})
        for status in message.status:
            values = values_of(status)
            if status.name == SIGNALS_ENTRY and _instant_s(message) > 0.0:
                self.record.regimes.append((_instant_s(message), values['regime']))
                self.record.note_signals(_instant_s(message), [
                    name for name in SIGNALS if any(key.startswith(f'{name} in doubt') for key in values)])
        report = outcome_from_diagnostics(message)
        if report is not None and not self.has_arrived:
            self.heard_s, self.report = time.monotonic(), report


def _instant_s(message: Any) -> float:
    """Seconds after the start; 0 while the clock is held, negative before the planner receives it."""
    return (nanoseconds(message.header.stamp) - START_NS) / NS_PER_S


def log_files(scenario: str, folder: AnyPath) -> list[Path]:
    """Return the paths of the logs of planner and vehicle_simulator on a scenario by its name, in a folder."""
    return [Path(folder) / f'{scenario}.{name}.log' for name in ('planner', 'vehicle_simulator')]


def drive_with_nodes(scenario: Scenario, name_or_file: str, log_folder: AnyPath | None = None,
                     recording: Path | None = None, domain_id: int | None = None,
                     observe: Callable[[ObservedDrive], object] = lambda drive: None,
                     heater_status: bool = False) -> ObservedDrive:
    """
    Return the ObservedDrive of a Scenario that the installed executables drive.

    They drive in lockstep: the same drive on every computer. The scenario was loaded from `name_or_file`; the logs
    go to `log_folder`, the planner's flight recording to the file `recording` (None: it does not record). They are
    in the ROS domain `domain_id`, None: an unused one. `observe` is called on the way; with `heater_status` the
    simulated heater reports its power. Raises ScenarioFailed if the drive does not finish.
    """
    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        domain_id = stack.enter_context(reserved_domain_id()) if domain_id is None else domain_id
        kept = None if recording is None else KeptRecording(recording)
        planner_log, simulator_log = log_files(scenario.name, log_folder or temporary)
        environment = {'ROS_DOMAIN_ID': str(domain_id),
                       'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        with _environment(environment), listening('scenario', domain_id) as listener:
            drive = ObservedDrive(listener.node, scenario.first.wanted_c,
                                  [source.name for source in scenario.vehicle.heat_sources])
            recorded = {} if kept is None else kept.parameters(stack)
            of_planner = {
                'use_sim_time': True, 'vehicle': scenario.vehicle_name, **scenario.planner, **recorded}
            of_simulator = {
                'scenario': name_or_file, 'start_time': START_S, 'lockstep': True, 'exit_on_arrival': True,
                # Planner and observer: messages before the observer's subscription are lost.
                'wait_for_listeners': 2, 'heater_status': heater_status}
            with NodeProcess('planner', _arguments(of_planner), planner_log) as planner, NodeProcess(
                    'vehicle_simulator', _arguments(of_simulator), simulator_log) as simulator:
                _follow(listener, drive, simulator, planner, observe)
            if kept is not None:
                drive.recording = kept.keep()
            fill_phases(drive.record, scenario, () if drive.report is None else drive.report.ends)
            return drive


def _arguments(parameters: Mapping[str, Any]) -> list[str]:
    return [text for name, value in parameters.items() for text in ('-p', f'{name}:={as_typed(value)}')]


def _follow(listener: Listener, drive: ObservedDrive, simulator: NodeProcess, planner: NodeProcess,
            observe: Callable[[ObservedDrive], object]) -> None:
    """Return once the drive is over."""
    while simulator.exit_status is None:
        if planner.exit_status is not None:
            raise ScenarioFailed(f'planner ended with exit status {planner.exit_status}: '
                                 f'{planner.output()[-2000:]}')
        if time.monotonic() > drive.heard_s + SILENCE_LIMIT_S:
            raise ScenarioFailed(f'no message of vehicle_simulator for {SILENCE_LIMIT_S:g} s: '
                                 f'{simulator.output()[-2000:]}{planner.output()[-2000:]}')
        drive.let_start()
        observe(drive)
        listener.listen(POLL_S)
    # Messages that were in transit at the end.
    listener.listen(POLL_S)
    observe(drive)
    if simulator.exit_status != 0:
        raise ScenarioFailed(f'vehicle_simulator ended with exit status '
                             f'{simulator.exit_status}: {simulator.output()[-2000:]}')


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
