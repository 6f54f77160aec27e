# SPDX-License-Identifier: Apache-2.0
"""
Plans from what is believed.

That is the estimated state, the corrected model, a margin for the uncertainty, and the heater as it
answers.
"""

from __future__ import annotations

from functools import partial
import math
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.control.preparation_plan import accounted, fed, FullPower
from bev_preheat.estimation.forecast import DrivenRoute, Forecast
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.prior import prior_factor_covariance
from bev_preheat.estimation.state import FACTORS, PROPULSION
from bev_preheat.numerics.arithmetic import array_exp
from bev_preheat.planning.explanation import explain
from bev_preheat.planning.heat_run import state_with_heat_under_way
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.uncertainty_margin import UncertaintyMargin
from bev_preheat.vehicle.corrections import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from bev_preheat.control.preparation_goal import PreparationGoal
    from bev_preheat.control.settings import Settings
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.hypotheses import HeaterReport
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

# The battery is to arrive warmer than the target by so many deviations of what cannot be made good
# any more once heating has ended, at most by MOST_MARGIN_K.
MARGIN_DEVIATIONS = 1.3
MOST_MARGIN_K = 0.1
# The last stretch of heating begins early by so many deviations of the temperature on arrival, and
# by the heat that is made while its lag is so many deviations longer than believed; together at most
# by MOST_LEAD_K: until it begins more will be learned. Both found on `preheat robustness`.
LEAD_DEVIATIONS = 2.0
LATER_DEVIATIONS = 1.2
MOST_LEAD_K = 7.0
# The lead is not taken back for a shorter pause, because the first minutes of heating may only show the sensor's
# place.
LEAST_PAUSE_S = 600.0
# A heater that is off is not switched on before arrival for less heating than this, some 120 Wh.
LEAST_HEATING_S = 90.0
# The corrected vehicle is made anew where a factor has moved by more than this share of what is
# uncertain of it in a car of which only the file is known.
FACTOR_STEP = 0.05

FACTOR_STEPS = (FACTOR_STEP * np.sqrt(np.diag(prior_factor_covariance()))).tolist()[
    :PROPULSION - FACTORS.start]

SENTENCES = {
    Heater.DERATED: 'The heater gives only {share:.0f} % of what is commanded. ',
    Heater.DEAD: 'The heater does not respond to its command. ',
    Heater.STUCK_ON: 'The heater heats without a command. ',
}
# What `explain` says of a plan without heating, where the heater is the cause.
UNHEATED: dict[Heater, dict[str, Any]] = {
    Heater.DEAD: {'too_cold_because': 'Driving alone does not warm the battery enough'},
    Heater.STUCK_ON: {'too_cold_because': 'Its uncommanded heat is not enough',
                      'unheated': 'no heating is commanded'},
}
# … and where the heat of the command would mostly be late for the arrival.
LATE: dict[str, Any] = {'too_cold_because': 'Most of the heat arrives too late'}


class ForecastPlan(NamedTuple):
    """
    A Plan from an estimate; what is to be expected.

    `commanded` is the plan that the command follows, where it is another one: a heater that does
    not respond is still commanded. `command_share` is what the heater gives of its command, `forecast`
    says how sure the temperature on arrival is. `model_factors` are those of the corrected car; () where
    a heater that does not obey is beyond them.
    """

    plan: Plan
    forecast: Forecast
    commanded: Plan | None
    command_share: float
    model_factors: tuple[float, ...]


def seen_from_now(plan: Plan, vehicle: Vehicle, goal: Goal, starts_in_s: float,
                  heated_s: float = 0.0) -> Plan:
    """
    Return a Plan whose status and sentence hold now; its time 0 lies `starts_in_s` [s] ahead.

    The battery has been heated for `heated_s` [s].
    """
    return plan.told(_status_now(plan, starts_in_s), partial(
        explain, reserve=reserve_soc(vehicle, goal), starts_in_s=starts_in_s, heated_s=heated_s))


def _status_now(plan: Plan, starts_in_s: float) -> Status:
    """Return the Status of a Plan that holds now; its time 0 lies `starts_in_s` [s] ahead."""
    return (Status.WAITING if plan.status is Status.HEATING and starts_in_s > 0.0
            else plan.status)


def believed_state(vehicle: Vehicle, estimate: Estimate) -> BatteryState:
    """Return the BatteryState that an Estimate means for a Vehicle, with the heat that is under way."""
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    if vehicle.heat_path.is_direct:
        # What is under way arrives.
        return BatteryState(min(max(
            estimate.temperature_c + estimate.under_way_k, lowest_c), highest_c), estimate.soc)
    return state_with_heat_under_way(
        vehicle, min(max(estimate.temperature_c, lowest_c), highest_c), estimate.soc,
        estimate.under_way_k)


def believed_share(heater: HeaterReport) -> float:
    """Return what the heater gives of its power, 0 ... 1, for planning what is commanded."""
    return heater.share if heater.heater is Heater.DERATED else 1.0


