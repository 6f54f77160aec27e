# SPDX-License-Identifier: Apache-2.0
"""The battery's power limits (9i), which apply to P_b, as limits on the terminal power P_t."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic, Number
from bev_preheat.tunables import HOTTEST_BEYOND_RANGE_K

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

# Cached per vehicle and kind of number: nominal and corrected vehicles of several cars.
KEPT_LIMITS = 64

# `limits(soc, temperature_c, power_variance_w2)` -> least and most terminal power [W].
TerminalLimits = Callable[[Number, Number, Number], tuple[Number, Number]]


@lru_cache(maxsize=KEPT_LIMITS)
def make_terminal_limits(vehicle: Vehicle,
                         arithmetic: Arithmetic[Number]) -> TerminalLimits[AnyNumber]:
    """
    Return `limits(soc, temperature_c, power_variance_w2)` -> least and most terminal power [W].

    With P_b = U I + R var/U^2 at its limit, P_t = U I - R I^2. The upper limit is at most the value at
    I = U/(2 R), whatever the battery's own limit.
    """
    battery = vehicle.battery
    open_circuit_voltage = battery.open_circuit_voltage.function(arithmetic)
    resistance = battery.resistance.function(arithmetic)
    charge = battery.charge_power_limit.function(arithmetic)
    discharge = battery.discharge_power_limit.function(arithmetic)
    minimum = arithmetic.minimum

    def limits(soc: Number, temperature_c: Number,
               power_variance_w2: Number) -> tuple[Number, Number]:
        u = open_circuit_voltage(soc, temperature_c)
        r = resistance(soc, temperature_c)
        ripple_w = r * power_variance_w2 / (u * u)
        charging_a = (charge(soc, temperature_c) - ripple_w) / u
        discharging_a = minimum((discharge(soc, temperature_c) - ripple_w) / u, 0.5 * u / r)
        return (u * charging_a - r * charging_a * charging_a,
                u * discharging_a - r * discharging_a * discharging_a)

    return limits


def hottest_c(vehicle: Vehicle) -> float:
    """
    Return the hottest battery temperature used in planning [deg C].

    The model has no cooling, which every car has; a drive that needs cooling is held at this temperature.
    """
    return vehicle.battery.temperature_range_c[1] + HOTTEST_BEYOND_RANGE_K
