# SPDX-License-Identifier: Apache-2.0
"""
Synthetic cars driven by the planner: with the data sheet's vehicle file, the identified one, and the true one.

The plant has equations of its own (`synthetic_car`). The planner is the node's step. It knows the route's
power and gets a battery state every READING_S: whole degrees with noise. The three drives of one route differ
in the vehicle file only; their sensor noise is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.identification.trips import trips_of
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Leakage
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.identification.synthetic_car import (
    AUXILIARY_W,
    COOLANT_J_PER_K,
    CURRENT_NOISE_A,
    draw_car,
    draw_profile,
    record_car,
    SOC_STEP,
    START_SOCS,
    SyntheticPlant,
    TEMPERATURE_NOISE_K,
    TEMPERATURE_STEP_K,
    VOLTAGE_NOISE_V,
    VOLTAGE_SOCS,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from bev_preheat.control.settings import Settings
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat_studies.identification.synthetic_car import DriveProfile, SyntheticCar

DATA_SHEET, IDENTIFIED, TRUE = 'data sheet', 'identified', 'true parameters'
FILES = DATA_SHEET, IDENTIFIED, TRUE
READING_S = 2
START_NS = 10**15
# The target lies between the arrivals without heating and with full heating, at this share of the way.
TARGET_SHARES = 0.3, 0.8
# Drives that would arrive with less charge under full heating are drawn again.
LEAST_ARRIVAL_SOC, MOST_DRAWS = 0.15, 30
# Temperatures [deg C] of the true resistance's table: its denominator becomes 0 near -40 deg C.
TABLE_C = tuple(float(temperature_c) for temperature_c in range(-30, 51))
QUANTILES = 0.05, 0.5, 0.95


@dataclass(frozen=True)
class Drive:
    """
    A drive of one car: its profile, state of charge at the start, and target [deg C].

    `noise` has standard normal numbers of the readings of temperature, voltage and current, shape (N, 3).
    """

    profile: DriveProfile
    soc: float
    target_c: float
    noise: FloatArray


@dataclass(frozen=True)
class DriveResult:
    """
    A drive with a vehicle file of FILES; drives are numbered from 0.

    `arrival_error_k` is the true temperature on arrival above the target [K]; `heater_wh` the heater's energy for
    the battery [Wh]; `switch_ons` counts the rises of the command from 0 W.
    """

    car: int
    drive: int
    file: str
    target_c: float
    arrival_error_k: float
    heater_wh: float
    switch_ons: int


@dataclass(frozen=True)
class FileFigures:
    """
    Figures of a vehicle file over all drives.

    Arrival errors [K]: QUANTILES, the error of the largest magnitude, and the root mean square. `energy_50` and
    `energy_95`: quantiles of the heater energy above that with the true parameters, relative; NaN if those need
    none.
    """

    file: str
    drives: int
    error_5_k: float
    error_50_k: float
    error_95_k: float
    worst_error_k: float
    rms_error_k: float
    energy_50: float
    energy_95: float
    mean_switch_ons: float
    most_switch_ons: int


def vehicle_with_truth(car: SyntheticCar, nominal: Vehicle) -> Vehicle:
    """Return a vehicle file's Vehicle with the true parameters of a synthetic car."""
    battery, drivetrain = nominal.battery, nominal.drivetrain
    losses = 1.0 - drivetrain.efficiency
    return replace(
        nominal, hvch=replace(nominal.hvch, efficiency=car.heater_efficiency),
        heat_path=HeatPath(0.0, COOLANT_J_PER_K, COOLANT_J_PER_K / car.heat_lag_s, car.sensor_lag_s),
        # A drivetrain without losses has no heat to draw a share of.
        drivetrain=replace(drivetrain, heat_recovery_efficiency=car.drivetrain_heat / losses if losses else 0.0),
        battery=replace(
            battery, capacity_ah=car.capacity_ah, heat_capacity_j_per_k=car.heat_capacity_j_per_k,
            open_circuit_voltage=Table(VOLTAGE_SOCS, (20.0,), tuple(
                (voltage_v,) for voltage_v in car.open_circuit_voltage_v)),
            resistance=Table((0.5,), TABLE_C, (tuple(map(car.resistance_at, TABLE_C)),)),
            leakage=Leakage(car.leakage_w_per_k, car.leakage_w_per_k_per_mps)))


