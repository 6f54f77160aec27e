# SPDX-License-Identifier: Apache-2.0
"""A vehicle that is plugged in: the grid replaces the battery as the source of power."""

from dataclasses import replace
from functools import lru_cache

from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Vehicle

# In the equations the grid is a battery that is never empty, has no losses and delivers any power.
ENDLESS_AH = 1e8
NO_RESISTANCE_OHM = 1e-6
EVERY_POWER_W = 1e7
KEPT_GRIDS = 8


@lru_cache(maxsize=KEPT_GRIDS)
def grid_fed(vehicle: Vehicle) -> Vehicle:
    """
    Return the Vehicle whose heater, cabin and auxiliaries take nothing from the battery.

    Its charge is constant, no current warms it, and no reserve limits heating; heat capacity,
    leakage and temperature range are the battery's own. Cached: the same object for the same vehicle. The battery
    energy of its plans comes from the grid.
    """
    battery = vehicle.battery
    return replace(vehicle, battery=replace(
        battery, capacity_ah=ENDLESS_AH, resistance=_constant(NO_RESISTANCE_OHM),
        discharge_power_limit=_constant(EVERY_POWER_W), soc_range=(0.0, battery.soc_range[1])))


def _constant(value: float) -> Table:
    return Table((0.0,), (0.0,), ((value,),))
