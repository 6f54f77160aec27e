# SPDX-License-Identifier: Apache-2.0
"""
Plans with one interval of heating, made without limits and checked afterwards: the Python engine.

Off, one partial step, then full power, arriving exactly at the target: among all such schedules, the one whose
forward run arrives at the target, computed with the NLP's own integrator, is the NLP's optimum if no limit but
the heater's is active (docs/explanation/planning.md). The first guess is the paper's crossing (found with a
second-order step, and with the state of charge after heating); a few forward runs of the heated part refine it.
Usually a kelvin is cheaper the later it is heated, because less leaks. But at high currents, more of the heating
power becomes Joule heat in the cells, all of which is heat: with a heater that turns only half of its power into
heat, heating is cheaper then. The prices of heat in each step show it: the adjoint of the model along a run,
backward from arrival, says by how much a watt of the heater in a step makes the battery arrive warmer, and
emptier.
"""
from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import ARRAYS, FloatArray, FLOATS, JOULES_PER_WH, SATURATING_FLOATS
from bev_preheat.planning.bracketing import follow_slope, Trial
from bev_preheat.planning.dynamics import is_described, keeps_limits, limits_of_steps_w, run_forward, run_on
from bev_preheat.planning.heat_run import initial_states, run_heated
from bev_preheat.planning.paper import find_crossing, run_paper
from bev_preheat.planning.schedule import maximum_from, Schedule, ScheduleOutcome
from bev_preheat.planning.two_switches import find_two_switches
from bev_preheat.tunables import (
    ARRIVAL_TOLERANCE_K,
    HEATING_ALLOWANCE,
    LEAST_SAVING_WH,
    SOC_DIFFERENCE,
    TEMPERATURE_DIFFERENCE_K,
)
from bev_preheat.vehicle.model import heat_with_heater_w, make_midpoint, make_rates, make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip

# Charge and warmth: the change of each over a step, or its worth after a step.
ChargeWarmth = tuple[float, float]
# Units of worth on arrival.
CHARGE, WARMTH = (1.0, 0.0), (0.0, 1.0)


class _Slopes(NamedTuple):
    """Charge and warmth gained in each step (N pairs) per charge, kelvin and watt; a mean of no and full heat."""

    by_charge: list[ChargeWarmth]
    by_warmth: list[ChargeWarmth]
    by_power: list[ChargeWarmth]

    def effect_on_arrival(self, worth: ChargeWarmth) -> FloatArray:
        """Return the effect of a watt in each step (N,) by the worth on arrival, to second order in the step."""
        per_w = np.zeros(len(self.by_power))
        for k in range(len(per_w) - 1, -1, -1):
            earlier = _before(worth, (self.by_charge[k], self.by_warmth[k]))
            middle = 0.5 * (worth[0] + earlier[0]), 0.5 * (worth[1] + earlier[1])
            per_w[k] = middle[0] * self.by_power[k][0] + middle[1] * self.by_power[k][1]
            worth = earlier
        return per_w


def find_prices(trip: Trip, schedule: Schedule) -> tuple[FloatArray, FloatArray]:
    """
    Return the effects on arrival of a watt of the heater in each step (N,): more warmth [K/W], lost charge [1/W].

    Along a Schedule's run, ignoring limits: the order in which to heat, not its cost. Means between no heating and
    full heating, because a step is heated or not; 0 in steps in which the cabin leaves no power.
    """
    slopes = _model_slopes(trip, schedule)
    return slopes.effect_on_arrival(WARMTH), -slopes.effect_on_arrival(CHARGE)


def is_cheaper_elsewhere(trip: Trip, schedule: Schedule) -> bool:
    """
    Return whether heating in other steps than a Schedule's may save LEAST_SAVING_WH, ignoring limits.

    By an upper bound, as far as the prices do not change: each cheaper step is compared with the dearest step that
    is heated after it.
    """
    dearest_per_k, saving = -math.inf, 0.0
    columns = zip(*(column.tolist()[::-1] for column in (
        *find_prices(trip, schedule), schedule.heater_power_w, trip.heater_limit_w)))
    for warmth_k_per_w, charge_per_w, heater_w, limit_w in columns:
        if warmth_k_per_w > 0.0:
            per_k = charge_per_w / warmth_k_per_w
            if limit_w > heater_w and per_k < dearest_per_k:
                saving += (dearest_per_k - per_k) * warmth_k_per_w * (limit_w - heater_w)
            if heater_w > 0.0:
                dearest_per_k = max(dearest_per_k, per_k)
    battery = trip.vehicle.battery
    whole_wh = battery.capacity_as * battery.open_circuit_voltage.function(FLOATS)(
        float(schedule.soc[-1]), float(schedule.temperature_c[-1])) / JOULES_PER_WH
    return saving >= LEAST_SAVING_WH / whole_wh


