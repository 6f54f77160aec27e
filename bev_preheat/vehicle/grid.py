# SPDX-License-Identifier: Apache-2.0
"""A vehicle that is plugged in: the grid feeds what the battery would feed."""

from dataclasses import replace
from functools import lru_cache

from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Vehicle

# To the equations the grid is a battery that is never empty, has no losses and gives every power.
ENDLESS_AH = 1e8
NO_RESISTANCE_OHM = 1e-6
EVERY_POWER_W = 1e7
KEPT_VEHICLES = 8


@lru_cache(maxsize=KEPT_VEHICLES)
def grid_fed(vehicle: Vehicle) -> Vehicle:
    """
    Return the Vehicle whose heater, cabin and auxiliaries take nothing from the battery.

    Its charge stays, no current warms it, and no reserve holds heating back; its heat capacity,
    leakage and temperature range are the battery's own. The same one for the same vehicle. What its
    plans call battery energy comes from the grid.
    """
    battery = vehicle.battery
    return replace(vehicle, battery=replace(
        battery, capacity_ah=ENDLESS_AH, resistance=_constant(NO_RESISTANCE_OHM),
        discharge_power_limit=_constant(EVERY_POWER_W), soc_range=(0.0, battery.soc_range[1])))


def _constant(value: float) -> Table:
    return Table((0.0,), (0.0,), ((value,),))
