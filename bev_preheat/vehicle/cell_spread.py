# SPDX-License-Identifier: Apache-2.0
"""Power limits of a battery whose cells differ: the coldest cell sets them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.vehicle.curves import Table

if TYPE_CHECKING:
    from bev_preheat.numerics.arithmetic import Curve
    from bev_preheat.vehicle.description import Vehicle


def limited_by_coldest_cell(vehicle: Vehicle, colder_by_k: float) -> Vehicle:
    """
    Return a Vehicle with the discharge and charge limits of its coldest cell.

    That cell is `colder_by_k` [K] colder than the battery's mean temperature, which is the argument of the
    maps; their temperature axes therefore move up by `colder_by_k`.
    """
    if colder_by_k == 0.0:
        return vehicle
    battery, charging = vehicle.battery, vehicle.charging
    return replace(
        vehicle,
        battery=replace(battery, discharge_power_limit=_moved(battery.discharge_power_limit, colder_by_k),
                        charge_power_limit=_moved(battery.charge_power_limit, colder_by_k)),
        charging=None if charging is None else replace(
            charging, power_limit=_moved(charging.power_limit, colder_by_k)))


def _moved(limit: Curve, by_k: float) -> Curve:
    """Return a limit's map with its temperature axis moved up [K]; other curves have no such axis."""
    if not isinstance(limit, Table):
        return limit
    return replace(limit, temperature_c=tuple(value_c + by_k for value_c in limit.temperature_c))
