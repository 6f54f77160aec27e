# SPDX-License-Identifier: Apache-2.0
"""
Vehicles made from another: corrected by factors, with a shell, limited by the coldest cell, fed by the grid.

A car known up to factors is the estimator's part of the model, for every kind of number, like the planner's in
`vehicle.model`: `estimation` uses it with arrays, and the native core is generated from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from operator import mul

from bev_preheat.numerics import AnyNumber, Arithmetic, Curve, CurveFunction, Number
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import DIRECT, HeatSource, Leakage, Vehicle
from bev_preheat.vehicle.model import make_rates

# Results computed from a vehicle are cached for this many: for several cars, as described and as corrected.
KEPT_VEHICLES = 64


@dataclass(frozen=True)
class Corrections:
    """Factors on the vehicle file's values, 1: the file's; floats, or arrays of one shape."""

    heat_capacity: AnyNumber = 1.0
    leakage: AnyNumber = 1.0
    resistance: AnyNumber = 1.0
    heater_efficiency: AnyNumber = 1.0
    # Heat or cold of each watt of other sources, beside the factor of the HVCH.
    source_heat: AnyNumber = 1.0


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
                     efficiency=vehicle.hvch.efficiency * corrections.heater_efficiency),
        heat_sources=tuple(with_heat(source, corrections.source_heat) for source in vehicle.heat_sources))


def with_heat(source: HeatSource, factor: float) -> HeatSource:
    """Return the HeatSource whose heat or cold of a watt is multiplied by a factor."""
    assert isinstance(source.hvch_watts, Table)
    return replace(source, hvch_watts=source.hvch_watts.changed(partial(mul, factor)))


@lru_cache(maxsize=KEPT_VEHICLES)
def without_heat_path(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle whose heat arrives at once; the same object for the same vehicle."""
    return replace(vehicle, heat_path=DIRECT, battery=replace(
        vehicle.battery, heat_capacity_j_per_k=vehicle.pack_heat_capacity_j_per_k))


