# SPDX-License-Identifier: Apache-2.0
"""`nlp_checker`: how far the planner's plan is from the optimum of the nonlinear program."""

from __future__ import annotations

from collections import deque
from functools import wraps
import sys
from time import monotonic
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger

from bev_preheat.control.decision import WITHOUT_ROUTE
from bev_preheat.control.events import (
    BatteryStateArrived,
    Reconfigured,
    RouteUnreadable,
    TripCancelled,
)
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.nodes.command_line import NodeProgram
from bev_preheat.nodes.convert import battery_event
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.optimality_report import (
    as_driven,
    case_of_plan,
    case_of_state,
    checker_diagnostics,
    part_ahead,
    report_message,
    report_sentence,
    says_the_same,
)
from bev_preheat.nodes.parameters import check, declare, Parameter
from bev_preheat.nodes.process import run_node
from bev_preheat.nodes.route_intake import RouteIntake
from bev_preheat.nodes.route_listener import RouteListener
from bev_preheat.nodes.setup_watch import DIAGNOSTICS_PERIOD_S, SetupWatch
from bev_preheat.nonlinear_program.protocol import Failure, SolverAnswer
from bev_preheat.nonlinear_program.solver_process import MOST_NICE, SolverProcess
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import OptimalityReport, PreheatPlan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from typing import Any

    from rclpy.parameter import Parameter as RosParameter

    from bev_preheat.control.events import Event
    from bev_preheat.control.inputs import Measurement
    from bev_preheat.nodes.optimality_report import CheckedCase
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_msgs.msg import RoutePlan

    # A method called by ROS.
    Callback = Callable[..., Any]
    # Values of parameters by name, with the types of the parameter table.
    Values = dict[str, Any]

