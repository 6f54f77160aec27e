# SPDX-License-Identifier: Apache-2.0
"""Equations of a charging session: power that charger and inlet leave, cooling; of floats and symbols."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast, NamedTuple

from bev_preheat.charging.stop import ChargingStop
from bev_preheat.numerics import AnyNumber, Arithmetic, CurveFunction, Number
from bev_preheat.planning.heat_run import heated_heat_capacity_j_per_k
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Cooling, Vehicle
from bev_preheat.vehicle.model import make_runge_kutta_4, Rates, stage_mean, Step

# `powers(temperature_c, left_w)` -> electrical power of the cooling, heat flow out of the battery [W].
CoolingPowers = Callable[[AnyNumber, AnyNumber], tuple[AnyNumber, AnyNumber]]


class ChargingPowers(NamedTuple):
    """Powers of a session [W]: into the terminals, of the cooling, and its heat flow out of the battery."""

    terminal_w: AnyNumber
    cooling_w: AnyNumber
    cooled_w: AnyNumber


def supply_of(vehicle: Vehicle, stop: ChargingStop) -> float:
    """Return the power of charger and inlet that cabin and auxiliaries leave [W]."""
    return (min(stop.charger_power_w, charging_of(vehicle).maximum_inlet_power_w)
            - stop.cabin_heating_power_w - stop.auxiliary_power_w)


def heater_power_of(vehicle: Vehicle, stop: ChargingStop) -> float:
    """Return the power of the heater while it heats at the charger [W]."""
    return max(0.0, min(vehicle.hvch.maximum_power_w - stop.cabin_heating_power_w,
                        supply_of(vehicle, stop)))


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


def make_cooling(cooling: Cooling | None, ambient_c: float,
                 arithmetic: Arithmetic[Number]) -> CoolingPowers:
    """
    Return `powers(temperature_c, left_w)`: the electrical power of the cooling and its heat flow [W].

        Q_c = max(0, min(Q_max (T - T_set) / band, Q_max, G (T - T_amb), COP P_left)),   P_c = Q_c / COP

    `left_w` [W] is the power that charger and inlet leave for cooling and battery, `ambient_c` [deg C] the air.
    G bounds a radiator. A cooling that the charger cannot feed cools with the power that is there. Q_max and COP
    of a cooling heat source depend on both temperatures.
    """
    if cooling is None:
        return lambda temperature_c, left_w: (0.0, 0.0)
    minimum, maximum = arithmetic.minimum, arithmetic.maximum
    curves = None if cooling.curves is None else [curve.function(arithmetic) for curve in cooling.curves]

    def powers(temperature_c: AnyNumber, left_w: AnyNumber) -> tuple[AnyNumber, AnyNumber]:
        ratio: AnyNumber = cooling.coefficient_of_performance
        most_w: AnyNumber = cooling.cooling_power_w
        if curves is not None:
            most_w, ratio = (curve(cast('AnyNumber', ambient_c), temperature_c) for curve in curves)
            most_w = most_w * ratio
        heat_w = minimum(most_w / cooling.proportional_band_k * (temperature_c - cooling.set_point_c), most_w)
        if math.isfinite(cooling.radiator_conductance_w_per_k):
            heat_w = minimum(heat_w, cooling.radiator_conductance_w_per_k * (temperature_c - ambient_c))
        # An Arithmetic takes plain numbers beside its own.
        heat_w = maximum(cast('AnyNumber', 0.0), minimum(heat_w, ratio * left_w))
        return heat_w / ratio, heat_w

    return powers


def make_charging_rates(limit_w: CurveFunction[Number], cooling: CoolingPowers, rates: Rates[Number],
                        arithmetic: Arithmetic[Number]) -> Rates[AnyNumber]:
    """
    Return the model's `rates` under the charging power at each state.

    `limit_w(soc, temperature_c)` is the highest charging power [W, negative], `cooling` that of `make_cooling`.
    In place of the terminal power the rates take the power left for cooling and battery, negative, and in place
    of the Joule heat they return the ChargingPowers.
    """
    def charged(soc: AnyNumber, temperature_c: AnyNumber, left_w: AnyNumber, variance_w2: AnyNumber,
                heat_w: AnyNumber, leakage_w_per_k: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
        cooling_w, cooled_w = cooling(temperature_c, -left_w)
        terminal_w = charging_power(limit_w(soc, temperature_c), -left_w - cooling_w, arithmetic)
        soc_rate, temperature_rate, _ = rates(
            soc, temperature_c, -terminal_w, variance_w2, heat_w - cooled_w, leakage_w_per_k)
        return soc_rate, temperature_rate, ChargingPowers(terminal_w, cooling_w, cooled_w)

    return charged


def _means(*stages: ChargingPowers) -> ChargingPowers:
    return ChargingPowers(*(stage_mean(*powers) for powers in zip(*stages)))


def make_charging_step(rates: Rates[AnyNumber]) -> Step[AnyNumber]:
    """Return one Runge-Kutta step of `make_charging_rates`; its last result is the mean ChargingPowers."""
    return make_runge_kutta_4(rates, _means)