def _model_slopes(trip: Trip, schedule: Schedule) -> _Slopes:
    """Return the _Slopes in the middle of each step of a run, ignoring limits."""
    _, power_w, variance_w2, heat_w, leakage_w_per_k = trip.inputs()
    soc, temperature_c = (0.5 * (values[:-1] + values[1:])
                          for values in (schedule.soc, schedule.temperature_c))
    rates: Callable[..., tuple[FloatArray, ...]] = make_rates(trip.vehicle, ARRAYS)

    def rates_at(heater_w: FloatArray | float, fuller: float = 0.0, warmer_k: float = 0.0) -> FloatArray:
        return np.array(rates(
            soc + fuller, temperature_c + warmer_k, power_w + heater_w, variance_w2,
            heat_with_heater_w(trip.vehicle, heat_w, heater_w), leakage_w_per_k)[:2])

    here, limit_w = rates_at(schedule.heater_power_w), trip.heater_limit_w
    return _Slopes(*(
        [*map(tuple, ((there - before) / difference * trip.route.duration_s).T.tolist())]
        for there, before, difference in (
            (rates_at(schedule.heater_power_w, fuller=SOC_DIFFERENCE), here, SOC_DIFFERENCE),
            (rates_at(schedule.heater_power_w, warmer_k=TEMPERATURE_DIFFERENCE_K), here, TEMPERATURE_DIFFERENCE_K),
            (rates_at(limit_w), rates_at(0.0), np.where(limit_w > 0.0, limit_w, 1.0)))))


def _before(worth: ChargeWarmth, slopes: tuple[ChargeWarmth, ChargeWarmth]) -> ChargeWarmth:
    """Return the worth of charge and warmth before a step, from their worth after it."""
    first = tuple(worth[0] * slope[0] + worth[1] * slope[1] for slope in slopes)
    second = tuple(first[0] * slope[0] + first[1] * slope[1] for slope in slopes)
    return worth[0] + first[0] + 0.5 * second[0], worth[1] + first[1] + 0.5 * second[1]


def find_switch(trip: Trip, target_c: float, unheated: Schedule) -> Schedule:
    """Return the Schedule switched on once to arrive at a target [deg C], or at once if that is not enough."""
    if unheated.temperature_c[-1] >= target_c:
        return unheated

    def switched_on_at(instant_s: float) -> Trial[Schedule]:
        heater_power_w = maximum_from(trip, instant_s)
        soc, temperature_c = run_on(trip, make_runge_kutta_4, unheated.soc, unheated.temperature_c,
                                    trip.step_at(instant_s), heater_power_w)
        return Trial(instant_s, float(temperature_c[-1]) - target_c, Schedule(
            instant_s, heater_power_w, unheated.brake_power_w, soc, temperature_c, make_runge_kutta_4))

    # The earlier the heater starts, the warmer the battery arrives.
    earliest_s, latest_s = 0.0, float(trip.time_s[-1])
    guess_s = find_crossing(trip, target_c, _terminal_soc(trip, unheated, target_c), unheated.temperature_c,
                            make_midpoint)
    first = switched_on_at(min(max(guess_s or 0.0, earliest_s), latest_s))
    return follow_slope(
        earliest_s, latest_s, first, _arrival_slope_k_per_s(trip, first.outcome, first.value),
        switched_on_at, ARRIVAL_TOLERANCE_K).outcome


def _terminal_soc(trip: Trip, unheated: Schedule, target_c: float) -> float:
    """Return the approximate state of charge on arrival: that of the unheated run less the charge for heating."""
    battery = trip.vehicle.battery
    idle_soc, idle_c = float(unheated.soc[-1]), float(unheated.temperature_c[-1])
    heating_j = (HEATING_ALLOWANCE * battery.heat_capacity_j_per_k * (target_c - idle_c)
                 / trip.vehicle.hvch.efficiency)
    voltage_v = battery.open_circuit_voltage.function(SATURATING_FLOATS)(idle_soc, idle_c)
    return max(idle_soc - heating_j / (voltage_v * battery.capacity_as), 0.0)


