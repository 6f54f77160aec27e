# SPDX-License-Identifier: Apache-2.0
"""The messages of the bus gateway: the live battery as a BatteryState, and its diagnostics."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import BatteryState

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from builtin_interfaces.msg import Time

    from bev_preheat.bus.battery import LiveBattery


def live_battery_message(battery: LiveBattery, stamp: Time) -> BatteryState:
    """Return the BatteryState of a LiveBattery; unknown fields are NaN."""
    current_a = battery.current_a
    message = BatteryState(
        voltage=_known(battery.voltage_v), temperature=_known(battery.temperature_c),
        # sensor_msgs has it negative when discharging.
        current=math.nan if current_a is None else -current_a,
        charge=math.nan, capacity=math.nan, design_capacity=math.nan, percentage=_known(battery.soc),
        power_supply_status=_supply_status(battery.is_charging),
        power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_UNKNOWN,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_UNKNOWN,
        present=True, cell_temperature=list(battery.cells_c))
    message.header.stamp = stamp
    return message


def _known(value: float | None) -> float:
    return math.nan if value is None else value


def _supply_status(is_charging: bool | None) -> int:
    if is_charging is None:
        return int(BatteryState.POWER_SUPPLY_STATUS_UNKNOWN)
    return int(BatteryState.POWER_SUPPLY_STATUS_CHARGING if is_charging else
               BatteryState.POWER_SUPPLY_STATUS_DISCHARGING)


def bus_entry(node_name: str, part: str, hardware: str, errors: Sequence[str], warnings: Sequence[str], good: str,
              values: Mapping[str, str]) -> DiagnosticStatus:
    """Return the DiagnosticStatus `NODE: part`: ERROR with any error, else WARN with any warning, else OK."""
    level = (DiagnosticStatus.ERROR if errors else DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK)
    return DiagnosticStatus(
        name=f'{node_name.lstrip("/")}: {part}', hardware_id=hardware, level=level,
        message='; '.join([*errors, *warnings]) or good,
        values=[KeyValue(key=key, value=value) for key, value in values.items()])
