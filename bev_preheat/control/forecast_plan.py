# SPDX-License-Identifier: Apache-2.0
"""
Plans from the estimate.

A forecast plan uses the estimated state, the corrected model, the uncertainty of the rest of the drive (how much
earlier it heats: `planning.recursion`), and the heater as it responds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial
import math
from typing import Any, NamedTuple

import numpy as np

from bev_preheat.control.decision import Decision, Moment
from bev_preheat.control.heater import FAULTS
from bev_preheat.control.inputs import OF_ROUTE, Terms
from bev_preheat.estimation.estimate import Estimate, FACTORS, nominal_heat_lag_s, OF_CAR
from bev_preheat.estimation.forecast import DrivenRoute, Forecast
from bev_preheat.estimation.hypotheses import Heater, HeaterReport, SuspectedFault
from bev_preheat.estimation.prior import prior_factor_covariance
from bev_preheat.numerics import array_exp, FloatArray
from bev_preheat.planning.explanation import explain
from bev_preheat.planning.full_power import FullPower
from bev_preheat.planning.heat_run import state_with_heat_under_way
from bev_preheat.planning.methods import Kept, KeptValues
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, highest_start_c, reserve_soc, Uncertainty
from bev_preheat.planning.status import LATER, Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import Route
from bev_preheat.tunables import (
    FACTOR_STEP,
    LAG_REVEALED_S,
    LAG_STEP,
    LEAST_REVEALED_K,
    MOST_EXCESS_K,
    MOST_REVEALED_K,
    NOMINAL_HEAT_LAG_S,
    SUSPECT_SAID_S,
)
from bev_preheat.vehicle.description import HeatPath, HVCH, Vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

FACTOR_STEPS = FACTOR_STEP * np.sqrt(np.diag(prior_factor_covariance()))[
    [index - FACTORS.start for index in OF_CAR]]

# Words for `explain` on a plan without heating if the heater is the cause.
UNHEATED: dict[Heater, dict[str, Any]] = {
    Heater.DEAD: {'too_cold_because': 'Driving alone does not warm the battery enough'},
    Heater.STUCK_ON: {'too_cold_because': 'Its uncommanded heat is not enough',
                      'unheated': 'no heating is commanded'},
}


class PlanningTask(NamedTuple):
    """A route that starts in `starts_in_s` [s] and a goal, by the terms of its source, to plan for at a Moment."""

    route: Route
    goal: Goal
    moment: Moment
    starts_in_s: float = 0.0
    terms: Terms = OF_ROUTE

    @property
    def unserved(self) -> str:
        """The sentences on other heat sources that do not heat; '' for none."""
        return ' '.join(each.sentence for each in self.moment.unserved)


def _others_heat(plan: Plan) -> bool:
    """Return whether a Plan without the HVCH heats with other sources."""
    return bool(plan.source_power_w) and plan.heating_start_s is not None


def _told(plan: Plan, vehicle: Vehicle, task: PlanningTask, **told: Any) -> Plan:
    """Return a Plan with status and sentence as of now, before its time 0; `told` are arguments of `in_words`."""
    status = LATER.get(plan.status, plan.status) if task.starts_in_s > 0.0 else plan.status
    return plan.told(status, partial(
        in_words, unserved=task.unserved, reserve=reserve_soc(vehicle, task.goal), starts_in_s=task.starts_in_s,
        heated_s=task.moment.heated_s, **told))


def planned_as_measured(vehicle: Vehicle, state: BatteryState, task: PlanningTask) -> Decision:
    """Return the Decision by a BatteryState as measured, without an estimate; raises as plan_preheating."""
    situation = vehicle, task.route, state, task.goal, task.moment.settings.method
    plan, commanded, refusal, share = task.terms.plan(*situation), None, '', 1.0
    start_s = {0: None, 1: plan.heating_start_s, -1: plan.cooling_start_s}[task.moment.direction]
    if start_s is not None and 0.0 < start_s <= task.moment.settings.minimum_off_time_s:
        # The noise of a reading asks for a pause that would last longer: this plan knows the price of a switch-on.
        plan = task.terms.plan(*situation, Uncertainty(LEAST_REVEALED_K, task.moment.direction))
    if task.moment.heater_refusal and plan.heating_start_s is not None:
        plan, commanded, refusal = plan_preheating(*situation, heater_share=0.0), plan, task.moment.heater_refusal
        commanded, share = (None, 0.0) if _others_heat(plan) else (commanded, share)
    plan = _told(plan, vehicle, task, refusal=refusal)
    return Decision(plan.status, None, plan, commanded=commanded, command_share=share, vehicle=vehicle)


def believed_state(vehicle: Vehicle, estimate: Estimate) -> BatteryState:
    """Return the BatteryState of an Estimate for a Vehicle, with the heat under way."""
    lowest_c, highest_c = vehicle.battery.temperature_range_c[0], highest_start_c(vehicle)
    path, temperature_c = vehicle.heat_path, estimate.planned_temperature_c
    if path.is_direct:
        temperature_c += estimate.outside_k
    temperature_c = min(max(temperature_c, lowest_c), highest_c)
    if path.is_direct:
        return BatteryState(temperature_c, estimate.soc)
    if path.is_shell:
        excess_k = min(max(estimate.shell_excess_k, -MOST_EXCESS_K), MOST_EXCESS_K)
        return BatteryState(temperature_c, estimate.soc, coolant_excess_k=excess_k)
    return state_with_heat_under_way(vehicle, temperature_c, estimate.soc, estimate.outside_k)


def believed_share(heater: HeaterReport) -> float:
    """Return the share of its power that the heater delivers, 0 ... 1, for planning the command."""
    return heater.share if heater.heater is Heater.DERATED else 1.0


@lru_cache(maxsize=8)
def _corrected(vehicle: Vehicle, factors: tuple[float, ...], lag_log: float) -> Vehicle:
    car = corrected_vehicle(vehicle, Corrections(*factors))
    path = car.heat_path
    return car if not path.is_shell else replace(car, heat_path=replace(
        path, coolant_conductance_w_per_k=path.coolant_conductance_w_per_k * factors[0] * math.exp(-lag_log)))


@lru_cache(maxsize=8)
def _lagging(vehicle: Vehicle, lag_log: float) -> Vehicle:
    """Return a Vehicle whose file describes no heat path, with the estimated lag."""
    return replace(vehicle, heat_path=HeatPath(NOMINAL_HEAT_LAG_S * math.exp(lag_log)))


@dataclass(frozen=True, eq=False)
class ForecastPlanner:
    """
    Plans for one vehicle from the estimate; a value.

    `factors` are those of the corrected vehicle, `logs` their logarithms; None before the first estimate.
    `lag_log` is the logarithm of the lag of the plans' heat over `nominal_heat_lag_s`.
    `forecast` is that of the latest plan, None: unknown. `kept` has the values of plans while they hold.
    """

    logs: FloatArray | None = None
    factors: tuple[float, ...] = ()
    lag_log: float = 0.0
    forecast: Forecast | None = None
    kept: tuple[Kept, ...] = ()

    def for_other_limits(self) -> ForecastPlanner:
        """Return the planner for the same vehicle with other power limits."""
        return replace(self, logs=None)

    def for_new_mission(self) -> ForecastPlanner:
        """Return the planner without the arrival's uncertainty: the route has changed."""
        return replace(self, forecast=None)

    def following(self, estimate: Estimate) -> ForecastPlanner:
        """Return the planner with the factors of an Estimate, if one has moved."""
        logs = estimate.mean[[*OF_CAR]]
        lag_log = math.log(estimate.outside_lag_s / nominal_heat_lag_s(estimate.path))
        if self.logs is None or (np.abs(logs - self.logs) > FACTOR_STEPS).any() or (
                abs(lag_log - self.lag_log) > LAG_STEP):
            return replace(self, logs=logs, factors=tuple(array_exp(logs).tolist()), lag_log=lag_log)
        return self

    def vehicle(self, described: Vehicle) -> Vehicle:
        """Return a Vehicle corrected by the factors."""
        return described if not self.factors else _corrected(
            described, self.factors, self.lag_log if described.heat_path.is_shell else 0.0)

    def make(self, described: Vehicle, task: PlanningTask,
             estimate: Estimate) -> tuple[ForecastPlanner, Decision]:
        """
        Return the Decision on a PlanningTask from an Estimate's instant on, and the planner after it.

        `described` is the Vehicle as its file describes it. Raises what plan_preheating raises.
        """
        planner = self.following(estimate)
        kept = KeptValues(self.kept)
        car = task.terms.vehicle(planner.vehicle(described))
        if car.heat_path.is_direct and not car.heat_sources:
            # Later heating until arrival would need a lag that is known.
            car = _lagging(car, planner.lag_log)
            task = task._replace(goal=replace(task.goal, heats_until_arrival=False))
        planning = _Planning(task, estimate, car, kept)
        forecast = self.forecast
        wanted = planning.wanted(forecast)
        if forecast is None:
            # The uncertainty depends on the plan that it is for.
            # With a first plan without it, a route that is replaced on the way can change the command.
            forecast = planning.forecast(wanted)
            wanted = planning.wanted(forecast)
        expected, commanded, words = planning.expected(wanted, forecast)
        forecast = planning.forecast(expected)
        plan = planning.in_words(expected, forecast, words)
        return replace(planner, forecast=forecast, kept=kept.latest), Decision(
            plan.status, None, plan, forecast=forecast, commanded=commanded,
            command_share=0.0 if planning.is_hvch_silent and _others_heat(expected) else planning.share,
            model_factors=(*planner.factors[:4], estimate.propulsion_factor, *(
                planner.factors[4:] if described.heat_sources else ()))
            if estimate.heater.heater is Heater.ANSWERS else (), vehicle=car)