def _arrival_slope_k_per_s(trip: Trip, schedule: Schedule, instant_s: float) -> float:
    """
    Return the estimated change of the arrival temperature with the Schedule's switching instant [K/s].

    The heater's contribution to the rate of change at the switching instant, less the part that leaks until
    arrival, or that a warmer battery saves in Joule heat.
    """
    first = trip.step_at(instant_s)
    rates = make_rates(trip.vehicle, SATURATING_FLOATS)
    soc, temperature_c = schedule.soc, schedule.temperature_c

    def rate(step: int, warmer_k: float, heater_w: float) -> float:
        return rates(
            soc[step], temperature_c[step] + warmer_k, trip.idle_power_w[step] + heater_w,
            trip.power_variance_w2[step],
            heat_with_heater_w(trip.vehicle, trip.idle_heat_w[step], heater_w),
            trip.leakage_w_per_k[step])[1]

    gained_k_per_s = rate(first, 0.0, trip.heater_limit_w[first]) - rate(first, 0.0, 0.0)
    middle = (first + len(trip.route)) // 2
    full_w = trip.heater_limit_w[middle]
    damping_per_s = rate(middle, 0.0, full_w) - rate(middle, 1.0, full_w)
    return float(-gained_k_per_s * math.exp(
        -damping_per_s * (float(trip.time_s[-1]) - instant_s)))


class SwitchPlan(NamedTuple):
    """
    The Schedule without heating and the one with one heating interval, both without regard to limits.

    `unheated_keeps_limits` and `keeps_limits`: whether they keep all limits of the battery; `costs_least`: heating
    in other steps cannot cost less. If the plan keeps the limits and costs least, `least_soc` is its least charge,
    and an engine may also give its `outcome`.
    """

    unheated: Schedule
    schedule: Schedule
    unheated_keeps_limits: bool
    keeps_limits: bool
    costs_least: bool
    least_soc: float
    outcome: ScheduleOutcome | None = None


def run_without_heating(trip: Trip, state: BatteryState) -> Schedule:
    """Return the Schedule that never heats, ignoring limits."""
    idle_w = np.zeros(len(trip.route))
    if not trip.vehicle.heat_path.is_direct:
        return run_heated(trip, initial_states(state), idle_w, None)
    soc, temperature_c = run_forward(trip, make_runge_kutta_4, state.soc, state.temperature_c)
    return Schedule(None, idle_w, idle_w, soc, temperature_c, make_runge_kutta_4)


def plan_switch(trip: Trip, state: BatteryState, target_c: float, in_one_interval: bool = False) -> SwitchPlan:
    """
    Return the SwitchPlan that arrives at the target [deg C]: switched on once and, with a heat path, off early.

    Unless it is to be `in_one_interval` in any case, it is compared with heating in other steps.
    """
    unheated = run_without_heating(trip, state)
    is_direct = trip.vehicle.heat_path.is_direct
    schedule = (find_switch if is_direct else find_two_switches)(trip, target_c, unheated)
    kept = keeps_limits(trip, schedule)
    return SwitchPlan(
        unheated, schedule,
        kept if schedule is unheated else keeps_limits(trip, unheated), kept,
        in_one_interval or not is_direct or not kept or not is_cheaper_elsewhere(trip, schedule),
        float(schedule.soc.min()))


def plan_by_paper(trip: Trip, state: BatteryState, target_c: float) -> SwitchPlan:
    """Return the SwitchPlan of the paper's heuristic; it keeps limits if `is_driven_as_planned`."""
    unheated, schedule = run_without_heating(trip, state), run_paper(trip, state, target_c)
    return SwitchPlan(unheated, schedule, keeps_limits(trip, unheated),
                      is_driven_as_planned(trip, schedule), True, float(schedule.soc.min()))


def is_driven_as_planned(trip: Trip, schedule: Schedule) -> bool:
    """Return whether a run has no power deficit and is described."""
    _, most_w = limits_of_steps_w(trip.vehicle, schedule.soc, schedule.temperature_c, trip.power_variance_w2)
    return bool((trip.idle_power_w + schedule.drawn_power_w <= most_w).all()) and is_described(trip, schedule)
