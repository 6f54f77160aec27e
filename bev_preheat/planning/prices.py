# SPDX-License-Identifier: Apache-2.0
"""
What a kelvin on arrival costs, for each step in which it could be heated for.

The adjoint of the model along a run, backward from arrival: by how much a watt of the heater in a step
makes the battery arrive warmer, and emptier. As a rule a kelvin is the cheaper the later it is heated for,
because less of it leaks. But where much current flows, more of what heating takes becomes Joule heat in
the cells, and that is all heat: a heater that gives half of what it takes is cheaper then.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.compiled import plans as compiled_plans
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.dynamics import compiled_vehicle
from bev_preheat.vehicle.model import make_rates

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip

# Slopes of the model's rates are taken over these differences.
SOC_DIFFERENCE = 1e-4
TEMPERATURE_DIFFERENCE_K = 0.1


@dataclass(frozen=True)
class Prices:
    """
    What a watt of the heater in each step does until arrival, two arrays (N,).

    `warmth_k_per_w`: by how much the battery arrives warmer; `charge_per_w`: by how much less charge it
    has then, as a share of the whole. The mean from no heating to all that the cabin leaves: a step is
    heated or not. Both are 0 in steps in which the cabin leaves nothing.
    """

    warmth_k_per_w: FloatArray
    charge_per_w: FloatArray

    def cheapest_first(self) -> IntArray:
        """Return the steps in which heating warms, those first in which a kelvin takes the least charge."""
        steps = np.flatnonzero(self.warmth_k_per_w > 0.0)
        per_k = self.charge_per_w[steps] / self.warmth_k_per_w[steps]
        # Of those that cost the same the later one.
        return steps[np.lexsort((-steps, per_k))]


def find_prices(trip: Trip, schedule: Schedule) -> Prices:
    """
    Return the Prices along the run of a Schedule, limits left aside, of a vehicle without a heat path.

    To the second order of a step: they say in which order to heat, not what that costs.
    """
    vehicle = compiled_vehicle(trip.vehicle)
    found = None if vehicle is None else compiled_plans.find_prices(
        vehicle, trip.compiled, schedule.soc, schedule.temperature_c, schedule.heater_power_w)
    if found is not None:
        return Prices(*found)
    duration_s, power_w, variance_w2, heat_w, leakage_w_per_k = trip.inputs()
    heater_w, limit_w = schedule.heater_power_w, trip.heater_limit_w
    soc, temperature_c = (0.5 * (values[:-1] + values[1:])
                          for values in (schedule.soc, schedule.temperature_c))
    rates = make_rates(trip.vehicle, ARRAYS)

    def rates_at(heated_w: FloatArray, fuller: float = 0.0, warmer_k: float = 0.0) -> FloatArray:
        return np.array(rates(
            soc + fuller, temperature_c + warmer_k, power_w + heated_w, variance_w2,
            heat_w + trip.vehicle.hvch.efficiency * heated_w, leakage_w_per_k)[:2])

    here = rates_at(heater_w)
    by_charge, by_warmth, by_power = (
        ((there - before) / difference * duration_s).T.tolist() for there, before, difference in (
            (rates_at(heater_w, fuller=SOC_DIFFERENCE), here, SOC_DIFFERENCE),
            (rates_at(heater_w, warmer_k=TEMPERATURE_DIFFERENCE_K), here, TEMPERATURE_DIFFERENCE_K),
            (rates_at(limit_w), rates_at(np.zeros(len(limit_w))), np.where(limit_w > 0.0, limit_w, 1.0))))
    # What charge and warmth after a step are worth on arrival, in warmth and in charge.
    warmth, charge = (0.0, 1.0), (1.0, 0.0)
    per_w = np.empty((2, len(duration_s)))
    for k in range(len(duration_s) - 1, -1, -1):
        slopes = by_charge[k], by_warmth[k]
        for row, worth in enumerate((warmth, charge)):
            changed = _before(worth, slopes)
            middle = 0.5 * (worth[0] + changed[0]), 0.5 * (worth[1] + changed[1])
            per_w[row, k] = middle[0] * by_power[k][0] + middle[1] * by_power[k][1]
        warmth, charge = _before(warmth, slopes), _before(charge, slopes)
    return Prices(per_w[0], -per_w[1])


def _before(worth: tuple[float, float],
            slopes: tuple[list[float], list[float]]) -> tuple[float, float]:
    """Return what charge and warmth before a step are worth, from what they are after it."""
    first = tuple(worth[0] * slope[0] + worth[1] * slope[1] for slope in slopes)
    second = tuple(first[0] * slope[0] + first[1] * slope[1] for slope in slopes)
    return worth[0] + first[0] + 0.5 * second[0], worth[1] + first[1] + 0.5 * second[1]
