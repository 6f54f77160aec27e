# SPDX-License-Identifier: Apache-2.0
"""The fields of a sensor_msgs/BatteryState, checked: temperatures, percentage, power, supply status."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.errors import figure_beyond

if TYPE_CHECKING:
    from sensor_msgs.msg import BatteryState

# No road vehicle's battery exceeds this voltage [V] or this current [A].
HIGHEST_VOLTAGE_V = 2000.0
HIGHEST_CURRENT_A = 5000.0
# A percentage this far outside 0 ... 1 was rounded: to 0.4 % or 1 % a bit, or to single precision.
PERCENTAGE_ROUNDING = 0.005
# A temperature outside these limits [deg C] is a code for a missing sensor.
CELL_RANGE_C = (-60.0, 100.0)
# All 0 or NaN in a message without a percentage.
EVIDENCE_OF_A_BATTERY = ('voltage', 'current', 'charge', 'capacity', 'design_capacity')
SUPPLY_STATUSES = {int(status): status for status in SupplyStatus}


class Temperatures(NamedTuple):
    """
    The battery's temperature [deg C], and those of its cells.

    Coldest cell [deg C] and difference between warmest and coldest cell [K]; None: unknown.
    """

    battery_c: float
    coldest_cell_c: float | None = None
    cell_spread_k: float | None = None


def read_temperatures(message: BatteryState, problems: list[str]) -> Temperatures:
    """
    Return the Temperatures of a message; append reasons for a refusal to `problems`.

    If `temperature` is NaN, the mean of the known cell temperatures replaces it.
    """
    battery_c, low_c, high_c = float(message.temperature), *CELL_RANGE_C
    cells_c = np.asarray(message.cell_temperature, dtype=float)
    cells_c = cells_c[np.isfinite(cells_c)]
    if len(cells_c) == 0 or math.isinf(battery_c):
        if not math.isfinite(battery_c):
            problems.append(
                f'temperature: {battery_c} is not a known value; it must be a finite number, in degC')
        return Temperatures(battery_c)
    coldest_c, warmest_c = float(cells_c.min()), float(cells_c.max())
    if low_c <= coldest_c and warmest_c <= high_c:
        return Temperatures(float(cells_c.mean()) if math.isnan(battery_c) else battery_c,
                            coldest_c, warmest_c - coldest_c)
    if math.isnan(battery_c):
        wrong_c = warmest_c if warmest_c > high_c else coldest_c
        problems.append(f'cell_temperature: {figure_beyond(wrong_c, low_c, high_c)} is not allowed; it '
                        f'must be {low_c:g} ... {high_c:g} degC, or NaN: unknown')
    return Temperatures(battery_c)


def read_percentage(message: BatteryState, problems: list[str]) -> float:
    """
    Return the state of charge (0 ... 1) of a message; append reasons for a refusal to `problems`.

    A value at most PERCENTAGE_ROUNDING outside the range is clipped.
    """
    percentage = float(message.percentage)
    if not math.isfinite(percentage):
        problems.append(f'percentage: {percentage} is not a known value; it must be 0 ... 1')
    elif not -PERCENTAGE_ROUNDING <= percentage <= 1.0 + PERCENTAGE_ROUNDING:
        problems.append(
            f'percentage: {figure_beyond(percentage, 0.0, 1.0)} is not allowed; it must be 0 ... 1')
    elif percentage == 0.0 and not _shows_a_battery(message):
        problems.append('percentage: 0 counts as not given where present is false and '
                        f'{", ".join(EVIDENCE_OF_A_BATTERY)} are unset too; it must be 0 ... 1, '
                        'and a battery that is really empty says "present: true" or its voltage')
    return min(max(percentage, 0.0), 1.0)


def _shows_a_battery(message: BatteryState) -> bool:
    return message.present or any(
        value != 0.0 and not math.isnan(value)
        for value in (getattr(message, field) for field in EVIDENCE_OF_A_BATTERY))


def read_voltage_and_current(message: BatteryState) -> tuple[float, float] | tuple[None, None]:
    """
    Return the voltage [V] and the current [A], positive = discharging; (None, None): unknown.

    An unset voltage reads 0. A current of 0 means a parked vehicle or an unset field: only a field that has had
    another value is known to be set (control.knowledge).
    """
    voltage_v, current_a = float(message.voltage), -float(message.current)
    known = 0.0 < voltage_v <= HIGHEST_VOLTAGE_V and abs(current_a) <= HIGHEST_CURRENT_A
    return (voltage_v, current_a) if known else (None, None)


def read_supply_status(message: BatteryState) -> SupplyStatus:
    """Return the SupplyStatus of a message; any other number is UNKNOWN."""
    return SUPPLY_STATUSES.get(message.power_supply_status, SupplyStatus.UNKNOWN)
