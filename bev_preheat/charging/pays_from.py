# SPDX-License-Identifier: Apache-2.0
"""Value of time and probability of charging from which heating pays, and the energy price up to which it does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.numerics.factors import S_PER_H, WH_PER_KWH

if TYPE_CHECKING:
    from bev_preheat.charging.target_worth import TargetWorth

# A saving of less than this [s] is rounding.
LEAST_SAVED_S = 0.1


def pays_from_per_h(item: TargetWorth, without: TargetWorth, price_per_kwh: float, probability: float = 1.0,
                    lost: float = 0.0) -> float:
    """
    Return the value of time [per h] from which on a target costs less than no heating, or infinity.

    The vehicle charges with a `probability` (above 0 ... 1); otherwise heat is lost at a cost of `lost`.
    """
    if math.isinf(item.charging_time_s):
        return math.inf
    if math.isinf(without.charging_time_s):
        return 0.0
    more = price_per_kwh * (item.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH
    saved_h = (without.charging_time_s - item.charging_time_s) / S_PER_H
    if saved_h < LEAST_SAVED_S / S_PER_H:
        return math.inf
    if probability < 1.0:
        more += (1.0 - probability) / probability * lost
    return max(more, 0.0) / saved_h


def pays_to_price_per_kwh(item: TargetWorth, without: TargetWorth, value_per_h: float,
                          lost_wh: float = 0.0) -> float:
    """
    Return the price of energy [per kWh] up to which a target costs less than no heating; infinity: at any price.

    0 if it pays at no price. `lost_wh` is the heat that is lost for each time that the vehicle charges [Wh].
    """
    if math.isinf(item.charging_time_s):
        return 0.0
    if math.isinf(without.charging_time_s):
        return math.inf
    saved_h = (without.charging_time_s - item.charging_time_s) / S_PER_H
    if saved_h < LEAST_SAVED_S / S_PER_H:
        return 0.0
    more_kwh = (item.bought_energy_wh - without.bought_energy_wh + lost_wh) / WH_PER_KWH
    return value_per_h * saved_h / more_kwh if more_kwh > 0.0 else math.inf


def pays_from_probability(item: TargetWorth, without: TargetWorth) -> float:
    """
    Return the least probability of charging from which on a target costs less than no heating.

    Both are results of an Expectation. Infinity: it costs more even if the vehicle charges for certain.
    """
    lost = max(item.not_charged_cost - without.not_charged_cost, 0.0)
    saved = without.charged_cost - item.charged_cost
    return lost / (lost + saved) if saved > 0.0 else math.inf
