# SPDX-License-Identifier: Apache-2.0
"""`planner`: battery state and route in, heater command and predicted arrival temperature out."""

from __future__ import annotations

from functools import partial, wraps
import sys
from typing import NamedTuple, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool

from bev_preheat.charging.worth import MOST_PRICE_PER_KWH, MOST_VALUE_PER_H
from bev_preheat.control.events import (
    ActivationChanged,
    PreheatingSwitched,
    Reconfigured,
    RivalsChanged,
    RouteUnreadable,
)
from bev_preheat.control.regime import Regime
from bev_preheat.control.sensitivity_watch import SensitivityWatch
from bev_preheat.control.settings import FIELD_OF_PARAMETER, Settings, settings_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.flight_recorder.steps import BATTERY_STATE, FAIL, ROUTE_PLAN, STOP
from bev_preheat.native.library import core_in_words, use_core
from bev_preheat.nodes.command_line import NodeProgram
from bev_preheat.nodes.command_publisher import CommandPublisher
from bev_preheat.nodes.convert import command_message, plan_message, temperature_message
from bev_preheat.nodes.departure_keeper import check_departure_parameters, DepartureKeeper, SKIP
from bev_preheat.nodes.diagnostics import heater_sentence, planner_diagnostics
from bev_preheat.nodes.flight_recording import FlightRecorder, planner_of, Setup
from bev_preheat.nodes.inputs import INPUTS, Reader
from bev_preheat.nodes.managed import LIFECYCLE, ManagedStates, NOT_ACTIVE
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.parameters import check, declare, Parameter, USE_SIM_TIME
from bev_preheat.nodes.prepare_action import PREPARE, PrepareAction
from bev_preheat.nodes.process import LAST_WORDS_TIME, run_node
from bev_preheat.nodes.route_intake import RouteIntake
from bev_preheat.nodes.route_listener import RouteListener
from bev_preheat.nodes.setup_watch import SetupWatch
from bev_preheat.nodes.state_keeper import check_parameter, SAVE_PERIOD_S, StateKeeper
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.installed_methods import limit_answer_time
from bev_preheat.planning.planner import check_method, installed_names, METHODS, REPLACED, replaced_in_words
from bev_preheat.vehicle import load_vehicle, vehicle_contents, vehicle_file
from bev_preheat.vehicle.assumptions import assumption_warning
from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from typing import Any

    from rclpy.parameter import Parameter as RosParameter

    from bev_preheat.control.events import Event
    from bev_preheat.control.step import StepOutput
    from bev_preheat.vehicle import Vehicle

    # A method called by ROS.
    Callback = Callable[..., Any]
    # Values of parameters by name, with the types of the parameter table.
    Values = dict[str, Any]

