# SPDX-License-Identifier: Apache-2.0
"""The car's own conditions for heating its battery; a car without them heats as commanded."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.vehicle.heater_controller import Refusal, SERVED, step_below_w, Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bev_preheat.numerics.arrays import FloatArray

# Slower than this a vehicle stands [m/s]: positions and wheel pulses jitter.
STANDING_MPS = 0.3


@dataclass(frozen=True)
class HeatingGates:
    """
    The car heats from `minimum_soc` (0 ... 1) on and up to `maximum_temperature_c` [deg C].

    `only_while_standing`: not in motion. `power_steps_w` [W], ascending: the heater's powers other than 0;
    () for any, one for a heater that is either on or off.
    """

    minimum_soc: float = 0.0
    maximum_temperature_c: float = inf
    only_while_standing: bool = False
    power_steps_w: tuple[float, ...] = ()

    @property
    def is_any(self) -> bool:
        """Whether the vehicle has a gate."""
        return self.looks_at_battery or self.only_while_standing or bool(self.power_steps_w)

    @property
    def looks_at_battery(self) -> bool:
        """Whether a gate depends on the battery's state."""
        return self.minimum_soc > 0.0 or isfinite(self.maximum_temperature_c)

    def step_below_w(self, power_w: float) -> float:
        """Return the highest power [W] that the heater has and that is at most `power_w`."""
        return step_below_w(self.power_steps_w, power_w)

    def steps_below_w(self, power_w: FloatArray) -> FloatArray:
        """Return `step_below_w` for an array of powers [W]."""
        if not self.power_steps_w:
            return power_w
        steps_w = np.array((0.0, *self.power_steps_w))
        below_w: FloatArray = steps_w[np.maximum(np.searchsorted(steps_w, power_w, side='right') - 1, 0)]
        return below_w

    def verdict(self, soc: float, temperature_c: float, speed_mps: float = 0.0) -> Verdict:
        """
        Return the Verdict on heating at a state of charge (0 ... 1), a temperature [deg C] and a speed [m/s].

        A NaN forbids heating if a gate depends on it.
        """
        if self.minimum_soc > 0.0 and not soc >= self.minimum_soc:
            return Verdict(Refusal.LOW_CHARGE, f'the state of charge is {100.0 * soc:.1f} %; this vehicle heats '
                           f'from {100.0 * self.minimum_soc:g} % on')
        if isfinite(self.maximum_temperature_c) and not temperature_c < self.maximum_temperature_c:
            return Verdict(Refusal.HOT_BATTERY, f'the battery is at {temperature_c:.1f} degC; this vehicle heats '
                           f'below {self.maximum_temperature_c:g} degC')
        if self.only_while_standing and not abs(speed_mps) < STANDING_MPS:
            return Verdict(Refusal.IN_MOTION, f'the vehicle moves at {speed_mps:.1f} m/s; it heats only while it '
                           'stands')
        return SERVED


NO_GATES = HeatingGates()


def gate_problems(gates: HeatingGates, maximum_power_w: float, lowest_c: float) -> Iterator[str]:
    """Yield a sentence for each implausible value; heater [W] and coldest battery [deg C] of the same file."""
    steps_w = gates.power_steps_w
    if any(not low_w < high_w for low_w, high_w in zip(steps_w, steps_w[1:])):
        yield f'heating_gates.power_steps_w: {list(steps_w)} must rise from step to step'
    if steps_w and steps_w[-1] > maximum_power_w:
        yield (f'heating_gates.power_steps_w: {steps_w[-1]:g} W is above hvch.maximum_power_w, '
               f'{maximum_power_w:g} W')
    if gates.maximum_temperature_c <= lowest_c:
        yield (f'heating_gates.maximum_temperature_c: {gates.maximum_temperature_c:g} degC is not above the '
               f'lowest temperature of battery.temperature_range_c, {lowest_c:g} degC, so the vehicle would never '
               'heat')