@lru_cache(maxsize=KEPT_VEHICLES)
def hvch_alone(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle without heat sources beside the HVCH; the same object for the same vehicle."""
    return replace(vehicle, heat_sources=()) if vehicle.heat_sources else vehicle


@lru_cache(maxsize=KEPT_VEHICLES)
def with_sources_at(vehicle: Vehicle, shares: tuple[tuple[str, float], ...]) -> Vehicle:
    """
    Return the Vehicle whose heat sources give shares of their power, by name; 0: none.

    The same object for the same vehicle.
    """
    if not shares:
        return vehicle
    kept, of = [], dict(shares)
    for source in vehicle.heat_sources:
        share, power = of.get(source.name, 1.0), source.maximum_power_w
        if share < 1.0 and isinstance(power, Table):
            power = power.changed(partial(mul, share))
        if share > 0.0:
            kept.append(replace(source, maximum_power_w=power, power_steps_w=tuple(
                share * step_w for step_w in source.power_steps_w)))
    return replace(vehicle, heat_sources=tuple(kept))


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
        battery, capacity_ah=ENDLESS_AH, resistance=Table.constant(NO_RESISTANCE_OHM),
        discharge_power_limit=Table.constant(EVERY_POWER_W), soc_range=(0.0, battery.soc_range[1])))


@dataclass(frozen=True)
class DriveInputs:
    """
    Inputs of the model in one step, before they are summed; floats or arrays.

    `propulsion_power_w` (mean), `power_variance_w2` and `propulsion_power_magnitude_w` (mean of
    |P|) are the route's, as are cabin and auxiliaries.
    `terminal_power_w` is the measured battery power; None if only the route is known. If it is measured,
    `power_variance_w2` is the measured variance, and `hidden_variance_w2` the part of the route's variance
    that the sensors do not show.
    `heater_power_w` is the HVCH power for the battery, `source_heat_w` the heat of other sources as HVCH power. In
    the estimator's inputs that of its own source is missing: it is that of its hypotheses.
    """

    speed_mps: AnyNumber
    ambient_temperature_c: AnyNumber
    propulsion_power_w: AnyNumber
    power_variance_w2: AnyNumber
    propulsion_power_magnitude_w: AnyNumber
    cabin_heating_power_w: AnyNumber
    auxiliary_power_w: AnyNumber
    heater_power_w: AnyNumber
    source_heat_w: AnyNumber = 0.0
    terminal_power_w: AnyNumber = None
    hidden_variance_w2: AnyNumber = 0.0


DriveRates = Callable[[AnyNumber, AnyNumber, Sequence[AnyNumber], DriveInputs],
                      tuple[AnyNumber, AnyNumber, AnyNumber]]
# `mean_magnitude(mean, variance)`: see numerics.
MeanMagnitude = Callable[[AnyNumber, AnyNumber], AnyNumber]


def make_drive_rates(vehicle: Vehicle, arithmetic: Arithmetic[AnyNumber],
                     mean_magnitude: MeanMagnitude) -> DriveRates:
    """
    Return `rates(temperature_c, soc, factors, drive)` -> (dT/dt [K/s], d soc/dt [1/s], Joule heat [W]).

    The factors are those on heat capacity, leakage, resistance, HVCH efficiency, the route's propulsion power, and
    the heat of other sources (below 0: cold), whose electrical power counts as that of consumers. With a measured
    battery power, the propulsion power is that minus all other consumers; else it is the route's times its factor.
    """
    # The heat of other sources is an input.
    known = hvch_alone(vehicle)

    def rates(temperature_c: AnyNumber, soc: AnyNumber, factors: Sequence[AnyNumber],
              drive: DriveInputs) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
        heat_capacity, leakage, resistance, heater_efficiency, propulsion, source_heat = factors
        car = corrected_vehicle(known, Corrections(heat_capacity, leakage, resistance, heater_efficiency))
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
        heat_w = (car.hvch.efficiency * (
            drive.heater_power_w + source_heat * drive.source_heat_w)
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
    steady local rise by Joule heat [K/kW]; the sensor's place above the core, in units of the heat under way.
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
    joule_rise_k_per_kw: AnyNumber
    sensor_place: AnyNumber


LaggingStep = Callable[[Lagging, tuple[AnyNumber, AnyNumber, AnyNumber], AnyNumber, AnyNumber],
                       tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber]]


def make_lagging_step(vehicle: Vehicle) -> LaggingStep:
    """
    Return `step(lagging, rates, heat_capacity, duration_s)`: the moving part of a Lagging at the step's end.

    That is temperature, state of charge, heat under way, sensor and local rise; `rates` are those of
    `make_drive_rates`, in which heat arrives at once, and `heat_capacity` is the factor on the vehicle's. The lags
    are solved within the step (equations in vehicle.heat_path), because they may be shorter.

    The temperature is the core's: all heat but Joule heat is under way until it has arrived there. `vehicle` has
    the heat capacity of shell and core.
    """
    def step(car: Lagging, rates: tuple[AnyNumber, AnyNumber, AnyNumber], heat_capacity: AnyNumber,
             duration_s: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber]:
        temperature_rate, soc_rate, joule_w = rates
        core_j_per_k = vehicle.battery.heat_capacity_j_per_k * (1.0 - vehicle.heat_path.shell_share)
        made_k = duration_s * (
            temperature_rate - joule_w / (core_j_per_k * heat_capacity))
        under_way_k = (car.under_way_k * car.heat_left
                       + made_k * car.heat_lag_s / duration_s * (1.0 - car.heat_left))
        end_c = car.temperature_c + duration_s * temperature_rate - (under_way_k - car.under_way_k)
        # The sensor's place, at the start and at the end.
        start_c = car.temperature_c + car.sensor_place * car.under_way_k
        place_c = end_c + car.sensor_place * under_way_k
        behind_k = (place_c - start_c) * car.sensor_lag_s / duration_s
        sensor_c = place_c - behind_k + (car.sensor_c - start_c + behind_k) * car.sensor_left
        steady_k = 1e-3 * car.joule_rise_k_per_kw * joule_w
        local_k = steady_k + (car.local_k - steady_k) * car.local_left
        return end_c, car.soc + duration_s * soc_rate, under_way_k, sensor_c, local_k

    return step
