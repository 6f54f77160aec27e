# SPDX-License-Identifier: Apache-2.0
"""`planner`: battery state and route in, heater command and predicted arrival temperature out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool

from bev_preheat.control.events import (
    ActivationChanged,
    BATTERY_STATE,
    Event,
    PreheatingSwitched,
    Reconfigured,
    RivalsChanged,
    ROUTE_PLAN,
    RouteUnreadable,
)
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import StepOutput, Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.diagnostics import planner_diagnostics
from bev_preheat.messages.inputs import INPUTS, RouteIntake
from bev_preheat.messages.preheat_plan import plan_message, temperature_message
from bev_preheat.nodes.departure_keeper import DepartureKeeper, SKIP
from bev_preheat.nodes.flight_recording import FlightRecorder, Setup
from bev_preheat.nodes.node import guarded, NOT_ACTIVE, ProgramNode, Values
from bev_preheat.nodes.parameters import USE_SIM_TIME
from bev_preheat.nodes.planner_log import PlannerLog
from bev_preheat.nodes.planner_parameters import check_changes, NEVER_LOCKED, PARAMETERS, read, take_effect
from bev_preheat.nodes.prepare_action import PREPARE, PrepareAction
from bev_preheat.nodes.process import LAST_WORDS_TIME, NodeProgram
from bev_preheat.nodes.setup_watch import SETUP_PERIOD_S
from bev_preheat.nodes.state_keeper import SAVE_PERIOD_S, StateKeeper
from bev_preheat.nodes.topics import CommandPublisher, LATCHED, RouteListener
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.records import FAIL, STOP
from bev_preheat.vehicle import vehicle_contents
from bev_preheat.vehicle.core_library import core_in_words
from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

PROGRAM = NodeProgram(
    'planner', 'Plans when to heat the battery before fast charging, and commands the heater.',
    PARAMETERS,
    subscribes=tuple((topic, each.type_name.replace('/msg', '') + (f': {each.words}' if each.words else ''))
                     for topic, each in INPUTS.items()),
    publishes=(('hvch_command', 'bev_preheat_msgs/HvchCommand: power for the battery, a lease'),
               ('heat_source_command', 'bev_preheat_msgs/HeatSourceCommand: the same for each other heat source'),
               ('preheat_plan', 'bev_preheat_msgs/PreheatPlan: status, sentence, trajectories'),
               ('predicted_arrival_temperature', 'sensor_msgs/Temperature'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')),
    services=(('~/enable', 'std_srvs/SetBool: false switches preheating off'),
              (SKIP, 'std_srvs/SetBool: true skips the next of `departures`, false takes that back')),
    actions=((PREPARE, 'bev_preheat_msgs/PrepareBattery: a battery that is warm at an instant'),))


class PlannerNode(ProgramNode):
    """
    Wires topics, parameters and clock to a `control.supervisor.Supervisor`.

    A callback takes an input and admits it as an event; `_step` runs a step with events, publishes and records
    its output, and reports it.
    """

    def __init__(self) -> None:
        super().__init__(PROGRAM)
        values = self.values
        vehicle, settings = read(values)
        take_effect(settings)
        self.hardware = vehicle.name
        self._vehicle_contents = vehicle_contents(values['vehicle'])
        self._state_keeper = StateKeeper(self.get_logger())
        recalled = self._state_keeper.attach(values['state_file'], self._vehicle_contents)
        choices = recalled.choices.after_restart(self.now_ns())
        self._supervisor = Supervisor(
            vehicle, settings, recalled.learned, recalled.last_seen, choices)
        self._log = PlannerLog(self.get_logger())
        self._recorder = FlightRecorder(
            self.get_fully_qualified_name(), self.get_parameter(USE_SIM_TIME).value, self.resolve_topic_name,
            self.get_logger().warning, self.get_logger().info)
        self._routes = RouteIntake()
        self._go_on(settings)
        self._record()
        # The latest step, or its outputs, raised an exception.
        self._is_in_doubt = False

        self._command_publisher = CommandPublisher(
            self, lambda: round(self._supervisor.state.settings.command_lease_s * NS_PER_S), self._on_rival)
        self._temperature_publisher = self.create_publisher(
            Temperature, 'predicted_arrival_temperature', 1)
        self._plan_publisher = self.create_publisher(PreheatPlan, 'preheat_plan', LATCHED)
        for topic, each in INPUTS.items():
            if topic != ROUTE_PLAN:
                self.create_subscription(each.message_type, topic, partial(self._on_input, topic), QoSProfile(
                    depth=each.depth, reliability=ReliabilityPolicy.BEST_EFFORT))
        RouteListener(self, partial(self._on_input, ROUTE_PLAN), self._on_refused_route)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self._departures = DepartureKeeper(
            self, self._step, self._supervisor,
            None if recalled.last_seen is None else recalled.last_seen.stamp_ns)
        self._departures.attach(values['departures'], values['grid_prices'])
        self._prepare = PrepareAction(
            self, self._step, self._supervisor, self.fail, lambda: self._departures.prices)

        self.follow_parameters()
        self._repeat_timer = self.create_timer(settings.command_period_s, self._on_repeat)
        # Expires if no valid battery state arrives within the timeout.
        self._stale_timer = self.create_timer(settings.battery_state_timeout_s, self._on_repeat)
        # In real time, because a disk does not follow simulated time.
        self.steady_timer(SAVE_PERIOD_S, self._on_files_due)
        self.watch(INPUTS, ('hvch_command', 'preheat_plan', 'predicted_arrival_temperature'),
                   single=tuple(topic for topic, each in INPUTS.items() if not each.has_many_sources))
        self.look_regularly(SETUP_PERIOD_S, 'looking for rivals', self._look_for_rivals)
        self.get_logger().info(
            f'Planning for vehicle {vehicle.name} with method {settings.method}; '
            f'native core {core_in_words()}.')
        self._log.log_vehicle(vehicle, values)
        self._log.log_method(values)
        if values['lifecycle']:
            self._on_activation(False)
            self.manage(self._on_activation)
        if not self._supervisor.state.is_enabled:
            self.get_logger().info('Preheating is switched off, as it was before the restart.')

    # The way of an input: take, admit, step, publish, record, diagnose

    @guarded
    def _on_input(self, topic: str, message: Any) -> None:
        now_ns = self.now_ns()
        # An unreadable message is an event, too.
        event = INPUTS[topic].event(message, self._supervisor.state, self._routes,
                                    self.setup.clock_hint(message.header.stamp, now_ns))
        if not self._step(event, now_ns=now_ns, message=message):
            return
        if topic == BATTERY_STATE:
            self._stale_timer.reset()
        elif topic == ROUTE_PLAN:
            self._log.log_route(self._supervisor.state)

    def _step(self, *events: Event, now_ns: int | None = None, message: Any = None) -> bool:
        """
        Run a step with events, and publish its output; return whether every event was accepted.

        Without an event time passes. `now_ns` is the step's instant [ns], None for that of the call; `message` the
        message that its event was read from, None without one.
        """
        now_ns = self.now_ns() if now_ns is None else now_ns
        output = self._supervisor.step(now_ns, *events)
        try:
            self._publish(output, now_ns)
        finally:
            self._keep(now_ns, events, message, output)
        self._diagnose(output, now_ns)
        return not output.refusals and not output.failure

    def _publish(self, output: StepOutput, now_ns: int) -> None:
        """Publish the command (after a failure `_diagnose` does), the results of goals, and the plan."""
        if not self._is_in_doubt:
            self._publish_command(output, now_ns)
        for outcome in output.outcomes:
            self._departures.note(outcome, self._supervisor.state, now_ns)
            self._prepare.finish(outcome)
        decision = output.decision
        if decision is None:
            return
        plan = plan_message(
            decision, self._supervisor.state.active_mission, now_ns, self._supervisor.later_decisions())
        self._plan_publisher.publish(plan)
        prediction = temperature_message(decision, now_ns)
        if prediction is not None:
            self._temperature_publisher.publish(prediction)
        self._recorder.note_plan(now_ns, plan, prediction)

    def _keep(self, now_ns: int, events: tuple[Event, ...], message: Any, output: StepOutput) -> None:
        self._recorder.note(self._supervisor.state, now_ns, events, message, output)
        self._state_keeper.save_choices(self._supervisor.state)
        self._state_keeper.keep_running(self._supervisor.state, self._route_bytes)

    def _diagnose(self, output: StepOutput, now_ns: int) -> None:
        """
        Log the news; publish the diagnostics at once with a new status, so that short-lived ones are seen.

        After a failure the command comes last, so that no heat is commanded while the rest still fails.
        """
        in_doubt = self._is_in_doubt
        self._log.log_output(output)
        self._log.log_findings(self._supervisor.state)
        if in_doubt:
            self._report(now_ns)
            self._publish_command(output, now_ns)
            # Only a published plan shows that plans can be published again.
            decision, command = output.decision, output.command
            in_doubt = (decision is None or decision.plan is None) and (command is None or command.total_w <= 0.0)
        elif output.has_new_status:
            self.publish_diagnostics()
        self._is_in_doubt = bool(output.failure) or in_doubt

    def _publish_command(self, output: StepOutput, now_ns: int) -> None:
        if output.command is not None:
            self._command_publisher.command(output.command, self._supervisor.state.vehicle, now_ns)

    def entries(self) -> list[DiagnosticStatus]:
        """Return the entries on preheating, signals, heater, estimation, files and recording."""
        now_ns = self.now_ns()
        of_files = (self._state_keeper.entry(), self._departures.entry(now_ns), self._recorder.entry())
        return [*planner_diagnostics(self._supervisor.state, now_ns),
                *(entry for entry in of_files if entry is not None)]

    def _report(self, now_ns: int) -> None:
        self._prepare.publish_feedback(now_ns)
        self.publish_diagnostics()

    def fail(self, where: str, error: Exception) -> None:
        """Switch the heater off after an exception outside of a step, and log it; raise nothing."""
        self._is_in_doubt = True
        try:
            now_ns = self.now_ns()
            what = f'{where}: {type(error).__name__}: {error}'
            output = self._supervisor.fail(now_ns, what)
            self.get_logger().error(output.failure)
            self._publish_command(output, now_ns)
            self._recorder.note(self._supervisor.state, now_ns, (), None, output, FAIL, what)
        except Exception as another:
            self.get_logger().error(
                f'0 W could not be published after that: {type(another).__name__}: {another}; the '
                'heater is off when the lease of the latest command ends.')

    # Other callbacks

    @guarded
    def _on_repeat(self) -> None:
        self._step()
        now_ns = self.now_ns()
        if events := self._departures.events(self._supervisor.state, now_ns):
            self._step(*events, now_ns=now_ns)
        self._report(now_ns)

    @guarded
    def _on_refused_route(self, error: InvalidInput) -> None:
        self._step(RouteUnreadable(error))

    def _look_for_rivals(self) -> None:
        self._command_publisher.look()
        self._on_rival()

    @guarded
    def _on_rival(self) -> None:
        """Switch the heater off while another node commands it."""
        rivals = self._command_publisher.rivals(self.now_ns())
        if rivals == self._supervisor.state.inbox.rivals:
            return
        if rivals:
            self.get_logger().error(f'{rivals} also commands heat: the heater is off.')
        else:
            self.get_logger().info('No other node commands heat any more.')
        self.setup.error = f'{rivals} also commands heat' if rivals else ''
        self._step(RivalsChanged(rivals))

    @guarded
    def report(self) -> None:
        """Publish the diagnostics if the clock stands, because `_on_repeat` goes by it."""
        if self.setup.clock_stands:
            self.publish_diagnostics()

    @guarded
    def _on_activation(self, is_active: bool) -> None:
        self._step(ActivationChanged(is_active, NOT_ACTIVE))

    @guarded
    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = True
        response.message = f'Preheating is switched {"on" if request.data else "off"}.'
        self.get_logger().info(response.message)
        self._step(PreheatingSwitched(request.data))
        return response

    # Parameters

    def check_lock(self, parameters: Sequence[RosParameter]) -> None:
        """Refuse a change of what is locked."""
        if self.values['locked']:
            problems = [
                f'{parameter.name}: is locked (locked:=true at the start); change the parameter file and restart'
                for parameter in parameters if parameter.name not in NEVER_LOCKED
                and parameter.value != self.get_parameter(parameter.name).value]
            if problems:
                raise InvalidInput(problems)

    def check_values(self, changed: Values) -> None:
        """Refuse values that do not fit, and unusable files."""
        check_changes({**self.values, **changed}, changed)

    def take_values(self, changed: Values) -> None:
        """Go on with new values, and plan again."""
        values, state = self.values, self._supervisor.state
        vehicle, settings = read(values)
        contents = vehicle_contents(values['vehicle'])
        is_new_car = contents != self._vehicle_contents
        if is_new_car:
            self._state_keeper.save(state)
            self._vehicle_contents = contents
        else:
            # The estimation continues as long as the vehicle is the same object.
            vehicle = state.vehicle
        self.hardware = vehicle.name
        for timer, period_s in ((self._repeat_timer, settings.command_period_s),
                                (self._stale_timer, settings.battery_state_timeout_s)):
            timer.timer_period_ns = round(period_s * 1e9)
            timer.reset()
        take_effect(settings)
        learned = self._state_keeper.attach(values['state_file'], contents).learned
        self._record()
        self._step(Reconfigured(
            vehicle, settings, self._routes.read_again(state.inbox, vehicle, settings), learned),
            *self._departures.attach(values['departures'], values['grid_prices']))
        self.get_logger().info('In effect now: ' + ', '.join(
            f'{name} = {value}' for name, value in changed.items()) + '.')
        if is_new_car:
            self._log.log_vehicle(vehicle, values)
        if 'method' in changed:
            self._log.log_method(values)

    # Files

    @guarded
    def _on_files_due(self) -> None:
        self._on_save_due()
        self._departures.look()

    @guarded
    def _on_save_due(self) -> None:
        self._state_keeper.save(self._supervisor.state)
        self._state_keeper.keep_running(self._supervisor.state, self._route_bytes)
        self._recorder.tell()

    def _go_on(self, settings: Settings) -> None:
        """Go on from the State that a planner of before has left, if it holds."""
        running = self._state_keeper.running(settings, self.now_ns())
        if running is None:
            return
        state, message = running
        self._supervisor.go_on_from(state)
        mission = state.inbox.latest_mission
        if mission is not None and message is not None:
            self._routes.remember(mission, deserialize_message(message, RoutePlan))

    def _route_bytes(self) -> bytes | None:
        """Return the message of the latest route as bytes (CDR); None without one."""
        message = self._routes.message_of(self._supervisor.state.inbox.latest_mission)
        return None if message is None else bytes(serialize_message(message))

    def _record(self) -> None:
        """Record into the folder of the parameters."""
        values, state = self.values, self._supervisor.state
        self._recorder.attach(
            values['flight_recorder'], values['flight_recorder_size'],
            Setup(dict(sorted(values.items())), self._vehicle_contents),
            state, self.now_ns(), self._routes.message_of(state.inbox.latest_mission))

    # The end

    def last_words(self) -> None:
        """Publish 0 W before the process ends, and wait up to LAST_WORDS_TIME for delivery."""
        for last in (self._prepare.shut_down, self._switch_off, self._on_save_due, self._await_delivery):
            try:
                last()
            except Exception as error:
                self.fail(last.__name__, error)
        self._recorder.close()

    def _switch_off(self) -> None:
        # With a normal lease, because a heater's controller may ignore an expired command.
        now_ns = self.now_ns()
        output = self._supervisor.stop(now_ns)
        self._publish_command(output, now_ns)
        self._recorder.note(self._supervisor.state, now_ns, (), None, output, STOP)

    def _await_delivery(self) -> None:
        self._command_publisher.hvch.publisher.wait_for_all_acked(LAST_WORDS_TIME)
