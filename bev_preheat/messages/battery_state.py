# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/BatteryState: read as a Measurement or its refusal, and written by simulator and bus gateway."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np
from sensor_msgs.msg import BatteryState as BatteryStateMessage

from bev_preheat.control.events import BatteryStateArrived, BatteryStateUnreadable
from bev_preheat.control.inputs import Measurement, SupplyStatus
from bev_preheat.errors import InvalidInput, range_problem
from bev_preheat.messages.fields import nanoseconds, stamp_problems, time_message
from bev_preheat.numerics import present_cells
from bev_preheat.planning.situation import BatteryState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.simulation.sensors import Reading

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
    """Temperature of battery and coldest cell [deg C], and spread of the cells [K]; None: unknown."""

    battery_c: float
    coldest_cell_c: float | None = None
    cell_spread_k: float | None = None


def battery_event(message: BatteryStateMessage, hint: str = '') -> BatteryStateArrived | BatteryStateUnreadable:
    """Return the event of a message; `hint` is added to a refusal."""
    try:
        return BatteryStateArrived(measurement_from_message(message), hint)
    except InvalidInput as error:
        return BatteryStateUnreadable(InvalidInput([*error.problems, hint]) if hint else error,
                                      float(message.percentage))


def measurement_from_message(message: BatteryStateMessage) -> Measurement:
    """Return the Measurement of a message; raise InvalidInput on unknown values."""
    problems: list[str] = []
    temperatures = read_temperatures(message, problems)
    soc = _read_percentage(message, problems)
    problems += stamp_problems(message.header.stamp)
    if problems:
        raise InvalidInput(problems)
    voltage_v, current_a = _read_voltage_and_current(message)
    return Measurement(
        BatteryState(temperatures.battery_c, soc), nanoseconds(message.header.stamp), voltage_v, current_a,
        coldest_cell_c=temperatures.coldest_cell_c, cell_spread_k=temperatures.cell_spread_k,
        supply_status=SUPPLY_STATUSES.get(message.power_supply_status, SupplyStatus.UNKNOWN),
        location=message.location, serial_number=message.serial_number)


def read_temperatures(message: BatteryStateMessage, problems: list[str]) -> Temperatures:
    """Return the Temperatures (the cells' mean if `temperature` is NaN); append refusals to `problems`."""
    battery_c, low_c, high_c = float(message.temperature), *CELL_RANGE_C
    cells_c = present_cells(np.asarray(message.cell_temperature, dtype=float), battery_c)
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
        problems.append(range_problem('cell_temperature', wrong_c, low_c, high_c, 'degC, or NaN: unknown'))
    return Temperatures(battery_c)


def _read_percentage(message: BatteryStateMessage, problems: list[str]) -> float:
    """Return the state of charge (0 ... 1), a rounded one clipped; append reasons for a refusal to `problems`."""
    percentage = float(message.percentage)
    if not math.isfinite(percentage):
        problems.append(f'percentage: {percentage} is not a known value; it must be 0 ... 1')
    elif not -PERCENTAGE_ROUNDING <= percentage <= 1.0 + PERCENTAGE_ROUNDING:
        problems.append(range_problem('percentage', percentage, 0.0, 1.0))
    elif percentage == 0.0 and not message.present and all(
            value == 0.0 or math.isnan(value)
            for value in (getattr(message, field) for field in EVIDENCE_OF_A_BATTERY)):
        problems.append('percentage: 0 counts as not given where present is false and '
                        f'{", ".join(EVIDENCE_OF_A_BATTERY)} are unset too; it must be 0 ... 1, '
                        'and a battery that is really empty says "present: true" or its voltage')
    return min(max(percentage, 0.0), 1.0)


def _read_voltage_and_current(message: BatteryStateMessage) -> tuple[float, float] | tuple[None, None]:
    """
    Return the voltage [V] and the current [A], positive = discharging; (None, None): unknown.

    An unset voltage reads 0. A current of 0 means a parked vehicle or an unset field: only a field that has had
    another value is known to be set, and 0 soon after that value is not (control.knowledge).
    """
    voltage_v, current_a = float(message.voltage), -float(message.current)
    is_known = 0.0 < voltage_v <= HIGHEST_VOLTAGE_V and abs(current_a) <= HIGHEST_CURRENT_A
    return (voltage_v, current_a) if is_known else (None, None)


def battery_state_message(
        stamp_ns: int, temperature_c: float | None, soc: float | None, voltage_v: float | None,
        current_a: float | None, supply_status: SupplyStatus = SupplyStatus.UNKNOWN,
        cells_c: Sequence[float] = (), capacity_ah: float = math.nan, location: str = '') -> BatteryStateMessage:
    """Return the message of a battery at an instant [ns]; current [A] positive = discharging, None: unknown."""
    def number(value: float | None) -> float:
        return math.nan if value is None else value

    message = BatteryStateMessage(
        # sensor_msgs has the current negative when discharging.
        voltage=number(voltage_v), temperature=number(temperature_c), current=-number(current_a),
        charge=number(soc) * capacity_ah, capacity=math.nan, design_capacity=capacity_ah, percentage=number(soc),
        power_supply_status=int(supply_status),
        power_supply_health=BatteryStateMessage.POWER_SUPPLY_HEALTH_UNKNOWN,
        power_supply_technology=BatteryStateMessage.POWER_SUPPLY_TECHNOLOGY_UNKNOWN,
        present=True, cell_temperature=list(cells_c), location=location)
    message.header.stamp = time_message(stamp_ns)
    return message


def reading_message(reading: Reading, capacity_ah: float, stamp_ns: int) -> BatteryStateMessage:
    """Return the message of a simulated Reading, stamped with an instant [ns]."""
    return battery_state_message(
        stamp_ns, reading.temperature_c, reading.soc, reading.voltage_v, reading.current_a, reading.supply_status,
        capacity_ah=capacity_ah, location=reading.location)
