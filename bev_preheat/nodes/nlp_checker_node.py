# SPDX-License-Identifier: Apache-2.0
"""`nlp_checker`: how far the planner's plan is from the optimum of the nonlinear program."""

from __future__ import annotations

from collections import deque
from time import monotonic

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from bev_preheat.control.decision import WITHOUT_ROUTE
from bev_preheat.control.events import BatteryStateArrived, Event, Reconfigured, TripCancelled
from bev_preheat.control.inputs import Measurement
from bev_preheat.messages.diagnostics import entry, OK, WARN
from bev_preheat.nodes.inbox_node import InboxNode, INPUT_PARAMETERS, VEHICLE
from bev_preheat.nodes.node import guarded, Values
from bev_preheat.nodes.optimality_report import (
    as_driven,
    case_of_plan,
    case_of_state,
    CheckedCase,
    report_message,
    report_sentence,
    says_the_same,
)
from bev_preheat.nodes.parameters import Parameter, StartParameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.topics import LATCHED
from bev_preheat.nonlinear_program.solver_process import Failure, MOST_NICE, SolverProcess
from bev_preheat.numerics import NS_PER_S
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle, Vehicle
from bev_preheat_msgs.msg import OptimalityReport, PreheatPlan, RoutePlan

PARAMETERS = (
    VEHICLE,
    Parameter('check_period', 60.0,
              'Time between two checks; 0: only new routes and on demand',
              's', (0.0, 86400.0)),
    Parameter('time_limit', 10.0, 'The solver is stopped after this time', 's', (0.1, 600.0)),
    StartParameter('solver_niceness', MOST_NICE, "The solver's niceness towards other processes: added to the "
                   "node's own nice value", limits=(0, MOST_NICE)),
    *INPUT_PARAMETERS,
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

# Period of polling a busy solver process, in real time.
POLL_PERIOD_S = 0.05
# The planner plans in milliseconds; without its plan by then, the checker plans with the planner's method.
PLAN_WAIT_S = 1.0
# The planner may lag by some battery states.
STATES_KEPT = 16


class NlpCheckerNode(InboxNode):
    """
    Receives the planner's inputs and plans, and lets a `SolverProcess` solve the same problem.

    A check is due for each new route, on demand and after `check_period`. It begins when the planner's plan for a
    known battery state has arrived, or has not arrived for PLAN_WAIT_S. A check for a new route or on demand
    cancels the running check.
    """

    def __init__(self) -> None:
        require('casadi')
        super().__init__(PROGRAM)
        self._solver = self._solver_of(self.inbox.vehicle)
        # Loading the solver takes longer than solving; the first check must not wait for it.
        self._solver.start()
        self._measurements: deque[Measurement] = deque(maxlen=STATES_KEPT)
        self._plan: PreheatPlan | None = None
        # Instants are time.monotonic(), except for the last check's, which is in the node's time.
        self._is_wanted = self._is_urgent = False
        self._ready_since_s: float | None = None
        self._case: CheckedCase | None = None
        self._report: OptimalityReport | None = None
        self._last_check_ns: int | None = None
        # Of the latest accepted route; None: none yet.
        self._route_id: str | None = None
        self._counts = {'reports': 0, 'failures': 0, 'superseded': 0}

        self._report_publisher = self.create_publisher(OptimalityReport, 'optimality_report', LATCHED)
        self.create_subscription(PreheatPlan, 'preheat_plan', self._on_preheat_plan, LATCHED)
        self.create_service(Trigger, '~/check', self._on_check)
        self.follow_parameters()
        # The solver works in real time, independent of the node's clock.
        self._poll_timer = self.steady_timer(POLL_PERIOD_S, self._on_poll)
        self.watch(('battery_state', 'route_plan', 'preheat_plan'), ('optimality_report',))
        self.get_logger().info(f'Checking plans for vehicle {self.hardware}.')

    # Input

    def is_news(self, message: RoutePlan) -> bool:
        """Return whether a route plan differs from the one before it."""
        known = self.routes.message_of(self.inbox.latest_mission)
        return known is None or 'route_plan' in self.problems or not says_the_same(message, known)

    def on_event(self, event: Event) -> None:
        """Decide after a battery state or a route whether to check."""
        if isinstance(event, TripCancelled):
            self._is_wanted = self._is_urgent = False
            self._route_id = None
            return
        if isinstance(event, BatteryStateArrived):
            measurement = event.measurement
            if self._measurements and measurement.stamp_ns < self._measurements[-1].stamp_ns:
                # The clock was set back; earlier measurements belong to another time.
                self._measurements.clear()
            self._measurements.append(measurement)
            if self._is_due(self.now_ns()):
                self._want(is_urgent=False)
        else:
            self._start_solver()
            before, mission = self._route_id, self.inbox.mission
            self._route_id = mission.route_id if mission else None
            # Forecasts for a known route may arrive faster than the solver works.
            self._want(is_urgent=before != self._route_id)
        self._begin_if_possible()

    def _start_solver(self) -> None:
        self._solver.start()
        self._poll_timer.reset()

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

    # When to check

    def _is_due(self, now_ns: int) -> bool:
        if (self._is_wanted or self._solver.is_busy or self._last_check_ns is None
                or self.values['check_period'] == 0.0):
            return False
        # A clock that was set back must not postpone the check.
        elapsed_s = (now_ns - self._last_check_ns) / NS_PER_S
        return not 0.0 <= elapsed_s < self.values['check_period']

    def _want(self, is_urgent: bool) -> None:
        self._is_wanted = True
        self._is_urgent = self._is_urgent or is_urgent

    def _obstacle(self) -> str | None:
        """Return the reason against a check now as a sentence; None if a check is possible."""
        mission, measurement = self.inbox.mission, self.inbox.measurement
        if mission is None:
            return self.inbox.refused_route or (
                'The trip was cancelled.' if self.inbox.is_cancelled else
                WITHOUT_ROUTE.explanation)
        if measurement is None:
            return 'No valid battery state has arrived yet.'
        age_s = (self.now_ns() - measurement.stamp_ns) / NS_PER_S
        if age_s > self.values['battery_state_timeout']:
            return f'The latest valid battery state is {age_s:.1f} s old.'
        mission = as_driven(mission, self._plan)
        if case_of_state(mission, self.inbox, measurement, None) is None:
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
        inbox = self.inbox
        mission, measurement = inbox.mission, inbox.measurement
        if mission is None or measurement is None:
            return None
        mission = as_driven(mission, self._plan)
        if self._plan is not None:
            oldest_ns = self.now_ns() - round(
                self.values['battery_state_timeout'] * NS_PER_S)
            fresh = [measurement for measurement in self._measurements
                     if measurement.stamp_ns >= oldest_ns]
            case = case_of_plan(mission, inbox, fresh, self._plan)
            if case is not None:
                return case
        if self._ready_since_s is None or monotonic() - self._ready_since_s < PLAN_WAIT_S:
            return None
        return case_of_state(mission, inbox, measurement, self._plan)

    def _begin(self, case: CheckedCase) -> None:
        if self._solver.is_busy and self._case is not None:
            self._counts['superseded'] += 1
            self.get_logger().info(
                f'Route {self._case.route_id!r}: superseded by a newer check.')
        self._is_wanted = self._is_urgent = False
        self._ready_since_s = None
        self._case, self._last_check_ns = case, self.now_ns()
        self._solver.ask(case.question, self.values['time_limit'])
        self._poll_timer.reset()
        self.publish_diagnostics()

    # Results

    @guarded
    def _on_poll(self) -> None:
        self._poll_solver()
        self._begin_if_possible()
        if not (self._solver.is_busy or self._solver.is_starting
                or self._ready_since_s is not None):
            self._poll_timer.cancel()

    def _poll_solver(self) -> None:
        was_busy, outcome = self._solver.is_busy, self._solver.poll()
        if outcome is None:
            return
        if isinstance(outcome, Failure):
            self._counts['failures'] += was_busy
            self.problems['solver'] = f'{outcome.explanation}.'
            self.get_logger().warning(
                f'{outcome.explanation}; the next check is not affected.')
        else:
            self.problems.pop('solver', None)
        if was_busy and self._case is not None:
            self._report = report_message(self._case, outcome)
            self._report_publisher.publish(self._report)
            self._counts['reports'] += 1
            self.get_logger().info(report_sentence(self._report))
        self.publish_diagnostics()

    def entries(self) -> list[DiagnosticStatus]:
        """Return the entry on checks; never ERROR, because the checker's problems never affect the car."""
        # An idle process may end, too.
        self._poll_solver()
        solver, problems = self._solver, list(self.problems.values())
        values = {
            'state': 'solving' if solver.is_solving else
                     'waiting for a plan' if self._ready_since_s is not None else
                     'starting the solver' if solver.is_busy or solver.is_starting else 'idle',
            'route_id': self.inbox.mission.route_id if self.inbox.mission else '',
            'checked route_id': self._case.route_id if self._case else '',
            'solver process': str(solver.process_id or 'none'),
            **{name: str(count) for name, count in self._counts.items()}}
        if self._report is not None:
            values['last report'] = report_sentence(self._report)
        return [entry('optimality check', WARN if problems else OK, ' '.join(problems) or 'OK', values)]

    # Parameters

    def check_values(self, changed: Values) -> None:
        """Refuse a vehicle that cannot be loaded."""
        if 'vehicle' in changed:
            load_vehicle(changed['vehicle'])

    def take_values(self, changed: Values) -> None:
        """Read the route again, and check it."""
        vehicle = load_vehicle(changed['vehicle']) if 'vehicle' in changed else None
        self.inbox = self.inbox._replace(settings=self.settings(), vehicle=vehicle or self.inbox.vehicle)
        if vehicle is not None:
            self.hardware = vehicle.name
            self._solver.close()
            self._solver = self._solver_of(vehicle)
            self._start_solver()
        if self.inbox.latest_mission is not None and not changed.keys().isdisjoint(('vehicle', 'planning_step')):
            inbox = self.inbox
            revised = Reconfigured(inbox.vehicle, inbox.settings, self.routes.read_again(
                inbox, inbox.vehicle, inbox.settings))
            if self.accepts(revised):
                self._start_solver()
                self._want(is_urgent=True)
                self._begin_if_possible()

    def _solver_of(self, vehicle: Vehicle) -> SolverProcess:
        return SolverProcess(vehicle, niceness=self.values['solver_niceness'])

    def destroy_node(self) -> None:
        """End the solver's process, too."""
        self._solver.close()
        super().destroy_node()
