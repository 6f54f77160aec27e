# SPDX-License-Identifier: Apache-2.0
"""
The worth of a target before the charger, and of all targets tried.

Prices, the figures of drive and session, the break-even prices of one target, and the results of a search.
"""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from itertools import combinations
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.charging.stop import chance_text
from bev_preheat.errors import InvalidInput, range_problem
from bev_preheat.numerics import S_PER_H, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from bev_preheat.charging.heating_choice import HeatingChoice

HEATING, COOLING = 'heating', 'cooling'
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
    """Return the least probability of charging at which a target of an Expectation pays, infinity if at none."""
    lost = max(item.not_charged_cost - without.not_charged_cost, 0.0)
    saved = without.charged_cost - item.charged_cost
    return lost / (lost + saved) if saved > 0.0 else math.inf


# Width [K] of a step of the charging time over the arrival temperature. It stands out if it saves so much [s], and
# so many times the mean saving of this width.
STAIR_K, STEP_SAVES_S, STANDS_OUT = 2.01, 60.0, 2.0


class TemperatureStep(NamedTuple):
    """Two arrival temperatures [deg C], and the charging time that the warmer one saves [s]."""

    from_c: float
    to_c: float
    saved_s: float

    def in_words(self) -> str:
        """Return the sentence for the driver."""
        more_k = self.to_c - self.from_c
        return (f'{more_k:.1f} K more on arrival, from {self.from_c:.1f} to {self.to_c:.1f} degC, '
                f'are worth {duration_text(self.saved_s)} at the charger.')


def greatest_step(targets: Iterable[TargetWorth], without: TargetWorth) -> TemperatureStep | None:
    """
    Return the few kelvins above the arrival `without` heating that save the most time at the charger, or None.

    None if none stand out. Limits over the battery temperature are often stairs, which a mean over all hides.
    """
    ends = sorted((target for target in targets if math.isfinite(target.charging_time_s)
                   and target.arrival_temperature_c >= without.arrival_temperature_c),
                  key=lambda target: target.arrival_temperature_c)
    steps = [TemperatureStep(low.arrival_temperature_c, high.arrival_temperature_c,
                             low.charging_time_s - high.charging_time_s)
             for low, high in combinations(ends, 2)
             if high.arrival_temperature_c - low.arrival_temperature_c <= STAIR_K]
    whole_k = ends[-1].arrival_temperature_c - ends[0].arrival_temperature_c if ends else 0.0
    if not steps or whole_k == 0.0:
        return None
    best = max(steps, key=lambda step: step.saved_s)
    usual_s = STAIR_K / whole_k * (ends[0].charging_time_s - min(target.charging_time_s for target in ends))
    return best if best.saved_s >= max(STEP_SAVES_S, STANDS_OUT * usual_s) else None


@dataclass(frozen=True)
class Worth:
    """
    The worth of heating over all `targets` tried, in rising order.

    `best` costs the least, `fixed` is the result of heating to the usual target. `verdict` is for the driver.
    `break_even_value_of_time_per_h` is the least value of time for which some heating pays, or None. `best_choice`
    and `choice_without` are the HeatingChoices at the charger after the best target and without heating.
    `pays_from_probability` is the least probability of charging for which some heating pays, above 1 if none does;
    None if it is certain. `pays_from_chance` is the same, also if it is certain. `pays_to_price_per_kwh` is the
    highest price of energy for which some heating pays, infinite if it pays at any price, 0 if at none. `by_rule`
    has the results of `maker_rules`, if asked for. `way` is HEATING, or COOLING if that is what pays; `step` the
    `greatest_step`.
    """

    targets: tuple[TargetWorth, ...]
    best: TargetWorth
    without_heating: TargetWorth
    fixed: TargetWorth
    break_even_value_of_time_per_h: float | None
    verdict: str
    best_choice: HeatingChoice = field(compare=False)
    choice_without: HeatingChoice = field(compare=False)
    pays_from_probability: float | None = None
    pays_from_chance: float = math.inf
    pays_to_price_per_kwh: float = 0.0
    by_rule: dict[str, TargetWorth] = field(default_factory=dict)
    way: str = HEATING
    step: TemperatureStep | None = None

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as `preheat worth --json` writes it."""
        return {'targets': [target.as_dictionary() for target in self.targets],
                'best': self.best.as_dictionary(), 'without_heating': self.without_heating.as_dictionary(),
                'fixed_target': self.fixed.as_dictionary(),
                'maker_rules': {name: item.as_dictionary() for name, item in self.by_rule.items()},
                'break_even_value_of_time_per_h': self.break_even_value_of_time_per_h,
                'charger_heating': {'best': self.best_choice.as_dictionary(),
                                    'without_heating': self.choice_without.as_dictionary(),
                                    'sentence': self.best_choice.sentence()},
                'verdict': self.verdict,
                'break_even_energy_price_per_kwh': self.pays_to_price_per_kwh,
                'break_even_charging_probability': (
                    self.pays_from_chance if self.pays_from_chance <= 1.0 else None),
                'bounds': self.bounds_in_words(),
                'step': None if self.step is None else self.step._asdict(),
                'unheated_longer_charging_s': self.without_heating.charging_time_s - self.best.charging_time_s,
                'unheated_more_cost': self.without_heating.cost - self.best.cost,
                **({} if self.pays_from_probability is None else {
                    'pays_from_probability': self.pays_from_probability})}

    def bounds_in_words(self) -> str:
        """Return the sentence on the energy price and the chance at which the verdict changes; '' for none."""
        if self.pays_to_price_per_kwh == 0.0:
            return ''
        price = ('at any energy price' if math.isinf(self.pays_to_price_per_kwh) else
                 f'up to an energy price of {self.pays_to_price_per_kwh:.2f} per kWh')
        chance = ''
        # Of an uncertain session the verdict gives the chance.
        if self.pays_from_probability is None and self.pays_from_chance <= 1.0:
            chance = (' and at any chance of charging' if self.pays_from_chance == 0.0 else
                      f' and from {chance_text(self.pays_from_chance)} chance of charging on')
        return f'Some {self.way} pays {price}{chance}.'

    def unheated_in_words(self) -> str:
        """Return the cost at the charger of not heating instead of the best target, as part of a sentence."""
        without, best = self.without_heating, self.best
        if math.isinf(without.charging_time_s) or math.isinf(best.charging_time_s):
            return ''
        longer_s, more = without.charging_time_s - best.charging_time_s, without.cost - best.cost
        return (f'charging would take {duration_text(abs(longer_s))} {"longer" if longer_s >= 0.0 else "less"} '
                f'and the stop would cost {more:.2f} more in all')