class _Planning:
    """The plans for one task with one estimate and its corrected vehicle."""

    def __init__(self, task: PlanningTask, estimate: Estimate, vehicle: Vehicle, kept: KeptValues) -> None:
        self._task, self._estimate, self._vehicle, self._kept = task, estimate, vehicle, kept
        self._state = believed_state(vehicle, estimate)
        self.share = believed_share(estimate.heater) * task.moment.heater_share
        # A mix of heat sources has no lag in its model; its heat is planned to come later as a whole.
        self._lag_s = estimate.outside_lag_s if vehicle.heat_path.is_direct else 0.0
        self._route = task.route.with_propulsion(estimate.propulsion_factor)
        self._step_prices = task.terms.step_prices(task.route)
        self._full_power = (FullPower(vehicle, self._route, self._state, self.share, self._lag_s)
                            if task.terms.is_at_once else None)

    def wanted(self, forecast: Forecast | None) -> Plan:
        """Return the Plan to heat by, with the Uncertainty of a Forecast; None: as if all was known."""
        if self._full_power is None:
            return self._plan(forecast, heater_share=self.share)

        def plan_on(part: Route) -> Plan:
            self._route = part
            return self._plan(forecast, heater_share=self.share)

        return self._full_power.plan(self._vehicle, self._task.goal, plan_on)

    def expected(self, wanted: Plan, forecast: Forecast) -> tuple[Plan, Plan | None, dict[str, Any]]:
        """Return (expected, commanded, words for `explain`): any heater is commanded as if it obeyed."""
        heater = self._estimate.heater.heater
        words = UNHEATED.get(heater, {})
        if self.is_hvch_silent:
            plan = self._plan(forecast, heater_share=0.0)
            commanded = self._until_arrival(plan, forecast, 0.0) if _others_heat(plan) else wanted
            return plan, commanded, UNHEATED[Heater.DEAD]
        if heater is Heater.STUCK_ON:
            return self._plan(forecast, heats_throughout=True), None, words
        return wanted, self._until_arrival(wanted, forecast, self.share), words

    def _until_arrival(self, plan: Plan, forecast: Forecast, share: float) -> Plan | None:
        """Return the Plan that heats on until arrival, with a share of the HVCH, if a target is out of reach."""
        if plan.status is not Status.TARGET_UNREACHABLE or self._lag_s == 0.0:
            return None
        # Most of the last heat arrives too late, but some is better than none.
        return self._plan(forecast, heat_lag_s=0.0, heater_share=share)

    @property
    def is_hvch_silent(self) -> bool:
        """Whether the HVCH is dead or refuses heat."""
        return self._estimate.heater.heater is Heater.DEAD or bool(self._task.moment.heater_refusal)

    def forecast(self, plan: Plan) -> Forecast:
        """Return the Forecast of a Plan."""
        # The steps of a trip differ from its route only if long segments were divided.
        has_steps_of_route = len(plan.command_w) == len(self._route)
        route = self._route if has_steps_of_route else make_trip(self._vehicle, self._route, self.share).route
        return Forecast(DrivenRoute(self._vehicle, route), plan, self._estimate, self._task.moment.suspected)

    def in_words(self, expected: Plan, forecast: Forecast, words: dict[str, Any]) -> Plan:
        """Return the Plan with status and sentence as of now, and with the battery's own energy."""
        task = self._task
        if task.moment.heater_refusal:
            words = {**words, 'refusal': task.moment.heater_refusal}
        return task.terms.accounted(_told(
            expected, self._vehicle, task, heater=self._estimate.heater, forecast=forecast,
            suspected=task.moment.suspected, limited_share=task.moment.heater_share, **words),
            self._estimate.soc)

    def _plan(self, forecast: Forecast | None, **heater_as: Any) -> Plan:
        task, goal = self._task, self._task.goal
        if forecast is not None and math.isfinite(goal.maximum_arrival_temperature_c):
            # In tenths of a kelvin, so that the values of a plan hold for a while.
            goal = replace(goal, local_rise_k=round(max(forecast.local_rise_k, 0.0), 1))
        return plan_preheating(
            self._vehicle, self._route, self._state, goal, task.moment.settings.method,
            self._uncertainty(forecast), step_prices=self._step_prices, kept=self._kept,
            **{'heat_lag_s': self._lag_s, **heater_as})

    def _uncertainty(self, forecast: Forecast | None) -> Uncertainty | None:
        """Return the Uncertainty that the rest of the drive adds, without that of now; None: all is known."""
        if forecast is None:
            return None
        estimate, hvch = self._estimate, self._vehicle.hvch
        revealed_k2 = forecast.as_planned_k ** 2 - estimate.settled_deviation_k ** 2
        later_k = estimate.later_heat_s * (
            hvch.efficiency * hvch.maximum_power_w / self._vehicle.pack_heat_capacity_j_per_k)
        later_share = max(1.0 - self._task.moment.heated_s / LAG_REVEALED_S, 0.0)
        deviation_k = math.hypot(math.sqrt(max(revealed_k2, 0.0)), later_share * later_k)
        return Uncertainty(
            min(max(deviation_k, LEAST_REVEALED_K), MOST_REVEALED_K) if math.isfinite(deviation_k) else
            MOST_REVEALED_K,
            # Heating as soon as possible needs no reason to begin.
            self._task.moment.direction if self._full_power is None else 1)


