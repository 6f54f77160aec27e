# SPDX-License-Identifier: Apache-2.0
"""
The checker's comparison, and its report.

Like is compared with like: plan and optimum start at the same instant, from the same battery
state, on the same steps of the same route, with the same goal.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import goal_of_leg, Leg, Measurement, Mission
from bev_preheat.errors import LONGEST_QUOTE, shortened
from bev_preheat.estimation.estimate import FACTOR_NAMES
from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.nonlinear_program.solver_process import Failure, Question, SolverAnswer
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.plan import difference, Plan
from bev_preheat.planning.planner import is_method
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat_msgs.msg import OptimalityReport, PreheatPlan, RoutePlan

# Two computations of the same steps differ only by rounding.
STEP_ROUNDING_S = 1e-3


@dataclass(frozen=True)
class Figures:
    """
    The compared figures; unknown: NaN.

    `heating_start_ns` is None if no heating is planned. The last three are the deficits, as in a Plan.
    """

    energy_wh: float = math.nan
    arrival_temperature_c: float = math.nan
    heating_start_ns: int | None = None
    shortfall_k: float = math.nan
    soc_shortfall: float = math.nan
    undeliverable_power_w: float = math.nan


UNKNOWN = Figures()


@dataclass(frozen=True)
class CheckedCase:
    """
    A situation to be checked from the instant `start_ns` [ns] on.

    `planned` are the planner's own figures. If it has none for exactly this situation, the question names the
    planner's method, and the solver's process plans as well. `cautious_energy_wh` is the energy of the
    planner's own plan if that was made with an uncertainty margin beyond the question's goal.
    """

    route_id: str
    start_ns: int
    method: str
    planned: Figures
    question: Question
    cautious_energy_wh: float = math.nan


def says_the_same(route_message: RoutePlan, other: RoutePlan) -> bool:
    """Return whether two RoutePlan messages are equal; NaN equals NaN."""
    def is_same(value: Any, other_value: Any) -> bool:
        if isinstance(value, array):
            return np.array_equal(value, other_value, equal_nan=True)
        return value == other_value or (value != value and other_value != other_value)

    return all(is_same(getattr(route_message, field), getattr(other, field))
               for field in route_message.get_fields_and_field_types())


def case_of_plan(mission: Mission, inbox: Inbox, measurements: Iterable[Measurement],
                 plan: PreheatPlan) -> CheckedCase | None:
    """
    Return the Case of a PreheatPlan; None if its inputs are unknown.

    The plan must be for a leg of this mission, in its steps, and start from a measurement, or from the estimate
    at the instant of a measurement; the Inbox has the settings that complete a goal.
    """
    under_way = plan.heater_power, plan.coolant_excess_temperature
    if (plan.route_id != mission.route_id
            or not 0 < len(plan.time) == len(plan.battery_temperature) == len(plan.soc)
            or {len(values) for values in under_way} not in ({0}, {len(plan.time)})):
        return None
    plan_start_ns = nanoseconds(plan.header.stamp)
    leg = mission.legs[mission.leg_number(plan_start_ns)]
    state = BatteryState(plan.battery_temperature[0], plan.soc[0],
                         *(values[0] for values in under_way if values))
    factors = tuple(plan.model_factors)
    for measurement in measurements:
        start_ns = max(measurement.stamp_ns, leg.start_ns)
        route = leg.route_ahead(start_ns)
        if (route is None
                or start_ns != plan_start_ns
                or len(plan.time) != len(route) + 1
                or not np.allclose(plan.time, route.time_s, rtol=0.0, atol=STEP_ROUNDING_S)):
            continue
        goal = _with_target_of(plan, leg, goal_of_leg(leg, inbox.vehicle, inbox.settings))
        if not factors and state == measurement.state:
            return CheckedCase(mission.route_id, start_ns, plan.method, _figures_of_message(plan),
                               Question(route, state, goal), plan.battery_energy)
        # Only a car with other heat sources has the last factor.
        if len(FACTOR_NAMES) - len(factors) in (0, 1) and is_method(plan.method):
            # Made with an uncertainty margin: compare the optimum with the method without the margin.
            return CheckedCase(mission.route_id, start_ns, plan.method, UNKNOWN,
                               Question(route, state, goal, plan.method, factors), plan.battery_energy)
    return None


def as_driven(mission: Mission, plan: PreheatPlan | None) -> Mission:
    """Return the Mission with the delay of its PreheatPlan; None: no plan yet."""
    if plan is None or plan.route_id != mission.route_id or not math.isfinite(plan.delay):
        return mission
    return mission.delayed(round(plan.delay * NS_PER_S))


def case_of_state(mission: Mission, inbox: Inbox, measurement: Measurement,
                  plan: PreheatPlan | None) -> CheckedCase | None:
    """
    Return the Case of a measurement; None at a stop and after the end of the route.

    `plan` is the latest PreheatPlan or None. If it is for this route, its method plans again; otherwise there is
    nothing to compare the optimum with. The Inbox has the settings that complete a goal.
    """
    leg = mission.legs[mission.leg_number(measurement.stamp_ns)]
    start_ns = max(measurement.stamp_ns, leg.start_ns)
    route = leg.route_ahead(start_ns)
    if route is None:
        return None
    method, goal = '', goal_of_leg(leg, inbox.vehicle, inbox.settings)
    if plan is not None and plan.route_id == mission.route_id:
        method, goal = plan.method, _with_target_of(plan, leg, goal)
    return CheckedCase(mission.route_id, start_ns, method, UNKNOWN,
                       Question(route, measurement.state, goal, method if is_method(method) else ''))


def _with_target_of(plan: PreheatPlan, leg: Leg, goal: Goal) -> Goal:
    # If the route names no target, the planner's parameter applies, which only its plan reports.
    if leg.target_temperature_c is None and math.isfinite(plan.target_battery_temperature):
        return replace(goal, target_temperature_c=plan.target_battery_temperature)
    return goal


def _figures_of_message(plan: PreheatPlan) -> Figures:
    return Figures(plan.battery_energy, plan.predicted_arrival_temperature,
                   nanoseconds(plan.heating_start) if plan.heating_planned else None,
                   plan.shortfall, plan.soc_shortfall, plan.undeliverable_power)


def _figures_of_plan(plan: Plan, start_ns: int) -> Figures:
    return Figures(plan.energy_wh.battery_total, plan.arrival_temperature_c,
                   None if plan.heating_start_s is None
                   else start_ns + round(plan.heating_start_s * NS_PER_S),
                   plan.shortfall_k, plan.soc_shortfall, plan.undeliverable_power_w)


def report_message(case: CheckedCase, outcome: SolverAnswer | Failure) -> OptimalityReport:
    """Return the OptimalityReport of a Case and its outcome, a Solution or a Failure."""
    message = OptimalityReport(
        route_id=case.route_id, method=shortened(case.method, LONGEST_QUOTE))
    message.header.stamp = time_message(case.start_ns)
    planned, optimal = case.planned, UNKNOWN
    if isinstance(outcome, SolverAnswer):
        optimum = outcome.optimum
        message.solver_status = optimum.solver_status
        message.optimal = not optimum.deficit
        message.infeasible_constraint = '; '.join(optimum.infeasible)
        message.solve_time = optimum.solve_time_s
        optimal = _figures_of_plan(optimum.plan, case.start_ns)
        if outcome.method_plan is not None:
            planned = _figures_of_plan(outcome.method_plan, case.start_ns)
    else:
        message.solver_status = outcome.explanation
        message.solve_time = outcome.elapsed_s
    for prefix, figures in (('plan', planned), ('optimal', optimal)):
        setattr(message, f'{prefix}_energy', figures.energy_wh)
        setattr(message, f'{prefix}_arrival_temperature', figures.arrival_temperature_c)
        setattr(message, f'{prefix}_heating', figures.heating_start_ns is not None)
        setattr(message, f'{prefix}_heating_start', time_message(figures.heating_start_ns or 0))
    message.energy_gap = math.nan if difference(planned, optimal) else (
        planned.energy_wh - optimal.energy_wh)
    message.caution_energy = case.cautious_energy_wh - planned.energy_wh
    return message


def report_sentence(report: OptimalityReport) -> str:
    """Return an OptimalityReport in one sentence."""
    about = f'Route {report.route_id!r}: {report.solver_status}'
    if math.isnan(report.optimal_energy):
        return f'{about}.'
    about += f' after {report.solve_time:.2f} s'
    if report.infeasible_constraint:
        about += f', {report.infeasible_constraint}'
    if math.isnan(report.plan_energy):
        return f'{about}; there is no plan to compare with.'
    warmer_k = report.plan_arrival_temperature - report.optimal_arrival_temperature
    if math.isnan(report.energy_gap):
        return (f'{about}; the plan of method {report.method} does not reach the same, so their '
                f'energies are not compared: it arrives at {warmer_k:+.2f} K.')
    return (f'{about}; against it the plan of method {report.method} costs '
            f'{report.energy_gap:+.3f} Wh and arrives at {warmer_k:+.3f} K.')
