# SPDX-License-Identifier: Apache-2.0
"""
Whether voltage and state of charge match the battery of the vehicle file, and the state of charge its scale.

The terminal voltage lies near U_oc(soc, T) - R(soc, T) I. Vehicle files differ from cars, so the
bounds are wide: they detect another battery, a wrong scale, and a charge that was never set.

A state of charge in per cent lies within 0 ... 1 near empty. Values above 1 are refused. A value below 1 that
follows them has the same scale, unless it continues the last valid value.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.tunables import EMPTY_BELOW, FULLER_SOC, GOES_ON_WITHIN, SCALE_HOLDS_S, VOLTAGE_WITHIN
from bev_preheat.vehicle.variants import KEPT_VEHICLES

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.vehicle.description import Vehicle


class ElectricalCheck:
    """Compares voltage and state of charge with the curves of a vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Take the curves of a Vehicle."""
        battery = vehicle.battery
        self._voltage_v = battery.open_circuit_voltage.function(FLOATS)
        self._resistance_ohm = battery.resistance.function(FLOATS)
        self._temperatures_c = battery.temperature_range_c

    def voltage_doubt(self, voltage_v: float, current_a: float, temperature_c: float, soc: float) -> str:
        """Return the sentence on a voltage [V] that is not this battery's; '' if it may be."""
        expected_v, drop_v = self._expected(current_a, temperature_c, soc)
        allowed_v = VOLTAGE_WITHIN * expected_v + abs(drop_v)
        if abs(voltage_v - (expected_v - drop_v)) <= allowed_v:
            return ''
        return (f'voltage: {voltage_v:g} V is not that of this battery: {expected_v - drop_v:.0f} V are expected '
                f'at {100 * soc:.1f} % and {current_a:.0f} A, within {allowed_v:.0f} V; voltage and current are '
                'not used')

    def charge_doubt(self, voltage_v: float, current_a: float, temperature_c: float, soc: float) -> str:
        """Return the sentence on a state of charge of 0 that the voltage [V] contradicts; '' if it does not."""
        if soc > EMPTY_BELOW:
            return ''
        empty_v, drop_v = self._expected(current_a, temperature_c, 0.0)
        fuller_v, _ = self._expected(current_a, temperature_c, FULLER_SOC)
        resting_v = voltage_v + drop_v
        if resting_v <= empty_v + 0.5 * (fuller_v - empty_v):
            return ''
        return (f'percentage: {100 * soc:.1f} % contradicts {voltage_v:.1f} V: an empty battery has '
                f'{empty_v - drop_v:.1f} V; the field may not be set')

    def is_nearer(self, voltage_v: float, current_a: float, temperature_c: float, soc: float,
                  other_soc: float) -> bool:
        """Return whether a voltage [V] fits a state of charge better than another."""
        (own_v, drop_v), (other_v, _) = (
            self._expected(current_a, temperature_c, each) for each in (soc, other_soc))
        resting_v = voltage_v + drop_v
        return abs(resting_v - own_v) < abs(resting_v - other_v)

    def _expected(self, current_a: float, temperature_c: float, soc: float) -> tuple[float, float]:
        """Return (open-circuit voltage, voltage drop of a current) [V] at a state within the curves' range."""
        low_c, high_c = self._temperatures_c
        temperature_c = min(max(temperature_c, low_c), high_c)
        return (self._voltage_v(soc, temperature_c),
                self._resistance_ohm(soc, temperature_c) * current_a)


@lru_cache(maxsize=KEPT_VEHICLES)
def electrical_check(vehicle: Vehicle) -> ElectricalCheck:
    """Return the ElectricalCheck of a Vehicle."""
    return ElectricalCheck(vehicle)


class PercentScale(NamedTuple):
    """
    The latest percentages, including refused ones.

    `latest` is the latest one on a scale of 100, at `latest_s` [s], None: a valid one followed. `valid` is the
    latest valid one.
    """

    latest: float | None = None
    latest_s: float = 0.0
    valid: float | None = None

    def refused(self, instant_s: float, percentage: float) -> PercentScale:
        """Return the PercentScale after one was refused at an instant [s]; above 1 it is on a scale of 100."""
        return PercentScale(percentage, instant_s, self.valid) if 1.0 < percentage <= 100.0 else self

    def seen(self, instant_s: float, soc: float, is_vouched_for: Callable[[], bool]) -> tuple[PercentScale, str]:
        """
        Return the PercentScale after a state of charge, and the sentence on one on a scale of 100; '' for none.

        `is_vouched_for()`: the voltage fits the value better than a hundredth of this value.
        """
        before = self.latest
        goes_on = self.valid is not None and abs(soc - self.valid) <= GOES_ON_WITHIN
        if (before is None or goes_on or soc == 0.0
                or not 0.0 <= instant_s - self.latest_s <= SCALE_HOLDS_S or is_vouched_for()):
            return PercentScale(None, 0.0, soc), ''
        return PercentScale(before, instant_s, self.valid), (
            f'percentage: {soc:g} follows {before:g}, which is on a scale of 100; expected 0 ... 1: '
            f'{soc / 100:g}?')
