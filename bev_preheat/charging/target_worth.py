# SPDX-License-Identifier: Apache-2.0
"""Cost of one target: prices, figures of drive and session, and the prices from which on this one pays."""
from __future__ import annotations

from dataclasses import asdict, dataclass
import math
from typing import Any

from bev_preheat.errors import InvalidInput, range_problem
from bev_preheat.numerics import S_PER_H, WH_PER_KWH

MOST_PRICE_PER_KWH, MOST_VALUE_PER_H = 1e3, 1e6
# Not a recommendation: the verdict states the value of time from which on heating pays.
ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H = 0.60, 10.0
OF_UNCERTAINTY, OF_AGEING = ('charged_cost', 'not_charged_cost'), ('ageing_cost', 'ageing_outside_share')


@dataclass(frozen=True)
class Prices:
    """Price of energy [per kWh] and value of the driver's time [per h], in one currency."""

    energy_per_kwh: float
    time_per_h: float

    def cost(self, energy_wh: float, time_s: float) -> float:
        """Return price times energy [Wh] plus value of time times time [s]; infinite if either is."""
        if math.isinf(energy_wh) or math.isinf(time_s):
            return math.inf
        return (self.energy_per_kwh * energy_wh / WH_PER_KWH
                + self.time_per_h * time_s / S_PER_H)


def check_prices(prices: Prices) -> None:
    """Raise InvalidInput, one sentence per problem, if Prices are negative or not numbers."""
    problems = [range_problem(name, value, 0.0, most, unit)
                for name, value, most, unit in (
                    ('energy price', prices.energy_per_kwh, MOST_PRICE_PER_KWH, 'per kWh'),
                    ('value of time', prices.time_per_h, MOST_VALUE_PER_H, 'per h'))
                if not 0.0 <= value <= most]
    if problems:
        raise InvalidInput(problems)


@dataclass(frozen=True)
class TargetWorth:
    """
    One target [deg C] and its result; the fields are those of the JSON.

    `hvch_electric_wh` is the heater's energy before arrival [Wh]. Charging time [s], bought energy [Wh] and cost
    are infinite if the session never ends. The target of a drive without heating is the temperature on arrival,
    the highest target that needs no heating. `charger_heating` is the value of the HeatingDecision at the charger
    ('unable', 'never', 'always', 'limited'), `charger_heating_wh` its electrical energy [Wh]. `ageing_cost` is the
    part of the cost for ageing, `ageing_outside_share` the share of the charge outside the model's range; 0 if the
    vehicle file has no price.

    If charging or arrival are uncertain (`expectation`), `cost` is the expected cost, `charged_cost` that with
    charging on arrival and `not_charged_cost` that without; NaN if they are certain.
    """

    target_c: float
    arrival_temperature_c: float
    arrival_soc: float
    hvch_electric_wh: float
    charging_time_s: float
    bought_energy_wh: float
    cost: float
    charger_heating: str = 'unable'
    charger_heating_wh: float = 0.0
    charged_cost: float = math.nan
    not_charged_cost: float = math.nan
    ageing_cost: float = 0.0
    ageing_outside_share: float = 0.0

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as `preheat worth --json` writes it, without the figures of uncertainty and ageing if none."""
        left_out = (*(OF_UNCERTAINTY if math.isnan(self.charged_cost) else ()),
                    *(() if self.ageing_cost else OF_AGEING))
        return {name: value for name, value in asdict(self).items() if name not in left_out}


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
    younger = without.ageing_cost - item.ageing_cost
    more = price_per_kwh * (item.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH - younger
    saved_h = (without.charging_time_s - item.charging_time_s) / S_PER_H
    if saved_h < LEAST_SAVED_S / S_PER_H:
        # As fast, but the battery ages less.
        return 0.0 if younger > 0.0 > more and saved_h > -LEAST_SAVED_S / S_PER_H else math.inf
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
    younger = without.ageing_cost - item.ageing_cost
    gain = value_per_h * saved_h + younger
    if (saved_h < LEAST_SAVED_S / S_PER_H and younger <= 0.0) or gain < 0.0:
        return 0.0
    more_kwh = (item.bought_energy_wh - without.bought_energy_wh + lost_wh) / WH_PER_KWH
    return gain / more_kwh if more_kwh > 0.0 else math.inf


def pays_from_probability(item: TargetWorth, without: TargetWorth) -> float:
    """
    Return the least probability of charging from which on a target costs less than no heating.

    Both are results of an Expectation. Infinity: it costs more even if the vehicle charges for certain.
    """
    lost = max(item.not_charged_cost - without.not_charged_cost, 0.0)
    saved = without.charged_cost - item.charged_cost
    return lost / (lost + saved) if saved > 0.0 else math.inf