def in_words(plan: Plan, heater: HeaterReport | None = None, forecast: Forecast | None = None, refusal: str = '',
             limited_share: float = 1.0, unserved: str = '',
             suspected: tuple[tuple[str, SuspectedFault], ...] = (), **told: Any) -> str:
    """
    Return a plan's sentence with the heater's behaviour and the uncertainty, None: unknown, and its refusal.

    By its own answer a fault limits the heater to `limited_share`. `unserved` are sentences on other heat sources,
    `suspected` the faults not reported yet by name, `told` are the other arguments of
    planning.explanation.explain.
    """
    if refusal:
        told = {**UNHEATED[Heater.DEAD], **told}
    sentence = f'{refusal} ' if refusal else ''
    if heater is not None and heater.heater in FAULTS and not refusal:
        sentence = f'{FAULTS[heater.heater].format("heater", share=100.0 * heater.share)} '
    elif limited_share < 1.0 and not refusal:
        sentence = f'{FAULTS[Heater.DERATED].format("heater", share=100.0 * limited_share)} '
    for name, fault in () if refusal else suspected:
        if fault.lasts_s >= SUSPECT_SAID_S:
            sentence += (f'The {"heater" if name == HVCH else name} may be {fault.heater.value} '
                         f'({min(100.0 * fault.probability, 99.0):.0f} %). ')
    sentence += f'{unserved} ' if unserved else ''
    sentence += explain(plan, **told)
    if forecast is not None and plan.heating_end_s is not None:
        sentence += (f' Uncertainty +-{forecast.deviation_k:.1f} K (1 sigma): heating starts early and stops '
                     'once the target is certain.')
    return sentence
