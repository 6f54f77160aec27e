# SPDX-License-Identifier: Apache-2.0
"""The equations of a charging session, shared by floats (`session`) and symbols (`optimum`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.numerics.arithmetic import Arithmetic, Number
from bev_preheat.vehicle.charging import charging_of

if TYPE_CHECKING:
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.numerics.arithmetic import AnyNumber, CurveFunction
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat.vehicle.model import Rates


def supply_of(vehicle: Vehicle, stop: ChargingStop) -> float:
    """Return the power of charger and inlet that cabin and auxiliaries leave [W]."""
    return (min(stop.charger_power_w, charging_of(vehicle).maximum_inlet_power_w)
            - stop.cabin_heating_power_w - stop.auxiliary_power_w)


def heater_power_of(vehicle: Vehicle, stop: ChargingStop) -> float:
    """Return the power of the heater while it heats at the charger [W]."""
    return max(0.0, min(vehicle.hvch.maximum_power_w - stop.cabin_heating_power_w,
                        supply_of(vehicle, stop)))


def heated_heat_capacity_j_per_k(vehicle: Vehicle) -> float:
    """Return the heat capacity of the battery and of the coolant between heater and battery [J/K]."""
    return vehicle.battery.heat_capacity_j_per_k + vehicle.heat_path.coolant_heat_capacity_j_per_k


def heated_c(vehicle: Vehicle, temperature_c: AnyNumber, heater_w: AnyNumber, excess_k: AnyNumber) -> AnyNumber:
    """
    Return T_h [deg C], the common temperature of battery and coolant once the heat under way has arrived.

    `heater_w` is the heater's power [W], `excess_k` is the coolant's temperature above the battery's [K]. The car
    heats while T_h is below its limit. The command acts on T_h at once, so the heater neither overshoots the
    limit nor cycles around it:

        (C_b + C_c) T_h = C_b T_b + C_c T_c + eta lag P
    """
    path = vehicle.heat_path
    under_way_j = (path.coolant_heat_capacity_j_per_k * excess_k
                   + vehicle.hvch.efficiency * path.heater_lag_s * heater_w)
    return temperature_c + under_way_j / heated_heat_capacity_j_per_k(vehicle)


def charging_power(limit_w: AnyNumber, left_w: AnyNumber,
                   arithmetic: Arithmetic[Number]) -> AnyNumber:
    """Return P_c [W] from the limit's value [W, negative] and the power that all others leave [W]."""
    return arithmetic.maximum(0.0, arithmetic.minimum(left_w, -limit_w))  # type: ignore[arg-type]


def make_charging_rates(limit_w: CurveFunction[Number], rates: Rates[Number],
                        arithmetic: Arithmetic[Number]) -> Rates[AnyNumber]:
    """
    Return the model's `rates` under the charging power at each state.

    `limit_w(soc, temperature_c)` is the highest charging power [W, negative]. In place of the terminal power
    the rates take the power left for the battery, negative, and in place of the Joule heat they return the
    charging power [W].
    """
    def charged(soc: AnyNumber, temperature_c: AnyNumber, left_w: AnyNumber, variance_w2: AnyNumber,
                heat_w: AnyNumber, leakage_w_per_k: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
        terminal_w = charging_power(limit_w(soc, temperature_c), -left_w, arithmetic)
        soc_rate, temperature_rate, _ = rates(
            soc, temperature_c, -terminal_w, variance_w2, heat_w, leakage_w_per_k)
        return soc_rate, temperature_rate, terminal_w

    return charged
