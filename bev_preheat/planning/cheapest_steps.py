# SPDX-License-Identifier: Apache-2.0
"""
Without an active limit: heat in the steps in which a kelvin on arrival costs the least.

Usually those are the last steps, and the plan is that of `optimal_switch`. If they are not (see `prices`), steps
are filled in the order of their prices until the battery arrives at the target, and priced again along the
resulting run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import plans as native_plans
from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.bracketing import ARRIVAL_TOLERANCE_K, follow_slope, Trial
from bev_preheat.planning.dynamics import JOULES_PER_WH, native_vehicle, run_forward
from bev_preheat.planning.prices import find_prices, HeatPrices
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.trip import Trip

# For less [Wh], no extra switching of the heater.
LEAST_SAVING_WH = 0.05
LEAST_SAVING_THEN_WH = 0.005
# The first order saves the most, the second the rest.
MOST_ORDERS = 4


def heat_cheapest(trip: Trip, schedule: Schedule, target_c: float) -> Schedule:
    """
    Return the Schedule that arrives at the target for the least charge, ignoring limits.

    `schedule` arrives at the target [deg C], with a vehicle without a heat path. It is returned unchanged if no
    other saves LEAST_SAVING_WH.
    """
    vehicle = native_vehicle(trip.vehicle)
    found = None if vehicle is None else native_plans.heat_cheapest(
        vehicle, trip.native, target_c, schedule.soc, schedule.temperature_c, schedule.heater_power_w)
    if found is not None:
        return _schedule(trip, *found[0]) if found[0] else schedule
    # Once the extra switching is accepted, further savings are taken as well.
    for least_saving_wh in (LEAST_SAVING_WH, *(MOST_ORDERS - 1) * (LEAST_SAVING_THEN_WH,)):
        prices = find_prices(trip, schedule)
        order = prices.cheapest_first()
        cheapest_w, saving = _first_guess(trip, schedule.heater_power_w, prices, order)
        if not saving >= least_saving_wh / whole_charge_wh(trip, schedule):
            break
        guess_j = sum_in_turn((cheapest_w * trip.route.duration_s)[order])
        filled = _filled(trip, schedule, target_c, order, prices, guess_j)
        if not filled.soc[-1] > schedule.soc[-1]:
            break
        schedule = filled
    return schedule


def whole_charge_wh(trip: Trip, schedule: Schedule) -> float:
    """Return the energy of the whole charge [Wh] at the voltage on arrival."""
    battery = trip.vehicle.battery
    return battery.capacity_as * battery.open_circuit_voltage.function(FLOATS)(
        float(schedule.soc[-1]), float(schedule.temperature_c[-1])) / JOULES_PER_WH


def _first_guess(trip: Trip, heater_power_w: FloatArray, prices: HeatPrices,
                 order: IntArray) -> tuple[FloatArray, float]:
    """
    Return the heater powers [W] that give the same warmth in steps of an order, and the charge they save.

    Valid as far as the prices stay the same.
    """
    limit_w, warmth_k_per_w = trip.heater_limit_w[order], prices.warmth_k_per_w[order]
    cheapest_w = np.zeros(len(heater_power_w))
    cheapest_w[order] = limit_w * _shares(
        limit_w * warmth_k_per_w, sum_in_turn(heater_power_w[order] * warmth_k_per_w))
    spent, cheapest = (sum_in_turn((power_w * prices.charge_per_w)[order])
                       for power_w in (heater_power_w, cheapest_w))
    return cheapest_w, spent - cheapest


def sum_in_turn(values: FloatArray) -> float:
    """Return the sum of values, added sequentially as in the core; 0 without values."""
    return float(np.cumsum(values)[-1]) if len(values) else 0.0


def _shares(most: FloatArray, wanted: float) -> FloatArray:
    """Return the share of each to take, in order, until the sum is as wanted."""
    before = np.concatenate(([0.0], np.cumsum(most)[:-1]))
    return np.minimum(np.maximum((wanted - before) / most, 0.0), 1.0)


def _filled(trip: Trip, schedule: Schedule, target_c: float, order: IntArray, prices: HeatPrices,
            guess_j: float) -> Schedule:
    """Return the Schedule that heats in steps of an order until the battery arrives at the target."""
    start = float(schedule.soc[0]), float(schedule.temperature_c[0])
    limit_w = trip.heater_limit_w[order]
    most_j = limit_w * trip.route.duration_s[order]

    def heated_with(heat_j: float) -> Trial[Schedule]:
        heater_power_w = np.zeros(len(trip.route))
        heater_power_w[order] = limit_w * _shares(most_j, heat_j)
        run = run_forward(trip, make_runge_kutta_4, *start, heater_power_w)
        return Trial(heat_j, float(run[1][-1]) - target_c, _schedule(trip, *run, heater_power_w))

    whole_j = sum_in_turn(most_j)
    first = heated_with(min(guess_j, whole_j))
    # The last heated step determines how much warmer one more joule makes the battery.
    last = order[np.flatnonzero(first.outcome.heater_power_w[order])[-1]]
    return follow_slope(
        whole_j, 0.0, first, float(prices.warmth_k_per_w[last] / trip.route.duration_s[last]), heated_with,
        ARRIVAL_TOLERANCE_K).outcome


def _schedule(trip: Trip, soc: FloatArray, temperature_c: FloatArray,
              heater_power_w: FloatArray) -> Schedule:
    return Schedule(switched_on_s(trip, heater_power_w), heater_power_w, np.zeros(len(heater_power_w)),
                    soc, temperature_c, make_runge_kutta_4)
