# SPDX-License-Identifier: Apache-2.0
"""Result of a search over all targets before the charger: the best, break-even prices, the worth of 2 K."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.charging.stop import chance_text
from bev_preheat.charging.target_worth import TargetWorth
from bev_preheat.charging.verdict import HEATING
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.charging.heating_choice import HeatingChoice

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


def greatest_step(targets: Iterable[TargetWorth]) -> TemperatureStep | None:
    """
    Return the few kelvins on arrival that save the most time at the charger; None if none stand out.

    Limits over the battery temperature are often stairs, which a mean over all temperatures hides.
    """
    ends = sorted((target for target in targets if math.isfinite(target.charging_time_s)),
                  key=lambda target: target.arrival_temperature_c)
    steps: list[TemperatureStep] = []
    for place, low in enumerate(ends):
        for high in ends[place + 1:]:
            if high.arrival_temperature_c - low.arrival_temperature_c > STAIR_K:
                break
            steps.append(TemperatureStep(low.arrival_temperature_c, high.arrival_temperature_c,
                                         low.charging_time_s - high.charging_time_s))
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
    has the results of `maker_rules`, if asked for. `way` is HEATING, or COOLING if that is what pays.
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

    @property
    def step(self) -> TemperatureStep | None:
        """The `greatest_step` of all targets."""
        return greatest_step(self.targets)

    def step_in_words(self) -> str:
        """Return the sentence on the `step`; '' for none."""
        return '' if self.step is None else self.step.in_words()

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
