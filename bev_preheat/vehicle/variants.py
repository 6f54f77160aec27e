# SPDX-License-Identifier: Apache-2.0
"""Vehicles made from another: corrected by factors, with a shell, limited by the coldest cell, fed by the grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic, Curve, CurveFunction, Number
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Leakage, Vehicle
from bev_preheat.vehicle.heat_path import DIRECT

# Results computed from a vehicle are cached for this many: for several cars, as described and as corrected.
KEPT_VEHICLES = 64


@dataclass(frozen=True)
class Corrections:
    """
    Factors on the vehicle file's heat capacity, leakage, resistance and HVCH efficiency.

    1 is the file's value. Floats, or arrays of one shape.
    """

    heat_capacity: AnyNumber = 1.0
    leakage: AnyNumber = 1.0
    resistance: AnyNumber = 1.0
    heater_efficiency: AnyNumber = 1.0


@dataclass(frozen=True)
class ScaledCurve:
    """A curve of `vehicle.curves` times a factor."""

    curve: Curve
    factor: AnyNumber

    def function(self, arithmetic: Arithmetic[Number]) -> CurveFunction[Number]:
        """`f(soc, temperature_c)`, for the given kind of number."""
        value, factor = self.curve.function(arithmetic), self.factor
        return lambda soc, temperature_c: factor * value(soc, temperature_c)


def corrected_vehicle(vehicle: Vehicle, corrections: Corrections) -> Vehicle:
    """Return `vehicle` with the Corrections applied; the heat capacity is that of both masses."""
    battery, leakage, path = vehicle.battery, vehicle.battery.leakage, vehicle.heat_path
    return replace(
        vehicle,
        heat_path=path if not path.is_shell else replace(
            path, coolant_heat_capacity_j_per_k=path.coolant_heat_capacity_j_per_k * corrections.heat_capacity),
        battery=replace(
            battery,
            heat_capacity_j_per_k=battery.heat_capacity_j_per_k * corrections.heat_capacity,
            resistance=ScaledCurve(battery.resistance, corrections.resistance),
            leakage=Leakage(leakage.gamma_0_w_per_k * corrections.leakage,
                            leakage.gamma_v_w_per_k_per_mps * corrections.leakage)),
        hvch=replace(vehicle.hvch,
                     efficiency=vehicle.hvch.efficiency * corrections.heater_efficiency))


@lru_cache(maxsize=KEPT_VEHICLES)
def without_heat_path(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle whose heat arrives at once; the same object for the same vehicle."""
    return replace(vehicle, heat_path=DIRECT, battery=replace(
        vehicle.battery, heat_capacity_j_per_k=vehicle.pack_heat_capacity_j_per_k))


@lru_cache(maxsize=KEPT_VEHICLES)
def with_coolant_in_battery(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle whose heat arrives at once, in a battery that includes the coolant, or its shell."""
    battery_j_per_k = vehicle.battery.heat_capacity_j_per_k
    return replace(corrected_vehicle(vehicle, Corrections(
        heat_capacity=1.0 + vehicle.heat_path.coolant_heat_capacity_j_per_k / battery_j_per_k)),
        heat_path=vehicle.heat_path if vehicle.heat_path.is_shell else DIRECT)


def with_shell(vehicle: Vehicle, shell_share: float, conductance_w_per_k: float, sensor: str) -> Vehicle:
    """Return a Vehicle of one mass with a shell; the other arguments are `thermal` of a vehicle file."""
    battery = vehicle.battery
    shell_j_per_k = shell_share * battery.heat_capacity_j_per_k
    return replace(
        vehicle, battery=replace(battery, heat_capacity_j_per_k=battery.heat_capacity_j_per_k - shell_j_per_k),
        heat_path=replace(
            vehicle.heat_path, coolant_heat_capacity_j_per_k=shell_j_per_k,
            coolant_conductance_w_per_k=float(conductance_w_per_k), shell_share=float(shell_share),
            sensor_rise={'core': 0.0, 'mean': 1.0, 'shell': 1.0 / shell_share}[sensor]))


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
