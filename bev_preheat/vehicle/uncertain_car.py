# SPDX-License-Identifier: Apache-2.0
"""
A car known up to factors: its rates in a drive, the lags of its heat, the reading of its sensor.

The estimator's part of the model, for every kind of number, like the planner's in `vehicle.model`:
`estimation` uses it with arrays, and the native core is generated from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic
from bev_preheat.vehicle.model import make_rates
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class DriveInputs:
    """
    Inputs of the model in one step, before they are summed; floats or arrays.

    `propulsion_power_w` (mean), `power_variance_w2` and `propulsion_power_magnitude_w` (mean of
    |P|) are the route's, as are cabin and auxiliaries.
    `terminal_power_w` is the measured battery power; None if only the route is known. If it is measured,
    `power_variance_w2` is the measured variance, and `hidden_variance_w2` the part of the route's variance
    that the sensors do not show.
    `heater_power_w` is the HVCH power for the battery.
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
    propulsion power. With a measured battery power, the propulsion power is that minus all other consumers;
    else it is the route's, times its factor.
    """
    def rates(temperature_c: AnyNumber, soc: AnyNumber, factors: Sequence[AnyNumber],
              drive: DriveInputs) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
        heat_capacity, leakage, resistance, heater_efficiency, propulsion = factors
        car = corrected_vehicle(vehicle, Corrections(heat_capacity, leakage, resistance, heater_efficiency))
        others_w = drive.cabin_heating_power_w + drive.auxiliary_power_w + drive.heater_power_w
        if drive.terminal_power_w is None:
            propulsion_w = propulsion * drive.propulsion_power_w
            terminal_w = propulsion_w + others_w
            variance_w2 = propulsion * propulsion * drive.power_variance_w2
            magnitude_w = propulsion * drive.propulsion_power_magnitude_w
        else:
            terminal_w = drive.terminal_power_w
            variance_w2 = drive.power_variance_w2 + drive.hidden_variance_w2
            # The route gives the driving and regenerating shares of the hidden variation.
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
    Battery state, sensor and their lags; floats or arrays.

    Temperature [deg C] and state of charge of the battery, heat under way [K], temperature of the sensor's cell
    [deg C], and the sensor's local rise above its cell [K]; the lags of heat and sensor [s];
    the shares of heat under way, sensor difference and local rise left after the step, exp(-duration / lag); the
    temperature rise per heater energy, HVCH efficiency over heat capacity; the steady local rise
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
    Return `step(lagging, rates, heater_power_w, duration_s)`: the moving part of a Lagging at the step's end.

    That is temperature, state of charge, heat under way, sensor and local rise; `rates` are those of
    `make_drive_rates`, in which heat arrives at once. The lags are solved within the step (equations in
    vehicle.heat_path), because they may be shorter.

    The temperature of a battery with a shell is the core's, and the heat under way that in the shell: all heat but
    Joule heat, until it has arrived. `vehicle` has the heat capacity of both.
    """
    def step(car: Lagging, rates: tuple[AnyNumber, AnyNumber, AnyNumber], heater_power_w: AnyNumber,
             duration_s: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber]:
        temperature_rate, soc_rate, joule_w = rates
        made_k = duration_s * (
            car.warming * vehicle.hvch.efficiency / vehicle.battery.heat_capacity_j_per_k
            * heater_power_w)
        if vehicle.heat_path.is_shell:
            made_k = duration_s * (temperature_rate - joule_w / vehicle.battery.heat_capacity_j_per_k)
        under_way_k = (car.under_way_k * car.heat_left
                       + made_k * car.heat_lag_s / duration_s * (1.0 - car.heat_left))
        warmer_k = duration_s * temperature_rate - (under_way_k - car.under_way_k)
        end_c = car.temperature_c + warmer_k
        # The sensor's place, at the start and at the end.
        start_c, place_c, risen_k = car.temperature_c, end_c, warmer_k
        if vehicle.heat_path.is_shell:
            rise = vehicle.heat_path.sensor_rise
            start_c, place_c = start_c + rise * car.under_way_k, end_c + rise * under_way_k
            risen_k = place_c - start_c
        behind_k = risen_k * car.sensor_lag_s / duration_s
        sensor_c = place_c - behind_k + (car.sensor_c - start_c + behind_k) * car.sensor_left
        steady_k = 1e-3 * (car.joule_rise_k_per_kw * joule_w
                           + car.heater_rise_k_per_kw * (vehicle.hvch.efficiency * heater_power_w))
        local_k = steady_k + (car.local_k - steady_k) * car.local_left
        return end_c, car.soc + duration_s * soc_rate, under_way_k, sensor_c, local_k

    return step
