# SPDX-License-Identifier: Apache-2.0
"""
The cost of a kelvin on arrival, for each step that could be heated.

The adjoint of the model along a run, backward from arrival: by how much a watt of the heater in a step makes the
battery arrive warmer, and emptier. Usually a kelvin is cheaper the later it is heated, because less leaks. But at
high currents, more of the heating power becomes Joule heat in the cells, all of which is heat: with
a heater that turns only half of its power into heat, heating is cheaper then.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.native import plans as native_plans
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.vehicle.heat_balance import heat_under_w
from bev_preheat.vehicle.model import make_rates

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip

# Differences for the slopes of the model's rates.
SOC_DIFFERENCE = 1e-4
TEMPERATURE_DIFFERENCE_K = 0.1
# Units of worth on arrival.
CHARGE, WARMTH = (1.0, 0.0), (0.0, 1.0)
# Charge and warmth: the change of each over a step, or its worth after a step.
ChargeWarmth = tuple[float, float]
# `rates_at(heater_w, brake_w, fuller, warmer_k)` -> rates of charge and temperature in each step (2, N).
RatesAlong = Callable[..., 'FloatArray']


class HeatPrices(NamedTuple):
    """
    Effect of a watt of the heater in each step until arrival, two arrays (N,).

    `warmth_k_per_w`: rise of the arrival temperature; `charge_per_w`: loss of charge on arrival, as a share of the
    whole. Means between no heating and full heating, because a step is heated or not. Both are 0 in steps in which
    the cabin leaves no power.
    """

    warmth_k_per_w: FloatArray
    charge_per_w: FloatArray

    def cheapest_first(self) -> IntArray:
        """Return the steps in which heating warms, in the order of charge per kelvin, cheapest first."""
        steps = np.flatnonzero(self.warmth_k_per_w > 0.0)
        per_k = self.charge_per_w[steps] / self.warmth_k_per_w[steps]
        # At the same cost, the later one first.
        return steps[np.lexsort((-steps, per_k))]


@dataclass(frozen=True)
class Slopes:
    """
    Charge and warmth gained until the end of each step, N pairs each.

    Per unit of charge at its start, per kelvin, and per watt of the heater; the latter is the mean between no
    heating and full heating.
    """

    by_charge: list[ChargeWarmth]
    by_warmth: list[ChargeWarmth]
    by_power: list[ChargeWarmth]

    def effect_until(self, instant: int, worth: ChargeWarmth) -> FloatArray:
        """
        Return the effect of a watt of the heater in each step (N,) until an instant.

        `worth` is the worth of charge and warmth at that instant. Accurate to second order in the step.
        """
        per_w = np.zeros(len(self.by_power))
        for k in range(instant - 1, -1, -1):
            earlier = _before(worth, (self.by_charge[k], self.by_warmth[k]))
            middle = 0.5 * (worth[0] + earlier[0]), 0.5 * (worth[1] + earlier[1])
            per_w[k] = middle[0] * self.by_power[k][0] + middle[1] * self.by_power[k][1]
            worth = self.with_limits(k, earlier, middle)
        return per_w

    def with_limits(self, k: int, earlier: ChargeWarmth, middle: ChargeWarmth) -> ChargeWarmth:
        """Return the worth of charge and warmth before step k, from their worth without limits."""
        return earlier


def find_prices(trip: Trip, schedule: Schedule) -> HeatPrices:
    """
    Return the HeatPrices along the run of a Schedule, ignoring limits, for a vehicle without a heat path.

    They give the order in which to heat, not its cost.
    """
    vehicle = native_vehicle(trip.vehicle)
    found = None if vehicle is None else native_plans.find_prices(
        vehicle, trip.native, schedule.soc, schedule.temperature_c, schedule.heater_power_w)
    if found is not None:
        return HeatPrices(*found)
    slopes = Slopes(*(slope.T.tolist() for slope in model_slopes(
        trip, rates_along(trip, schedule), schedule.heater_power_w, np.zeros(len(trip.route)))))
    steps = len(trip.route)
    return HeatPrices(slopes.effect_until(steps, WARMTH), -slopes.effect_until(steps, CHARGE))


def rates_along(trip: Trip, schedule: Schedule) -> RatesAlong:
    """Return the model's rates in the middle of each step of a run, as a function of heater and brake [W]."""
    _, power_w, variance_w2, heat_w, leakage_w_per_k = trip.inputs()
    soc, temperature_c = (0.5 * (values[:-1] + values[1:])
                          for values in (schedule.soc, schedule.temperature_c))
    rates = make_rates(trip.vehicle, ARRAYS)

    def rates_at(heater_w: FloatArray, brake_w: FloatArray, fuller: float = 0.0,
                 warmer_k: float = 0.0) -> FloatArray:
        return np.array(rates(
            soc + fuller, temperature_c + warmer_k, power_w + heater_w + brake_w, variance_w2,
            heat_under_w(trip.vehicle, heat_w, heater_w, brake_w), leakage_w_per_k)[:2])

    return rates_at


def model_slopes(trip: Trip, rates_at: RatesAlong, heater_w: FloatArray,
                 brake_w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Slopes as arrays (2, N), for steps whose heater and brake [W] do not depend on the state."""
    limit_w, nothing_w = trip.heater_limit_w, np.zeros(len(trip.route))
    here = rates_at(heater_w, brake_w)
    by_charge, by_warmth, by_power = (
        (there - before) / difference * trip.route.duration_s for there, before, difference in (
            (rates_at(heater_w, brake_w, fuller=SOC_DIFFERENCE), here, SOC_DIFFERENCE),
            (rates_at(heater_w, brake_w, warmer_k=TEMPERATURE_DIFFERENCE_K), here,
             TEMPERATURE_DIFFERENCE_K),
            (rates_at(limit_w, nothing_w), rates_at(nothing_w, nothing_w),
             np.where(limit_w > 0.0, limit_w, 1.0))))
    return by_charge, by_warmth, by_power


def _before(worth: ChargeWarmth, slopes: tuple[ChargeWarmth, ChargeWarmth]) -> ChargeWarmth:
    """Return the worth of charge and warmth before a step, from their worth after it."""
    first = tuple(worth[0] * slope[0] + worth[1] * slope[1] for slope in slopes)
    second = tuple(first[0] * slope[0] + first[1] * slope[1] for slope in slopes)
    return worth[0] + first[0] + 0.5 * second[0], worth[1] + first[1] + 0.5 * second[1]
