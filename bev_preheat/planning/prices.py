# SPDX-License-Identifier: Apache-2.0
"""
The cost of a kelvin on arrival, for each step that could be heated.

The adjoint of the model along a run, backward from arrival: by how much a watt of the heater in a step makes the
battery arrive warmer, and emptier. Usually a kelvin is cheaper the later it is heated, because less leaks. But at
high currents, more of the heating power becomes Joule heat in the cells, all of which is heat: with
a heater that turns only half of its power into heat, heating is cheaper then.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import ARRAYS, FLOATS
from bev_preheat.numerics.factors import JOULES_PER_WH
from bev_preheat.tunables import LEAST_SAVING_WH, SOC_DIFFERENCE, TEMPERATURE_DIFFERENCE_K
from bev_preheat.vehicle.model import heat_with_heater_w, make_rates

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip

# Charge and warmth: the change of each over a step, or its worth after a step.
ChargeWarmth = tuple[float, float]
# Units of worth on arrival.
CHARGE, WARMTH = (1.0, 0.0), (0.0, 1.0)


class HeatPrices(NamedTuple):
    """
    Effect of a watt of the heater in each step until arrival, two arrays (N,).

    `warmth_k_per_w`: rise of the arrival temperature; `charge_per_w`: loss of charge on arrival, as a share of the
    whole. Means between no heating and full heating, because a step is heated or not. Both are 0 in steps in which
    the cabin leaves no power.
    """

    warmth_k_per_w: FloatArray
    charge_per_w: FloatArray


class _Slopes(NamedTuple):
    """
    Charge and warmth gained until the end of each step, N pairs each.

    Per unit of charge at its start, per kelvin, and per watt of the heater; the latter is the mean between no
    heating and full heating.
    """

    by_charge: list[ChargeWarmth]
    by_warmth: list[ChargeWarmth]
    by_power: list[ChargeWarmth]

    def effect_on_arrival(self, worth: ChargeWarmth) -> FloatArray:
        """
        Return the effect of a watt of the heater in each step (N,) on arrival.

        `worth` is the worth of charge and warmth on arrival. Accurate to second order in the step.
        """
        per_w = np.zeros(len(self.by_power))
        for k in range(len(per_w) - 1, -1, -1):
            earlier = _before(worth, (self.by_charge[k], self.by_warmth[k]))
            middle = 0.5 * (worth[0] + earlier[0]), 0.5 * (worth[1] + earlier[1])
            per_w[k] = middle[0] * self.by_power[k][0] + middle[1] * self.by_power[k][1]
            worth = earlier
        return per_w


def find_prices(trip: Trip, schedule: Schedule) -> HeatPrices:
    """
    Return the HeatPrices along the run of a Schedule, ignoring limits, for a vehicle without a heat path.

    They give the order in which to heat, not its cost.
    """
    slopes = _model_slopes(trip, schedule)
    return HeatPrices(slopes.effect_on_arrival(WARMTH), -slopes.effect_on_arrival(CHARGE))


def is_cheaper_elsewhere(trip: Trip, schedule: Schedule) -> bool:
    """
    Return whether heating in other steps than a Schedule's may save LEAST_SAVING_WH, ignoring limits.

    By an upper bound, as far as the prices do not change: each cheaper step is compared with the dearest step that
    is heated after it.
    """
    prices = find_prices(trip, schedule)
    dearest_per_k, saving = -math.inf, 0.0
    columns = zip(prices.warmth_k_per_w.tolist(), prices.charge_per_w.tolist(), schedule.heater_power_w.tolist(),
                  trip.heater_limit_w.tolist())
    for warmth_k_per_w, charge_per_w, heater_w, limit_w in reversed(list(columns)):
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