class ForecastPlanner:
    """Makes Outlooks for one vehicle; keeps the corrected vehicle while it holds."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Take the vehicle as its file describes it."""
        self._vehicle = vehicle
        # Logarithms of the factors that are corrected for, and the factors; none at first.
        self._logs: list[float] = []
        self._factors: tuple[float, ...] = ()
        self._corrected = vehicle
        self._forecast: Forecast | None = None

    def limit_to(self, vehicle: Vehicle) -> None:
        """Take the same vehicle with other power limits."""
        self._vehicle, self._logs = vehicle, []

    def forget_deviation(self) -> None:
        """Forget how sure the arrival was: the route has changed."""
        self._forecast = None

    def vehicle(self, estimate: Estimate) -> Vehicle:
        """Return the corrected vehicle of an Estimate; the same one while the factors stay."""
        logs = estimate.mean[FACTORS.start:PROPULSION].tolist()
        if not self._logs or any(abs(log - before) > step for log, before, step in zip(
                logs, self._logs, FACTOR_STEPS)):
            self._logs, self._factors = logs, tuple(array_exp(logs).tolist())
            self._corrected = corrected_vehicle(self._vehicle, Corrections(*self._factors))
        return self._corrected

    def make(self, estimate: Estimate, route: Route, goal: Goal, settings: Settings,
             is_heating: bool, starts_in_s: float, heated_s: float,
             preparation_goal: PreparationGoal | None = None) -> ForecastPlan:
        """
        Return the Outlook for a route from the estimate's instant on.

        The sentences count from now; the route starts in `starts_in_s` [s], and the battery has been
        heated for `heated_s` [s]. `preparation_goal` is what the route was made for, None where it is a route
        plan's. Raises what plan_preheating raises.
        """
        vehicle, heater = fed(self.vehicle(estimate), preparation_goal), estimate.heater
        state, share = believed_state(vehicle, estimate), believed_share(heater)
        # Heat that would be late for the end of the route: a heat path knows it by itself.
        lag_s = estimate.heat_lag_s if vehicle.heat_path.is_direct else 0.0
        route = route.with_propulsion(estimate.propulsion_factor)
        full_power = (FullPower(vehicle, route, state, share, lag_s)
                      if preparation_goal is not None and preparation_goal.is_soonest else None)

        def plan(heat_lag_s: float = lag_s, **heater_as: Any) -> Plan:
            return plan_preheating(
                vehicle, route, state, goal, settings.method,
                # As soon as possible is not too short, and never too late.
                self._uncertainty_margin(vehicle, estimate, settings, is_heating or full_power is not None),
                heat_lag_s=heat_lag_s, **heater_as)

        def forecast(of: Plan) -> Forecast:
            # Only a trip whose long segments were divided has other steps than its route.
            has_its_steps = len(of.hvch_battery_power_w) == len(route)
            return Forecast(
                DrivenRoute(vehicle, route) if has_its_steps else make_trip(vehicle, route, share),
                of, estimate)

        def plan_on(part: Route) -> Plan:
            nonlocal route
            route = part
            return plan(heater_share=share)

        def plan_wanted() -> Plan:
            if full_power is None:
                return plan(heater_share=share)
            return full_power.plan(vehicle, goal, plan_on)

        wanted = plan_wanted()
        if self._forecast is None:
            # The lead needs to know how sure the arrival is, and that needs a plan.
            self._forecast = forecast(wanted)
            wanted = plan_wanted()
        # A heater that does not obey is commanded as if it did, and something else is expected.
        expected, commanded = wanted, None
        unheated = UNHEATED.get(heater.heater, {})
        if heater.heater is Heater.DEAD:
            expected, commanded = plan(heater_share=0.0), wanted
        elif heater.heater is Heater.STUCK_ON:
            expected = plan(heats_throughout=True)
        elif wanted.status is Status.TARGET_UNREACHABLE and lag_s > 0.0:
            # Then some of the heat that is mostly late is better than none.
            commanded = plan(heat_lag_s=0.0, heater_share=share)
            if commanded.heating_start_s is not None:
                unheated = LATE
        self._forecast = forecast(expected)
        expected = accounted(expected.told(_status_now(expected, starts_in_s), partial(
            _in_words, heater=heater, forecast=self._forecast, **unheated,
            reserve=reserve_soc(vehicle, goal), starts_in_s=starts_in_s, heated_s=heated_s)),
            preparation_goal, estimate.soc)
        return ForecastPlan(
            expected, self._forecast, commanded, share, self._model_factors(estimate))

    def _model_factors(self, estimate: Estimate) -> tuple[float, ...]:
        """Factors of the corrected car; () where a heater that does not obey is beyond them."""
        if estimate.heater.heater is not Heater.ANSWERS:
            return ()
        return (*self._factors, estimate.propulsion_factor)

    def _uncertainty_margin(self, vehicle: Vehicle, estimate: Estimate, settings: Settings,
                 is_heating: bool) -> UncertaintyMargin:
        lead_k = 0.0 if self._forecast is None else LEAD_DEVIATIONS * self._forecast.as_planned_k
        # What may come later than believed is begun with earlier.
        lead_k += estimate.later_heat_s(LATER_DEVIATIONS) * (
            vehicle.hvch.efficiency * vehicle.hvch.maximum_power_w
            / vehicle.battery.heat_capacity_j_per_k)
        return UncertaintyMargin(
            margin_k=min(MARGIN_DEVIATIONS * estimate.settled_deviation_k, MOST_MARGIN_K),
            lead_k=min(lead_k, MOST_LEAD_K) if math.isfinite(lead_k) else MOST_LEAD_K,
            is_heating=is_heating,
            least_pause_s=max(settings.minimum_off_time_s, LEAST_PAUSE_S),
            least_heating_s=max(settings.minimum_on_time_s, LEAST_HEATING_S))


def _in_words(plan: Plan, heater: HeaterReport, forecast: Forecast, **told: Any) -> str:
    """
    Return a plan's sentence with what the heater does, and what is uncertain.

    `told` is what planning.explanation.explain needs in any case.
    """
    sentence = SENTENCES.get(heater.heater, '').format(share=100.0 * heater.share)
    sentence += explain(plan, **told)
    if plan.heating_end_s is not None and plan.heat is None:
        sentence += (f' Uncertainty +-{forecast.deviation_k:.1f} K (1 sigma): heating starts early and stops '
                     'once the target is certain.')
    return sentence
