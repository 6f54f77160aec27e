# SPDX-License-Identifier: Apache-2.0
"""Cost of one target: prices, and the figures of the drive and the charging session after it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
import math
from typing import Any

from bev_preheat.numerics.factors import S_PER_H, WH_PER_KWH

OF_UNCERTAINTY = 'charged_cost', 'not_charged_cost'


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


@dataclass(frozen=True)
class TargetWorth:
    """
    One target [deg C] and its result; the fields are those of the JSON.

    `hvch_electric_wh` is the heater's energy before arrival [Wh]. Charging time [s], bought energy [Wh] and cost
    are infinite if the session never ends. The target of a drive without heating is the temperature on arrival,
    the highest target that needs no heating. `charger_heating` is the value of the HeatingDecision at the charger
    ('unable', 'never', 'always', 'limited'), `charger_heating_wh` its electrical energy [Wh].

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

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as `preheat worth --json` writes it; a sure arrival has no figures of an uncertain one."""
        figures = asdict(self)
        if math.isnan(self.charged_cost):
            for name in OF_UNCERTAINTY:
                del figures[name]
        return figures