DEFAULTS = Settings()
PARAMETERS = (
    Parameter('vehicle', 'reference', 'Vehicle: a name in config/vehicles or a YAML file.'),
    Parameter('method', DEFAULTS.method, 'Planning method.', choices=tuple(METHODS), more_choices=installed_names,
              earlier_choices=tuple(REPLACED),
              more_in_words=', or a method of an installed package (planner --help lists them)'),
    Parameter('target_battery_temperature', 0.0,
              'Battery temperature on arrival if the route names none', 'degC', (-40.0, 60.0),
              unset_means="the vehicle's default"),
    Parameter('battery_state_timeout', DEFAULTS.battery_state_timeout_s,
              'A battery state older than this is stale', 's', (0.1, 60.0)),
    Parameter('clock_tolerance', DEFAULTS.clock_tolerance_s,
              'A battery state may be stamped this far in the future', 's', (0.0, 10.0)),
    Parameter('command_period', DEFAULTS.command_period_s,
              'The command is repeated this often', 's', (0.02, 10.0)),
    Parameter('command_lease', DEFAULTS.lease_s,
              'A command is valid this long; longer than command_period', 's', (0.05, 30.0)),
    Parameter('planning_step', DEFAULTS.planning_step_s,
              'Routes are planned in steps of this length', 's', (1.0, 300.0)),
    Parameter('arrival_soc_margin', DEFAULTS.arrival_soc_margin,
              'Margin on top of the state of charge that a route requires', '', (0.0, 0.5)),
    Parameter('estimation', DEFAULTS.estimation,
              'Estimate temperature and model on line, and plan for the uncertainty.'),
    Parameter('minimum_on_time', DEFAULTS.minimum_on_time_s,
              'The heater, once on, stays on at least this long', 's', (0.0, 600.0)),
    Parameter('minimum_off_time', DEFAULTS.minimum_off_time_s,
              'The heater, once off, stays off at least this long', 's', (0.0, 3600.0)),
    Parameter('route_progress_timeout', DEFAULTS.route_progress_timeout_s,
              'Without route progress for this long the planner continues by time', 's', (0.1, 300.0)),
    Parameter('energy_price', DEFAULTS.energy_price_per_kwh,
              'Price of energy: the target for a known charger is chosen by it', 'per kWh',
              (0.0, MOST_PRICE_PER_KWH)),
    Parameter('value_of_time', DEFAULTS.value_of_time_per_h,
              'Value of time at the charger, in the same currency; the target is chosen by it', 'per h',
              (0.0, MOST_VALUE_PER_H)),
    Parameter('heat_while_charging', DEFAULTS.heat_while_charging,
              'Heat at the charger as far as it pays, if the vehicle file says that the vehicle can.'),
    Parameter('compiled_core', DEFAULTS.compiled_core,
              'Plan with the native core if it is built; plans are the same without.'),
    Parameter('coldest_cell_limits', DEFAULTS.coldest_cell_limits,
              "Battery and charger have the coldest cell's power limits, if cell_temperature is known."),
    Parameter('flight_recorder', '', 'Folder for recordings of all inputs and commands; empty: none.'),
    Parameter('flight_recorder_size', 500.0, 'The oldest recordings are deleted beyond this size of the folder',
              'MB', (100.0, 1e6)),
    Parameter('state_file', '', "File for the learned factors of the car and the driver's choices: "
              'a new file, or a state file, with the running trip beside it; empty: none.'),
    Parameter('departures', '', 'File of recurring departures (YAML) for which the battery is prepared; '
              'empty: none.'),
    Parameter('grid_prices', '', 'File of prices of energy from the grid (YAML): a plugged-in battery is prepared '
              'in the cheapest hours; empty: as late as possible.'),
    Parameter('locked', False, "Refuse changes of the safety-relevant parameters, and of the node's clock "
              '(use_sim_time), at run time.', read_only=True),
    LIFECYCLE,
)
# A driver or a backend may change these although the others are locked.
NEVER_LOCKED = frozenset(('target_battery_temperature', 'energy_price', 'value_of_time'))
PROGRAM = NodeProgram(
    'planner', 'Plans when to heat the battery before fast charging, and commands the heater.',
    PARAMETERS,
    subscribes=tuple((topic, each.type_name.replace('/msg', '') + (f': {each.words}' if each.words else ''))
                     for topic, each in INPUTS.items()),
    publishes=(('hvch_command', 'bev_preheat_msgs/HvchCommand: power for the battery, a lease'),
               ('preheat_plan', 'bev_preheat_msgs/PreheatPlan: status, sentence, trajectories'),
               ('predicted_arrival_temperature', 'sensor_msgs/Temperature'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')),
    services=(('~/enable', 'std_srvs/SetBool: false switches preheating off'),
              (SKIP, 'std_srvs/SetBool: true skips the next of `departures`, false takes that back')),
    actions=((PREPARE, 'bev_preheat_msgs/PrepareBattery: a battery that is warm at an instant'),))
# Share of the time by which the lease is longer than the command period.
ANSWER_SHARE = 0.1
_OWN = frozenset(parameter.name for parameter in PARAMETERS)


class _Told(NamedTuple):
    """The logged findings."""

    heater: Heater = Heater.ANSWERS
    resets: int = 0
    regime: Regime = Regime.UNKNOWN
    signals: frozenset[str] = frozenset()


def guarded(callback: Callback) -> Callback:
    """Wrap a callback: log an unexpected exception and switch the heater off."""
    @wraps(callback)
    def wrapper(self: PlannerNode, *arguments: Any) -> Any:
        try:
            return callback(self, *arguments)
        except Exception as error:
            self.fail(callback.__name__, error)
            return arguments[-1] if arguments else None
    return wrapper


class PlannerNode(Node):
    """Wires topics, parameters and clock to a `control.supervisor.Supervisor`."""

    def __init__(self) -> None:
        """Declare the parameters and start; raises InvalidInput if one is not allowed."""
        super().__init__('planner')
        values = declare(self, PARAMETERS)
        vehicle, settings = _take_effect(values)
        use_core(settings.compiled_core)
        limit_answer_time(_answer_time_s(settings))
        self._vehicle_contents = vehicle_contents(values['vehicle'])
        self._state_keeper = StateKeeper(self.get_logger())
        recalled = self._state_keeper.attach(values['state_file'], self._vehicle_contents)
        choices = recalled.choices.after_restart(self._now_ns())
        self._supervisor = Supervisor(
            vehicle, settings, recalled.learned, recalled.last_seen, choices)
        self._told, self._news = _Told(), RepetitionFilter()
        self._sensitivity = SensitivityWatch()
        self._recorder = FlightRecorder(planner_of(self))
        self._routes = RouteIntake()
        self._go_on(settings)
        self._record(values)
        # The latest step, or its outputs, raised an exception.
        self._is_in_doubt = False

        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._command_publisher = commands = CommandPublisher(
            self, lambda: round(self._supervisor.state.settings.lease_s * NS_PER_S), self._on_rival)
        self._temperature_publisher = self.create_publisher(
            Temperature, 'predicted_arrival_temperature', 1)
        self._plan_publisher = self.create_publisher(PreheatPlan, 'preheat_plan', latched)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        state_qos = QoSProfile(
            depth=1, reliability=qos_profile_sensor_data.reliability)
        for topic, each in INPUTS.items():
            if topic != ROUTE_PLAN:
                self.create_subscription(each.message_type, topic, partial(self._on_input, topic), state_qos)
        RouteListener(self, partial(self._on_input, ROUTE_PLAN), self._on_refused_route)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self._departures = DepartureKeeper(
            self, self._step, self._supervisor,
            None if recalled.last_seen is None else recalled.last_seen.stamp_ns)
        self._departures.attach(values['departures'], values['grid_prices'])
        self._prepare = PrepareAction(
            self, self._step, self._supervisor, self.fail, lambda: self._departures.prices)

        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self._repeat_timer = self.create_timer(settings.command_period_s, self._on_repeat)
        # Expires if no valid battery state arrives within the timeout.
        self._stale_timer = self.create_timer(settings.battery_state_timeout_s, self._on_repeat)
        # In real time, because a disk does not follow simulated time.
        self.create_timer(SAVE_PERIOD_S, self._on_files_due,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._setup = SetupWatch(
            self, tuple(INPUTS),
            ('hvch_command', 'preheat_plan', 'predicted_arrival_temperature'),
            also=(commands.look, self._on_rival, self._on_standing_clock),
            single=tuple(topic for topic, each in INPUTS.items() if not each.has_many_sources))
        self.get_logger().info(
            f'Planning for vehicle {vehicle.name} with method {settings.method}; '
            f'native core {core_in_words()}.')
        self._tell_assumptions(values['vehicle'])
        self._tell_replaced(values['method'])
        self._managed: ManagedStates | None = None
        if values['lifecycle']:
            self._on_activation(False)
            self._managed = ManagedStates(self, self._on_activation)
            self.finished = self._managed.finished
        if not self._supervisor.state.is_enabled:
            self.get_logger().info('Preheating is switched off, as it was before the restart.')

    # Input

    @guarded
    def _on_input(self, topic: str, message: Any) -> None:
        now_ns = self._now_ns()
        event = INPUTS[topic].event(message, Reader(
            self._supervisor.state, self._routes, self._setup.clock_hint(message.header.stamp, now_ns)))
        if not self._step(event, now_ns=now_ns, message=message):
            return
        if topic == BATTERY_STATE:
            self._stale_timer.reset()
        elif topic == ROUTE_PLAN:
            self._tell_route()

    @guarded
    def _on_refused_route(self, error: InvalidInput) -> None:
        self._step(RouteUnreadable(error))

    def _tell_route(self) -> None:
        mission = self._supervisor.state.mission
        if mission is None:
            self.get_logger().info('The trip was cancelled.')
            return
        routes = [leg.route for leg in mission.legs]
        self.get_logger().info(
            f'Route {mission.route_id!r}: '
            f'{sum(route.total_duration_s for route in routes) / 60:.1f} min, '
            f'{sum(route.distance_m for route in routes) / 1000:.1f} km, '
            f'stops on the way: {len(routes) - 1}; propulsion power: {mission.power_source}.')
        for warning in self._supervisor.state.unit_warnings:
            self.get_logger().warning(f'route_plan: {warning}.')

    @guarded
    def _on_rival(self) -> None:
        """Switch the heater off while another node commands it."""
        rivals = self._command_publisher.rivals(self._now_ns())
        if rivals == self._supervisor.state.rivals:
            return
        if rivals:
            self.get_logger().error(f'{rivals} also publishes hvch_command: the heater is off.')
        else:
            self.get_logger().info('No other node publishes hvch_command any more.')
        self._step(RivalsChanged(rivals))

    @guarded
    def _on_standing_clock(self) -> None:
        # The timers of a stopped clock never fire.
        if self._setup.clock_stands:
            self._publish_diagnostics(self._now_ns())

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

    def _tell_assumptions(self, name_or_file: str) -> None:
        warning = assumption_warning(self._supervisor.state.vehicle, vehicle_file(name_or_file))
        if warning is not None:
            self.get_logger().warning(f'{warning}.')

    def _tell_findings(self) -> None:
        """Log regime, signals in doubt and the findings of the estimation, once."""
        state = self._supervisor.state
        regime, verdicts = state.regime, state.signal_verdicts
        if regime.regime is not self._told.regime and regime.evidence:
            self.get_logger().info(f'Regime: {regime.regime.value}: {regime.evidence}.')
        signals = frozenset(verdict.signal for verdict in verdicts)
        for verdict in verdicts:
            if verdict.signal not in self._told.signals:
                self.get_logger().warning(f'Signal in doubt: {verdict.sentence}.')
        for signal in sorted(self._told.signals - signals):
            self.get_logger().info(f'Signal valid again: {signal}.')
        self._told = self._told._replace(regime=regime.regime, signals=signals)
        estimate = state.estimate
        if estimate is None:
            return
        if estimate.heater.heater is not self._told.heater:
            self.get_logger().warning(f'Heater: {heater_sentence(estimate.heater)}.')
        if estimate.resets != self._told.resets:
            self.get_logger().warning(f'The estimator was reset: {estimate.reset_reason}.')
        self._told = self._told._replace(heater=estimate.heater.heater, resets=estimate.resets)

    # Parameters

    def _check_parameters(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        try:
            self._check_lock(parameters)
            if not _OWN.intersection(parameter.name for parameter in parameters):
                return SetParametersResult(successful=True)
            _take_effect(self._values_with(parameters))
            # A faulty file must not block other parameters; the diagnostics report it.
            for parameter in parameters:
                if parameter.name == 'state_file':
                    check_parameter(parameter.value)
            if {'departures', 'grid_prices'}.intersection(parameter.name for parameter in parameters):
                values = self._values_with(parameters)
                check_departure_parameters(values['departures'], values['grid_prices'])
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            return SetParametersResult(
                successful=False,
                reason=shortened(f'cannot be checked: {type(error).__name__}: {error}',
                                 LONGEST_PROBLEM))
        return SetParametersResult(successful=True)

    def _check_lock(self, parameters: Iterable[RosParameter]) -> None:
        """Raise InvalidInput if a locked parameter would change, including those that rclpy declares."""
        if self.get_parameter('locked').value:
            problems = [
                f'{parameter.name}: is locked (locked:=true at the start); change the parameter file and restart'
                for parameter in parameters if parameter.name not in NEVER_LOCKED
                and parameter.value != self.get_parameter(parameter.name).value]
            if problems:
                raise InvalidInput(problems)

    @guarded
    def _apply_parameters(self, parameters: Sequence[RosParameter]) -> None:
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME:
                self.get_logger().warning(
                    f'use_sim_time = {str(parameter.value).lower()}: stamps and leases now follow '
                    f'{"/clock; its publisher sets the time" if parameter.value else "the system clock"}.')
        if not _OWN.intersection(parameter.name for parameter in parameters):
            return
        state = self._supervisor.state
        values = self._values_with(parameters)
        vehicle, settings = _take_effect(values)
        contents = vehicle_contents(values['vehicle'])
        is_new_car = contents != self._vehicle_contents
        if is_new_car:
            self._state_keeper.save(state)
            self._vehicle_contents = contents
        else:
            # The estimation continues as long as the vehicle is the same object.
            vehicle = state.vehicle
        for timer, period_s in ((self._repeat_timer, settings.command_period_s),
                                (self._stale_timer, settings.battery_state_timeout_s)):
            timer.timer_period_ns = round(period_s * 1e9)
            timer.reset()
        use_core(settings.compiled_core)
        limit_answer_time(_answer_time_s(settings))
        learned = self._state_keeper.attach(values['state_file'], contents).learned
        self._record(values)
        self._step(Reconfigured(
            vehicle, settings, self._routes.read_again(state, vehicle, settings), learned),
            *self._departures.attach(values['departures'], values['grid_prices']))
        self.get_logger().info('In effect now: ' + ', '.join(
            f'{parameter.name} = {parameter.value}' for parameter in parameters if parameter.name in _OWN) + '.')
        if is_new_car:
            self._tell_assumptions(values['vehicle'])
        if any(parameter.name == 'method' for parameter in parameters):
            self._tell_replaced(values['method'])

    def _tell_replaced(self, method: str) -> None:
        if sentence := replaced_in_words(method):
            self.get_logger().warning(f'{sentence[0].upper()}{sentence[1:]}.')

    def _values_with(self, parameters: Iterable[RosParameter]) -> Values:
        values = {name: self.get_parameter(name).value for name in _OWN}
        values.update((parameter.name, parameter.value) for parameter in parameters
                      if parameter.name in _OWN)
        return values

    # Output

    def _step(self, *events: Event, now_ns: int | None = None, message: Any = None) -> bool:
        """
        Run a step of the supervisor and publish its output; return whether every event was accepted.

        `now_ns` is the step's instant [ns], None for that of the call; `message` the message that its event was
        read from, None without one. The command is published first, but after a failure it is published last,
        so that no heat is commanded while the rest still fails.
        """
        now_ns = self._now_ns() if now_ns is None else now_ns
        output, in_doubt = self._supervisor.step(now_ns, *events), self._is_in_doubt
        if not in_doubt:
            self._publish_command(output, now_ns)
        self._recorder.note(self._supervisor.value, now_ns, events, message, output)
        self._publish_decision(output, now_ns)
        for refusal in output.refusals:
            sentence = f'{refusal.source} refused: {refusal.error}'
            if self._news.has(sentence):
                self.get_logger().error(sentence)
        self._tell_findings()
        if in_doubt:
            self._report(now_ns)
            self._publish_command(output, now_ns)
            # Only a published plan shows that plans can be published again.
            in_doubt = not _has_plan_or_heats(output)
        self._is_in_doubt = bool(output.failure) or in_doubt
        self._state_keeper.save_choices(self._supervisor.state)
        self._state_keeper.keep_running(self._supervisor.value, self._route_bytes)
        return not output.refusals and not output.failure

    def _publish_command(self, output: StepOutput, now_ns: int) -> None:
        if output.command is not None:
            self._command_publisher.publish(command_message(output.command, now_ns))

    def _publish_decision(self, output: StepOutput, now_ns: int) -> None:
        if output.failure:
            self.get_logger().error(output.failure)
        for outcome in output.outcomes:
            self._departures.note(outcome, self._supervisor.state, now_ns)
            self._prepare.finish(outcome)
        decision = output.decision
        if decision is None:
            return
        plan = plan_message(
            decision, self._supervisor.state.active_mission, now_ns, self._supervisor.later_decisions())
        self._plan_publisher.publish(plan)
        prediction = None if decision.plan is None else temperature_message(decision, now_ns)
        if prediction is not None:
            self._temperature_publisher.publish(prediction)
        self._recorder.note_plan(now_ns, plan, prediction)
        if output.has_new_status:
            self.get_logger().info(f'{decision.status.name}: {decision.explanation}')
            # At once, so that short-lived statuses are seen.
            self._publish_diagnostics(now_ns)

    @guarded
    def _on_repeat(self) -> None:
        self._step()
        now_ns = self._now_ns()
        if events := self._departures.events(self._supervisor.state, now_ns):
            self._step(*events, now_ns=now_ns)
        self._report(now_ns)

    def _report(self, now_ns: int) -> None:
        self._prepare.publish_feedback(now_ns)
        self._publish_diagnostics(now_ns)

    def _publish_diagnostics(self, now_ns: int) -> None:
        state = self._supervisor.state
        # For readers only.
        sensitivity = (self._sensitivity.look(state, now_ns)
                       if self._diagnostics_publisher.get_subscription_count() > 0 else '')
        message = planner_diagnostics(
            self.get_fully_qualified_name(), state, now_ns, self._state_keeper.report(),
            self._departures.report(), sensitivity)
        message.status.append(self._setup.entry(
            state.vehicle.name,
            f'{state.rivals} also publishes hvch_command' if state.rivals else ''))
        recording = self._recorder.entry(self.get_fully_qualified_name(), state.vehicle.name)
        if recording is not None:
            message.status.append(recording)
        self._diagnostics_publisher.publish(message)

    def fail(self, where: str, error: Exception) -> None:
        """Switch the heater off after an exception outside of a step, and log it; raise nothing."""
        self._is_in_doubt = True
        try:
            now_ns = self._now_ns()
            what = f'{where}: {type(error).__name__}: {error}'
            output = self._supervisor.fail(now_ns, what)
            self.get_logger().error(output.failure)
            self._publish_command(output, now_ns)
            self._recorder.note(self._supervisor.value, now_ns, (), None, output, FAIL, what)
        except Exception as another:
            self.get_logger().error(
                f'0 W could not be published after that: {type(another).__name__}: {another}; the '
                'heater is off when the lease of the latest command ends.')

    @guarded
    def _on_files_due(self) -> None:
        self._on_save_due()
        self._departures.look()

    @guarded
    def _on_save_due(self) -> None:
        state = self._supervisor.state
        self._state_keeper.save(state)
        self._state_keeper.keep_running(self._supervisor.value, self._route_bytes)
        self._recorder.tell()

    def _go_on(self, settings: Settings) -> None:
        """Go on from the State that a planner of before has left, if it holds."""
        running = self._state_keeper.running(settings, self._now_ns())
        if running is None:
            return
        self._supervisor.go_on_from(running.state)
        mission = running.state.inbox.latest_mission
        if mission is not None and running.route is not None:
            self._routes.remember(mission, deserialize_message(running.route, RoutePlan))

    def _route_bytes(self) -> bytes | None:
        """Return the message of the latest route as bytes (CDR); None without one."""
        message = self._routes.message_of(self._supervisor.value.inbox.latest_mission)
        return None if message is None else bytes(serialize_message(message))

    def _record(self, values: Values) -> None:
        state = self._supervisor.value
        self._recorder.attach(
            values['flight_recorder'], values['flight_recorder_size'],
            Setup({name: values[name] for name in sorted(_OWN)}, self._vehicle_contents),
            state, self._now_ns(), self._routes.message_of(state.inbox.latest_mission))

    def last_words(self) -> None:
        """Publish 0 W before the process ends, and wait up to LAST_WORDS_TIME for delivery."""
        for last in (self._end_goals, self._switch_off, self._on_save_due, self._await_delivery,
                     self._recorder.close):
            last()

    @guarded
    def _end_goals(self) -> None:
        self._prepare.shut_down()

    @guarded
    def _switch_off(self) -> None:
        # With a normal lease, because a heater's controller may ignore an expired command.
        now_ns = self._now_ns()
        output = self._supervisor.stop(now_ns)
        self._publish_command(output, now_ns)
        self._recorder.note(self._supervisor.value, now_ns, (), None, output, STOP)

    @guarded
    def _await_delivery(self) -> None:
        self._command_publisher.wait_for_all_acked(LAST_WORDS_TIME)

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def _has_plan_or_heats(output: StepOutput) -> bool:
    decision, command = output.decision, output.command
    return (decision is not None and decision.plan is not None) or (
        command is not None and command.battery_heating_power_w > 0.0)


def _answer_time_s(settings: Settings) -> float:
    """Return the time that an installed method may take for an answer [s]; a step may ask it several times."""
    return ANSWER_SHARE * (settings.lease_s - settings.command_period_s)


def _take_effect(values: Values) -> tuple[Vehicle, Settings]:
    """Return (Vehicle, Settings) of parameter values; raise InvalidInput if they are wrong."""
    check(PARAMETERS, values)
    if values['command_lease'] <= values['command_period']:
        raise InvalidInput(
            f'command_lease: {values["command_lease"]:g} s must be longer than command_period, '
            f'{values["command_period"]:g} s, or the heater drops out between two commands')
    # A method of an installed package is loaded before it is needed.
    check_method(values['method'])
    return load_vehicle(values['vehicle']), settings_of(
        {name: values[name] for name in FIELD_OF_PARAMETER})


def main(loading_node: Node | None = None) -> None:
    """Run the planner until a signal ends it; `loading_node` comes from `process.join_graph`."""
    sys.exit(run_node(PlannerNode, PROGRAM, loading_node))


if __name__ == '__main__':
    main()