DEFAULTS = Settings()
PARAMETERS = (
    Parameter('vehicle', 'reference',
              "Vehicle: a name in config/vehicles or a YAML file; the planner's own."),
    Parameter('check_period', 60.0,
              'Time between two checks; 0: only new routes and on demand',
              's', (0.0, 86400.0)),
    Parameter('time_limit', 10.0, 'The solver is stopped after this time', 's', (0.1, 600.0)),
    Parameter('solver_niceness', MOST_NICE,
              "The solver's niceness towards other processes: added to the node's own nice value",
              limits=(0, MOST_NICE), read_only=True),
    Parameter('planning_step', DEFAULTS.planning_step_s,
              "Routes are checked in steps of this length; the planner's own", 's', (1.0, 300.0)),
    Parameter('battery_state_timeout', DEFAULTS.battery_state_timeout_s,
              'A battery state older than this is not checked', 's', (0.1, 60.0)),
    Parameter('clock_tolerance', DEFAULTS.clock_tolerance_s,
              'A battery state may be stamped this far in the future', 's', (0.0, 10.0)),
)
PROGRAM = NodeProgram(
    'nlp_checker', "Solves the nonlinear program for the planner's situation and reports how far "
    'the plan is from the optimum.', PARAMETERS,
    subscribes=(('battery_state', 'sensor_msgs/BatteryState'),
                ('route_plan', 'bev_preheat_msgs/RoutePlan'),
                ('preheat_plan', 'bev_preheat_msgs/PreheatPlan')),
    publishes=(('optimality_report', 'bev_preheat_msgs/OptimalityReport'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')),
    services=(('~/check', 'std_srvs/Trigger: checks now'),))
_OWN = frozenset(parameter.name for parameter in PARAMETERS)

# Period of polling a busy solver process, in real time.
POLL_PERIOD_S = 0.05
# The planner plans in milliseconds; without its plan by then, the checker plans with the planner's method.
PLAN_WAIT_S = 1.0
# The planner may lag by some battery states.
STATES_KEPT = 16


def guarded(callback: Callback) -> Callback:
    """Wrap a callback: log an unexpected exception and continue."""
    @wraps(callback)
    def wrapper(self: NlpCheckerNode, *arguments: Any) -> Any:
        try:
            return callback(self, *arguments)
        except Exception as error:
            sentence = f'{callback.__name__}: {type(error).__name__}: {error}'
            if self._news.has(sentence):
                self.get_logger().error(sentence)
            return arguments[-1] if arguments else None
    return wrapper


class NlpCheckerNode(Node):
    """
    Receives the planner's inputs and plans, and lets a `SolverProcess` solve the same problem.

    A check is due for each new route, on demand and after `check_period`. It begins when the planner's plan for a
    known battery state has arrived, or has not arrived for PLAN_WAIT_S. A check for a new route or on demand
    cancels the running check.
    """

    def __init__(self) -> None:
        """Declare the parameters and start; raises InvalidInput if one is not allowed."""
        require('casadi')
        super().__init__('nlp_checker')
        self._news = RepetitionFilter()
        self._values = declare(self, PARAMETERS)
        vehicle = load_vehicle(self._values['vehicle'])
        # Refuses the same inputs as the planner.
        self._inbox = Inbox.empty(vehicle, _settings(self._values))
        self._solver = self._solver_of(vehicle)
        # Loading the solver takes longer than solving; the first check must not wait for it.
        self._solver.prepare()
        self._measurements: deque[Measurement] = deque(maxlen=STATES_KEPT)
        self._routes = RouteIntake()
        self._plan: PreheatPlan | None = None
        # Instants are time.monotonic(), except for the last check's, which is in the node's time.
        self._is_wanted = self._is_urgent = False
        self._ready_since_s: float | None = None
        self._case: CheckedCase | None = None
        self._report: OptimalityReport | None = None
        self._solver_name = ''
        self._last_check_ns: int | None = None
        self._problems: dict[str, str] = {}
        self._counts = {'reports': 0, 'failures': 0, 'superseded': 0, 'programs built': 0}

        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._report_publisher = self.create_publisher(
            OptimalityReport, 'optimality_report', latched)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        state_qos = QoSProfile(depth=1, reliability=qos_profile_sensor_data.reliability)
        self.create_subscription(BatteryState, 'battery_state', self._on_battery_state, state_qos)
        RouteListener(self, self._on_route_plan, self._on_refused_route)
        self.create_subscription(PreheatPlan, 'preheat_plan', self._on_preheat_plan, latched)
        self.create_service(Trigger, '~/check', self._on_check)

        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        # The solver works in real time, independent of the node's clock.
        steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll_timer = self.create_timer(POLL_PERIOD_S, self._on_poll, clock=steady_clock)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._on_diagnostics, clock=steady_clock)
        self._setup = SetupWatch(
            self, ('battery_state', 'route_plan', 'preheat_plan'), ('optimality_report',))
        self.get_logger().info(f'Checking plans for vehicle {vehicle.name}.')

    # Input

    @guarded
    def _on_battery_state(self, message: BatteryState) -> None:
        now_ns = self._now_ns()
        event = battery_event(message, self._setup.clock_hint(message.header.stamp, now_ns))
        if not self._is_accepted(event) or not isinstance(event, BatteryStateArrived):
            return
        measurement = event.measurement
        if self._measurements and measurement.stamp_ns < self._measurements[-1].stamp_ns:
            # The clock was set back; earlier measurements belong to another time.
            self._measurements.clear()
        self._measurements.append(measurement)
        if self._is_due(now_ns):
            self._want(is_urgent=False)
        self._begin_if_possible()

    @guarded
    def _on_route_plan(self, message: RoutePlan) -> None:
        before = self._inbox.mission
        known = self._routes.message_of(self._inbox.latest_mission)
        if (known is not None and 'route_plan' not in self._problems
                and says_the_same(message, known)):
            return
        event = self._routes.read(message, self._inbox)
        if not self._is_accepted(event):
            return
        if isinstance(event, TripCancelled):
            self._is_wanted = self._is_urgent = False
            return
        self._prepare_solver()
        # Forecasts for a known route may arrive faster than the solver works.
        self._want(is_urgent=before is None or before.route_id != message.route_id)
        self._begin_if_possible()

    def _is_accepted(self, event: Event) -> bool:
        """Deliver an event to the inbox; return whether it was accepted."""
        self._inbox, refusal = self._inbox.taken(event, self._now_ns())
        if refusal is not None:
            self._refuse(event.source, refusal)
            return False
        self._problems.pop(event.source, None)
        return True

    def _prepare_solver(self) -> None:
        mission = self._inbox.mission
        route = None
        if mission is not None:
            _, _, route = part_ahead(as_driven(mission, self._plan), self._now_ns())
        self._solver.prepare(route)
        self._poll_timer.reset()

    @guarded
    def _on_refused_route(self, error: InvalidInput) -> None:
        self._is_accepted(RouteUnreadable(error))

    @guarded
    def _on_preheat_plan(self, message: PreheatPlan) -> None:
        self._plan = message
        self._begin_if_possible()

    @guarded
    def _on_check(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        obstacle = self._obstacle()
        response.success = obstacle is None
        if response.success:
            self._want(is_urgent=True)
            self._begin_if_possible()
            response.message = f'The report will be published on {self._report_publisher.topic_name}.'
        else:
            response.message = obstacle
        return response

    def _refuse(self, source: str, error: InvalidInput) -> None:
        self._problems[source] = f'{source} refused: {error}.'
        # An error for the planner; here the car is not affected.
        if self._news.has(self._problems[source]):
            self.get_logger().warning(f'{source} refused: {error}')

    # When to check

    def _is_due(self, now_ns: int) -> bool:
        if (self._is_wanted or self._solver.is_busy or self._last_check_ns is None
                or self._values['check_period'] == 0.0):
            return False
        # A clock that was set back must not postpone the check.
        elapsed_s = (now_ns - self._last_check_ns) / NS_PER_S
        return not 0.0 <= elapsed_s < self._values['check_period']

    def _want(self, is_urgent: bool) -> None:
        self._is_wanted = True
        self._is_urgent = self._is_urgent or is_urgent

    def _obstacle(self) -> str | None:
        """Return the reason against a check now as a sentence; None if a check is possible."""
        mission, measurement = self._inbox.mission, self._inbox.measurement
        if mission is None:
            return self._inbox.refused_route or (
                'The trip was cancelled.' if self._inbox.is_cancelled else
                WITHOUT_ROUTE.explanation)
        if measurement is None:
            return 'No valid battery state has arrived yet.'
        age_s = (self._now_ns() - measurement.stamp_ns) / NS_PER_S
        if age_s > self._values['battery_state_timeout']:
            return f'The latest valid battery state is {age_s:.1f} s old.'
        mission = as_driven(mission, self._plan)
        if case_of_state(mission, self._inbox.goal_of, measurement, None) is None:
            has_ended = mission.legs[-1].route_ahead(measurement.stamp_ns) is None
            return 'The route has ended.' if has_ended else 'The vehicle is at a planned stop.'
        return None

    def _begin_if_possible(self) -> None:
        if not self._is_wanted or (self._solver.is_busy and not self._is_urgent):
            return
        if self._obstacle() is not None:
            self._ready_since_s = None
            return
        if self._ready_since_s is None:
            self._ready_since_s = monotonic()
        case = self._case_to_check()
        if case is not None:
            self._begin(case)
        elif self._poll_timer.is_canceled():
            self._poll_timer.reset()

    def _case_to_check(self) -> CheckedCase | None:
        """Return the Case of the planner's own plan, or of the latest state without a plan."""
        inbox = self._inbox
        mission, measurement = inbox.mission, inbox.measurement
        if mission is None or measurement is None:
            return None
        mission = as_driven(mission, self._plan)
        if self._plan is not None:
            oldest_ns = self._now_ns() - round(
                self._values['battery_state_timeout'] * NS_PER_S)
            fresh = [measurement for measurement in self._measurements
                     if measurement.stamp_ns >= oldest_ns]
            case = case_of_plan(mission, inbox.goal_of, fresh, self._plan)
            if case is not None:
                return case
        if self._ready_since_s is None or monotonic() - self._ready_since_s < PLAN_WAIT_S:
            return None
        return case_of_state(mission, inbox.goal_of, measurement, self._plan)

    def _begin(self, case: CheckedCase) -> None:
        if self._solver.is_busy and self._case is not None:
            self._counts['superseded'] += 1
            self.get_logger().info(
                f'Route {self._case.route_id!r}: superseded by a newer check.')
        self._is_wanted = self._is_urgent = False
        self._ready_since_s = None
        self._case, self._last_check_ns = case, self._now_ns()
        self._solver.ask(case.question, self._values['time_limit'])
        self._poll_timer.reset()
        self._publish_diagnostics()

    # Results

    @guarded
    def _on_poll(self) -> None:
        self._poll_solver()
        self._begin_if_possible()
        if not (self._solver.is_busy or self._solver.is_preparing
                or self._ready_since_s is not None):
            self._poll_timer.cancel()

    def _poll_solver(self) -> None:
        was_busy, outcome = self._solver.is_busy, self._solver.poll()
        if outcome is None:
            return
        if isinstance(outcome, Failure):
            self._counts['failures'] += was_busy
            self._problems['solver'] = f'{outcome.explanation}.'
            self.get_logger().warning(
                f'{outcome.explanation}; the next check is not affected.')
        else:
            self._problems.pop('solver', None)
        if was_busy and self._case is not None:
            self._report = report_message(self._case, outcome)
            self._solver_name = outcome.solver if isinstance(outcome, SolverAnswer) else ''
            self._report_publisher.publish(self._report)
            self._counts['reports'] += 1
            self._counts['programs built'] += getattr(outcome, 'programs_built', 0)
            self.get_logger().info(report_sentence(self._report))
        self._publish_diagnostics()

    @guarded
    def _on_diagnostics(self) -> None:
        # An idle process may end, too.
        self._poll_solver()
        self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        solver = self._solver
        values = {
            'state': 'solving' if solver.is_solving else
                     'starting the solver' if solver.is_busy else
                     'waiting for a plan' if self._ready_since_s is not None else
                     'preparing the solver' if solver.is_preparing else 'idle',
            'route_id': self._inbox.mission.route_id if self._inbox.mission else '',
            'checked route_id': self._case.route_id if self._case else '',
            'solver process': str(solver.process_id or 'none'),
            'solver prepared for [steps]': str(solver.prepared_steps or 'none'),
            **{name: str(count) for name, count in self._counts.items()}}
        if self._report is not None:
            values['last report'] = report_sentence(self._report)
            values['last report: answered by'] = self._solver_name or 'none'
        message = checker_diagnostics(
            self.get_fully_qualified_name(), self._inbox.vehicle.name,
            list(self._problems.values()), values, self._now_ns())
        message.status.append(self._setup.entry(self._inbox.vehicle.name))
        self._diagnostics_publisher.publish(message)

    # Parameters

    def _check_parameters(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        values = _own_values(parameters)
        try:
            check(PARAMETERS, values)
            if 'vehicle' in values:
                load_vehicle(values['vehicle'])
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            return SetParametersResult(
                successful=False,
                reason=shortened(f'cannot be checked: {type(error).__name__}: {error}',
                                 LONGEST_PROBLEM))
        return SetParametersResult(successful=True)

    @guarded
    def _apply_parameters(self, parameters: Sequence[RosParameter]) -> None:
        values = _own_values(parameters)
        if not values:
            return
        vehicle = load_vehicle(values['vehicle']) if 'vehicle' in values else None
        self._values = {**self._values, **values}
        self._inbox = self._inbox._replace(
            settings=_settings(self._values), vehicle=vehicle or self._inbox.vehicle)
        if vehicle is not None:
            self._solver.close()
            self._solver = self._solver_of(vehicle)
            self._solver.prepare()
            self._poll_timer.reset()
        if self._inbox.latest_mission is not None and not values.keys().isdisjoint(
                ('vehicle', 'planning_step')):
            inbox = self._inbox
            revised = Reconfigured(inbox.vehicle, inbox.settings, self._routes.read_again(
                inbox, inbox.vehicle, inbox.settings))
            if self._is_accepted(revised):
                self._prepare_solver()
                self._want(is_urgent=True)
                self._begin_if_possible()

    def _solver_of(self, vehicle: Vehicle) -> SolverProcess:
        return SolverProcess(vehicle, niceness=self._values['solver_niceness'])

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds

    def destroy_node(self) -> None:
        """End the solver's process, too."""
        self._solver.close()
        super().destroy_node()


def _own_values(parameters: Iterable[RosParameter]) -> Values:
    return {parameter.name: parameter.value for parameter in parameters
            if parameter.name in _OWN}


def _settings(values: Values) -> Settings:
    return Settings(battery_state_timeout_s=values['battery_state_timeout'],
                    clock_tolerance_s=values['clock_tolerance'],
                    planning_step_s=values['planning_step'],
                    estimation=False)


def main() -> None:
    """Run the checker until a signal ends it."""
    sys.exit(run_node(NlpCheckerNode, PROGRAM))


if __name__ == '__main__':
    main()
