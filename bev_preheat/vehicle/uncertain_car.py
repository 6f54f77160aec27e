# SPDX-License-Identifier: Apache-2.0
"""
A car that is known up to factors: its rates in a drive, how late its heat arrives, what its sensor shows.

The estimator's part of the model, for every kind of number, as `vehicle.model` has the planner's:
`estimation` uses it with arrays, and the compiled core is made from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic
from bev_preheat.vehicle.corrections import corrected_vehicle, Corrections
from bev_preheat.vehicle.model import make_rates

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class DriveInputs:
    """
    What the car does in one step, floats or arrays: the inputs of the model before they are summed.

    `propulsion_power_w` (mean), `power_variance_w2` and `propulsion_power_magnitude_w` (mean of
    |P|) are the route's, cabin and auxiliaries too.
    `terminal_power_w` is what the battery was seen to give; None where only the route is known.
    `power_variance_w2` is then what was seen, and `hidden_variance_w2` what the route says of the
    variation and the sensors do not show.
    `heater_power_w` is what the HVCH takes for the battery.
    """

    speed_mps: AnyNumber
    ambient_temperature_c: AnyNumber
    propulsion_power_w: AnyNumber
    power_variance_w2: AnyNumber
    propulsion_power_magnitude_w: AnyNumber
    cabin_heating_power_w: AnyNumber
    auxiliary_power_w: AnyNumber
    heater_power_w: AnyNumber
    terminal_power_w: AnyNumber = None
    hidden_variance_w2: AnyNumber = 0.0


# `rates(temperature_c, soc, factors, drive)` -> (dT/dt [K/s], d soc/dt [1/s], Joule heat [W]).
DriveRates = Callable[[AnyNumber, AnyNumber, Sequence[AnyNumber], DriveInputs],
                      tuple[AnyNumber, AnyNumber, AnyNumber]]
# `mean_magnitude(mean, variance)`: see numerics.folded_normal.
MeanMagnitude = Callable[[AnyNumber, AnyNumber], AnyNumber]


def make_drive_rates(vehicle: Vehicle, arithmetic: Arithmetic[AnyNumber],
                     mean_magnitude: MeanMagnitude) -> DriveRates:
    """
    Return `rates(temperature_c, soc, factors, drive)` -> (dT/dt [K/s], d soc/dt [1/s], Joule heat [W]).

    The factors are those on heat capacity, leakage, resistance, HVCH efficiency and the route's
    propulsion power. Where the battery's power was seen, the propulsion power is what it leaves of it;
    else it is the route's, times its factor.
    """
    def rates(temperature_c: AnyNumber, soc: AnyNumber, factors: Sequence[AnyNumber],
              drive: DriveInputs) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
        heat_capacity, leakage, resistance, heater_efficiency, propulsion = factors
        car = corrected_vehicle(vehicle, Corrections(
            heat_capacity, leakage, resistance, heater_efficiency))
        others_w = drive.cabin_heating_power_w + drive.auxiliary_power_w + drive.heater_power_w
        if drive.terminal_power_w is None:
            propulsion_w = propulsion * drive.propulsion_power_w
            terminal_w = propulsion_w + others_w
            variance_w2 = propulsion * propulsion * drive.power_variance_w2
            magnitude_w = propulsion * drive.propulsion_power_magnitude_w
        else:
            terminal_w = drive.terminal_power_w
            variance_w2 = drive.power_variance_w2 + drive.hidden_variance_w2
            # Of what is hidden the route knows how much of it drives, and how much regenerates.
            hidden = drive.hidden_variance_w2 / arithmetic.maximum(variance_w2, 1.0)
            magnitude_w = (
                (1.0 - hidden) * mean_magnitude(terminal_w - others_w, drive.power_variance_w2)
                + hidden * propulsion * drive.propulsion_power_magnitude_w)
        leakage_w_per_k = car.battery.leakage.coefficient_w_per_k(drive.speed_mps)
        heat_w = (car.hvch.efficiency * drive.heater_power_w
                  + leakage_w_per_k * drive.ambient_temperature_c
                  + car.drivetrain.heat_to_battery_w(magnitude_w))
        soc_rate, temperature_rate, joule_w = make_rates(car, arithmetic)(
            soc, temperature_c, terminal_w, variance_w2, heat_w, leakage_w_per_k)
        return temperature_rate, soc_rate, joule_w

    return rates


@dataclass(frozen=True)
class Lagging:
    """
    What a car shows of its battery, and the lags of that: floats or arrays.

    Temperature [deg C] and state of charge of the battery, heat under way [K], temperature of the sensor's cell
    [deg C], and how much warmer the sensor is than its cell by local heat [K]; the lags of heat and sensor [s];
    the shares left of heat under way, sensor difference and local rise after the step, exp(-duration / lag); the
    factor on the warming by the heater's power, HVCH efficiency over heat capacity; the steady local rise
    by Joule heat and by heater heat [K/kW].
    """

    temperature_c: AnyNumber
    soc: AnyNumber
    under_way_k: AnyNumber
    sensor_c: AnyNumber
    local_k: AnyNumber
    heat_lag_s: AnyNumber
    sensor_lag_s: AnyNumber
    heat_left: AnyNumber
    sensor_left: AnyNumber
    local_left: AnyNumber
    warming: AnyNumber
    joule_rise_k_per_kw: AnyNumber
    heater_rise_k_per_kw: AnyNumber


# `step(lagging, rates, heater_power_w, duration_s)` -> temperature, charge, heat under way, sensor, local rise.
LaggingStep = Callable[[Lagging, tuple[AnyNumber, AnyNumber, AnyNumber], AnyNumber, AnyNumber],
                       tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber]]


def make_lagging_step(vehicle: Vehicle) -> LaggingStep:
    """
    Return `step(lagging, rates, heater_power_w, duration_s)`: what of a Lagging moves, at its end.

    That is temperature, state of charge, heat under way, sensor and local rise; `rates` are those of
    `make_drive_rates`, in which heat arrives at once. The lags are solved within the step
    (vehicle.heat_path has the equations), as they may be shorter.
    """
    def step(car: Lagging, rates: tuple[AnyNumber, AnyNumber, AnyNumber], heater_power_w: AnyNumber,
             duration_s: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber]:
        temperature_rate, soc_rate, joule_w = rates
        made_k = duration_s * (
            car.warming * vehicle.hvch.efficiency / vehicle.battery.heat_capacity_j_per_k
            * heater_power_w)
        under_way_k = (car.under_way_k * car.heat_left
                       + made_k * car.heat_lag_s / duration_s * (1.0 - car.heat_left))
        warmer_k = duration_s * temperature_rate - (under_way_k - car.under_way_k)
        behind_k = warmer_k * car.sensor_lag_s / duration_s
        end_c = car.temperature_c + warmer_k
        sensor_c = end_c - behind_k + (
            car.sensor_c - car.temperature_c + behind_k) * car.sensor_left
        steady_k = 1e-3 * (car.joule_rise_k_per_kw * joule_w
                           + car.heater_rise_k_per_kw * (vehicle.hvch.efficiency * heater_power_w))
        local_k = steady_k + (car.local_k - steady_k) * car.local_left
        return end_c, car.soc + duration_s * soc_rate, under_way_k, sensor_c, local_k

    return step
