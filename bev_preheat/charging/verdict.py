# SPDX-License-Identifier: Apache-2.0
"""The verdict on heating before the charger, as a sentence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.charging.prospect import chance_text
from bev_preheat.numerics.factors import WH_PER_KWH
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from bev_preheat.charging.prospect import ChargingProspect
    from bev_preheat.charging.target_worth import Prices, TargetWorth
    from bev_preheat.charging.too_warm import Derating

# Cost differences below this, in any currency, do not matter to a driver.
LEAST_COST_DIFFERENCE = 0.01


def verdict_on(best: TargetWorth, without: TargetWorth, break_even: float, prices: Prices,
               problem: str | None) -> str:
    """
    Return the sentence for the driver; `problem` is why the unheated battery is not charged.

    `break_even` is the least value of time for which heating pays [per h], or infinite.
    """
    if math.isinf(best.charging_time_s):
        return f'This charger cannot charge the battery that far, heated or not: {problem}.'
    heating = f'heating the battery to {best.arrival_temperature_c:.1f} degC before arrival'
    if math.isinf(without.charging_time_s):
        return (f'Worth it: {heating} lets it charge within {duration_text(best.charging_time_s)}; '
                f'without heating, {problem}.')
    if 0.0 < without.cost - best.cost < LEAST_COST_DIFFERENCE:
        return (f'It makes no difference: {heating} would save less than {LEAST_COST_DIFFERENCE:.2f} in all. Some '
                f'heating pays as soon as an hour is worth {break_even:.2f} to you.')
    if best is not without:
        saved = _saved_text(best, without, prices)
        pays = ('Some heating pays whatever your time is worth' if break_even == 0.0 else
                f'Some heating pays as soon as an hour is worth {break_even:.2f} to you')
        return f'Worth it: {heating} {saved}. {pays}.'
    if math.isinf(break_even):
        return 'Not worth it: heating before arrival saves neither time nor money at this charger.'
    return (f'Not worth it at {prices.time_per_h:.2f} an hour: heating pays as soon as an hour is worth '
            f'{break_even:.2f} to you.')


def verdict_in_doubt(sentence: str, prospect: ChargingProspect, pays_from: float) -> str:
    """
    Return the sentence of `verdict_on` with the prospect of charging.

    `pays_from` is the least probability of charging for which some heating pays, above 1: none.
    """
    if prospect.probability == 1.0 or prospect.wait_s is not None:
        return sentence
    pays = '' if pays_from > 1.0 else (
        ' Some heating pays at any chance.' if pays_from == 0.0 else
        f' Some heating pays from {chance_text(pays_from)} chance on.')
    return f'{prospect.in_words} chance of charging: {sentence[0].lower()}{sentence[1:]}{pays}'


def bounds_in_words(to_price_per_kwh: float, from_probability: float) -> str:
    """
    Return the sentence on the price of energy up to which, and the chance of charging from which on heating pays.

    A price of 0 or a probability above 1 is left out: heating never pays, or another sentence gives the chance.
    """
    if to_price_per_kwh == 0.0:
        return ''
    price = ('at any energy price' if math.isinf(to_price_per_kwh) else
             f'up to an energy price of {to_price_per_kwh:.2f} per kWh')
    chance = '' if from_probability > 1.0 else (
        ' and at any chance of charging' if from_probability == 0.0 else
        f' and from {chance_text(from_probability)} chance of charging on')
    return f'Some heating pays {price}{chance}.'


def unheated_at_charger(best: TargetWorth, without: TargetWorth) -> str:
    """Return the cost at the charger of not heating instead of the `best` target, as part of a sentence."""
    if math.isinf(without.charging_time_s) or math.isinf(best.charging_time_s):
        return ''
    longer_s, more = without.charging_time_s - best.charging_time_s, without.cost - best.cost
    return (f'charging would take {duration_text(abs(longer_s))} {"longer" if longer_s >= 0.0 else "less"} and '
            f'the stop would cost {more:.2f} more in all')


def warmer_than(fastest: TargetWorth, hottest: TargetWorth, slower_s: float, derating: Derating) -> str:
    """Return the sentence on the `hottest` arrival that charges slower than the `fastest` by `slower_s` [s]."""
    slower = ('would not charge to the end' if math.isinf(slower_s) else
              f'would charge {duration_text(slower_s)} slower than at {fastest.arrival_temperature_c:.0f} degC')
    return f'Arriving at {hottest.arrival_temperature_c:.0f} degC {slower}, {derating.reason}.'


def _saved_text(best: TargetWorth, without: TargetWorth, prices: Prices) -> str:
    saved_s = without.charging_time_s - best.charging_time_s
    more = prices.energy_per_kwh * (best.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH
    time = (f'saves {duration_text(saved_s)} at the charger' if saved_s >= 0.0 else
            f'takes {duration_text(-saved_s)} longer at the charger')
    energy = f'costs {more:.2f} more for energy' if more >= 0.0 else f'saves {-more:.2f} in energy costs'
    return f'{time} and {energy}'