def draw_drive(car: SyntheticCar, generator: np.random.Generator) -> Drive:
    """Return a drive whose target the car can reach; raises InvalidInput if the battery is too small for each."""
    for _ in range(MOST_DRAWS):
        profile, soc = draw_profile(generator), float(generator.uniform(*START_SOCS))
        unheated = _arrival(car, profile, soc, 0.0)
        heated = _arrival(car, profile, soc, car.heater_w - car.cabin_w)
        if unheated is not None and heated is not None:
            target_c = unheated.temperature_c + float(generator.uniform(*TARGET_SHARES)) * (
                heated.temperature_c - unheated.temperature_c)
            return Drive(profile, soc, target_c, generator.normal(size=(len(profile.speed_mps), 3)))
    raise InvalidInput(f'--vehicle: none of {MOST_DRAWS} drives of up to an hour leaves '
                       f'{100.0 * LEAST_ARRIVAL_SOC:.0f} % of charge; choose a vehicle with a larger battery')


def _arrival(car: SyntheticCar, profile: DriveProfile, soc: float, heater_w: float) -> SyntheticPlant | None:
    """Return the plant on arrival after constant heating; None if its charge or its power is not enough."""
    plant = SyntheticPlant(car, profile.ambient_c, profile.start_c, soc)
    for propulsion_w, speed_mps in zip(profile.propulsion_w.tolist(), profile.speed_mps.tolist()):
        try:
            plant.advance(propulsion_w, heater_w, car.cabin_w + AUXILIARY_W, speed_mps)
        except InvalidInput:
            return None
        if plant.soc < LEAST_ARRIVAL_SOC:
            return None
    return plant


def route_of(profile: DriveProfile, cabin_w: float) -> Route:
    """Return the Route of a trip planner that knows the drive, in segments of a second."""
    seconds = len(profile.speed_mps)
    return make_route({
        'duration_s': np.ones(seconds), 'speed_mps': profile.speed_mps, 'propulsion_power_w': profile.propulsion_w,
        'ambient_temperature_c': [profile.ambient_c], 'cabin_heating_power_w': [cabin_w],
        'auxiliary_power_w': [AUXILIARY_W]}, None)


def drive_car(car: SyntheticCar, drive: Drive, vehicle: Vehicle, settings: Settings) -> tuple[float, float, int]:
    """
    Return (arrival error [K], heater energy [Wh], number of switch-ons) under the planner with a vehicle file.

    Each command holds until the next battery state.
    """
    profile, supervisor = drive.profile, Supervisor(vehicle, settings)
    mission = Mission('closed loop', (Leg(route_of(profile, car.cabin_w), START_NS, True, drive.target_c),))
    supervisor.step(START_NS, RouteArrived(mission.in_planning_steps(settings.planning_step_s)))
    plant = SyntheticPlant(car, profile.ambient_c, profile.start_c, drive.soc)
    heater_w, heater_wh, switch_ons = 0.0, 0.0, 0
    for second, (propulsion_w, speed_mps) in enumerate(zip(profile.propulsion_w.tolist(),
                                                           profile.speed_mps.tolist())):
        if second % READING_S == 0:
            before_w, heater_w = heater_w, _commanded_w(supervisor, plant, second, drive.noise[second])
            heater_w = min(heater_w, car.heater_w - car.cabin_w)
            switch_ons += heater_w > 0.0 and before_w == 0.0
        plant.advance(propulsion_w, heater_w, car.cabin_w + AUXILIARY_W, speed_mps)
        heater_wh += heater_w / 3600.0
    return plant.temperature_c - drive.target_c, heater_wh, switch_ons


def _commanded_w(supervisor: Supervisor, plant: SyntheticPlant, second: int, noise: FloatArray) -> float:
    """Return the command [W] after the plant's reading."""
    now_ns = START_NS + second * NS_PER_S
    read_c = plant.sensor_c + TEMPERATURE_NOISE_K * noise[0]
    # No power has been drawn at the start.
    electrical = () if second == 0 else (plant.voltage_v + VOLTAGE_NOISE_V * float(noise[1]),
                                         plant.current_a + CURRENT_NOISE_A * float(noise[2]))
    output = supervisor.step(now_ns, BatteryStateArrived(Measurement(
        BatteryState(float(np.round(read_c / TEMPERATURE_STEP_K) * TEMPERATURE_STEP_K),
                     float(np.round(plant.soc / SOC_STEP) * SOC_STEP)), now_ns, *electrical)))
    if output.refusals or output.failure or output.command is None:
        raise RuntimeError(f'the planner gave no command: {output.failure or output.refusals}')
    return output.command.battery_heating_power_w


def study_closed_loop(vehicle_name: str, seed: int, drives: int, heats: bool, settings: Settings,
                      report: Callable[[DriveResult], None]) -> None:
    """
    Identify the synthetic car with a seed and drive it `drives` times with each of FILES.

    The car `heats` on half of its recorded drives, and the planner has `settings` on the new ones. `report` gets
    each DriveResult. The recorded drives and the identified file are those of `study_car`. Raises InvalidInput if
    the logs tell too little, or if the battery is too small for the drives.
    """
    generator, vehicle = np.random.default_rng(seed), load_vehicle(vehicle_name)
    car = draw_car(generator, vehicle)
    # SciPy takes a second to load; drives need it only for the identified file.
    from bev_preheat.identification.identify import identify
    found = identify(vehicle, trips_of(record_car(car, generator, heats), vehicle), f'car {seed}')
    files = {DATA_SHEET: vehicle, IDENTIFIED: found.vehicle, TRUE: vehicle_with_truth(car, vehicle)}
    for number in range(drives):
        # A generator for each drive, so that no drive depends on their number.
        drive = draw_drive(car, np.random.default_rng((seed, number)))
        for result in drive_with_files(car, drive, files, settings):
            report(replace(result, car=seed, drive=number))


def drive_with_files(car: SyntheticCar, drive: Drive, files: Mapping[str, Vehicle],
                     settings: Settings) -> Iterator[DriveResult]:
    """Yield the DriveResult of one drive with each vehicle file by name."""
    for name, vehicle in files.items():
        yield DriveResult(0, 0, name, drive.target_c, *drive_car(car, drive, vehicle, settings))


def closed_loop_summary(results: Iterable[DriveResult]) -> list[FileFigures]:
    """Return the FileFigures of each of FILES over the drives that have a result with every file."""
    by_file: dict[str, dict[tuple[int, int], DriveResult]] = {name: {} for name in FILES}
    for result in results:
        by_file[result.file][result.car, result.drive] = result
    # An interruption may leave a drive without its reference.
    complete = [key for key in by_file[TRUE] if all(key in found for found in by_file.values())]
    return [_figures(name, [found[key] for key in complete], [by_file[TRUE][key] for key in complete])
            for name, found in by_file.items() if complete]


def _figures(name: str, found: list[DriveResult], references: list[DriveResult]) -> FileFigures:
    errors_k = np.array([result.arrival_error_k for result in found])
    relative = [result.heater_wh / reference.heater_wh - 1.0
                for result, reference in zip(found, references) if reference.heater_wh > 0.0] or [math.nan]
    switch_ons = [result.switch_ons for result in found]
    low_k, median_k, high_k = np.quantile(errors_k, QUANTILES).tolist()
    median, high = np.quantile(relative, QUANTILES[1:]).tolist()
    return FileFigures(
        name, len(found), low_k, median_k, high_k, float(errors_k[np.argmax(np.abs(errors_k))]),
        float(np.sqrt(np.mean(errors_k**2))), median, high, float(np.mean(switch_ons)), max(switch_ons))
