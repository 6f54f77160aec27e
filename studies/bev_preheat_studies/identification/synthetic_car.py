# SPDX-License-Identifier: Apache-2.0
"""
Synthetic cars and their logs: equations of their own, integrated second by second, none of the product's model.

A car has one thermal mass, heater, coolant and sensor with lags. Its parameters are drawn around those of a
vehicle file.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.numerics import FLOATS

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.vehicle.description import Vehicle

HOUR_S = 3600
DRIVES, NIGHTS = 8, 2
NIGHT_H = 8
COOLANT_J_PER_K = 15e3
AUXILIARY_W = 500.0
START_SOCS = 0.75, 0.95
# Noise of the sensors (standard deviations), and the step of the temperature signal.
TEMPERATURE_NOISE_K, TEMPERATURE_STEP_K = 0.2, 1.0
VOLTAGE_NOISE_V, CURRENT_NOISE_A = 0.2, 0.3
SOC_STEP = 0.005
LEAST_SOC = 0.08
VOLTAGE_SOCS = tuple(number / 10.0 for number in range(11))


@dataclass(frozen=True)
class SyntheticCar:
    """
    True parameters in SI units.

    `resistance_ohm` at 10 deg C falls with `resistance_reference_c`; voltages are those at VOLTAGE_SOCS.
    """

    heat_capacity_j_per_k: float
    leakage_w_per_k: float
    leakage_w_per_k_per_mps: float
    drivetrain_heat: float
    heater_efficiency: float
    resistance_ohm: float
    resistance_reference_c: float
    heat_lag_s: float
    sensor_lag_s: float
    capacity_ah: float
    open_circuit_voltage_v: tuple[float, ...]
    cabin_w: float
    heater_w: float

    def resistance_at(self, temperature_c: float) -> float:
        """Return the resistance [ohm] at a temperature [deg C]."""
        reference_c = self.resistance_reference_c
        return self.resistance_ohm * (10.0 + reference_c) / (temperature_c + reference_c)


def draw_car(generator: np.random.Generator, nominal: Vehicle) -> SyntheticCar:
    """
    Return a car around the values of a vehicle file, within the spreads of the robustness studies.

    Heat capacity +-10 %, leakage +-20 %, resistance +-20 %, heater efficiency +-5 %; drivetrain heat +-30 %.
    """
    def within(nominal: float, share: float) -> float:
        return float(nominal * generator.uniform(1.0 - share, 1.0 + share))

    battery, leakage = nominal.battery, within(1.0, 0.2)
    ohm = battery.resistance.function(FLOATS)(0.5, 10.0)
    # k/(T + T_ref) through the file's values at 0 and 20 deg C.
    ratio = battery.resistance.function(FLOATS)(0.5, 0.0) / battery.resistance.function(FLOATS)(0.5, 20.0)
    voltages_v = [battery.open_circuit_voltage.function(FLOATS)(soc, 20.0) for soc in VOLTAGE_SOCS]
    shift_v = float(generator.uniform(-0.01, 0.01)) * voltages_v[0]
    return SyntheticCar(
        within(battery.heat_capacity_j_per_k, 0.1), battery.leakage.gamma_0_w_per_k * leakage,
        battery.leakage.gamma_v_w_per_k_per_mps * leakage, within(nominal.drivetrain.heat_share, 0.3),
        min(within(nominal.hvch.efficiency, 0.05), 0.99), within(ohm, 0.2), within(20.0 / (ratio - 1.0), 0.1),
        within(60.0, 0.3), within(20.0, 0.5), within(battery.capacity_ah, 0.03),
        tuple(voltage_v + shift_v for voltage_v in voltages_v), nominal.defaults.cabin_heating_power_w,
        nominal.hvch.maximum_power_w)


class SyntheticPlant:
    """
    A SyntheticCar on the road, integrated second by second.

    `soc` is 0 ... 1, `temperature_c` and `sensor_c` [deg C] are those of battery and sensor; voltage [V] and
    current [A] are those of the latest second.
    """

    def __init__(self, car: SyntheticCar, ambient_c: float, start_c: float, soc: float) -> None:
        """Start with everything at `start_c` [deg C]; `soc` is 0 ... 1."""
        self._car, self._ambient_c = car, ambient_c
        self.soc, self.temperature_c, self.sensor_c = soc, start_c, start_c
        self.voltage_v = self._open_circuit_voltage_v()
        self.current_a = self._coolant_k = 0.0

    def _open_circuit_voltage_v(self) -> float:
        # An interpolation in lists is ten times faster than NumPy's for one number.
        points_v = self._car.open_circuit_voltage_v
        at = min(max(int(self.soc / 0.1), 0), len(points_v) - 2)
        return points_v[at] + (self.soc - 0.1 * at) / 0.1 * (points_v[at + 1] - points_v[at])

    def advance(self, propulsion_w: float, heater_w: float, other_w: float, speed_mps: float) -> None:
        """Drive a second; `other_w` [W] is for cabin and auxiliaries. Raises InvalidInput for too much power."""
        car, open_v, ohm = self._car, self._open_circuit_voltage_v(), self._car.resistance_at(self.temperature_c)
        power_w = propulsion_w + heater_w + other_w
        under_root = open_v**2 - 4.0 * ohm * power_w
        if under_root < 0.0:
            raise InvalidInput(
                f'--vehicle: the drive takes {power_w / 1000.0:.0f} kW; the battery delivers at most '
                f'{open_v**2 / (4000.0 * ohm):.0f} kW at {self.temperature_c:.0f} degC; choose a vehicle with a '
                'smaller resistance')
        self.current_a = (open_v - math.sqrt(under_root)) / (2.0 * ohm)
        self.voltage_v = open_v - ohm * self.current_a
        # Heat of the coolant above the battery's temperature reaches the battery with a lag.
        conducted_w = COOLANT_J_PER_K / car.heat_lag_s * self._coolant_k
        rate = (ohm * self.current_a**2 + car.drivetrain_heat * abs(propulsion_w) + conducted_w
                + (car.leakage_w_per_k + car.leakage_w_per_k_per_mps * speed_mps)
                * (self._ambient_c - self.temperature_c)) / car.heat_capacity_j_per_k
        self._coolant_k += (car.heater_efficiency * heater_w - conducted_w) / COOLANT_J_PER_K - rate
        # The sensor follows the second's mean temperature.
        self.temperature_c += rate
        self.sensor_c += -math.expm1(-1.0 / car.sensor_lag_s) * (self.temperature_c - 0.5 * rate - self.sensor_c)
        self.soc -= self.current_a / (3600.0 * car.capacity_ah)


@dataclass(frozen=True)
class DriveProfile:
    """A drive by seconds: speed and drivetrain power, shape (N,); the air, and the battery at the start."""

    speed_mps: FloatArray
    propulsion_w: FloatArray
    ambient_c: float
    start_c: float


def record_car(car: SyntheticCar, generator: np.random.Generator, heats: bool = True) -> list[Recording]:
    """Return the Recordings of a car: drives, every other one with the heater on if it `heats`, and nights."""
    logs = [_drive(car, generator, f'drive {number + 1}', heats and number % 2 == 1) for number in range(DRIVES)]
    return logs + [_night(car, generator, f'night {number + 1}') for number in range(NIGHTS)]


def _drive(car: SyntheticCar, generator: np.random.Generator, name: str, is_heated: bool) -> Recording:
    profile = draw_profile(generator)
    seconds = len(profile.speed_mps)
    heater_w = np.zeros(seconds)
    if is_heated:
        begins_s = int(generator.uniform(0.0, 0.5) * seconds)
        heater_w[begins_s:begins_s + int(generator.uniform(0.3, 0.5) * seconds)] = (
            generator.uniform(0.5, 0.8) * max(car.heater_w - car.cabin_w, 1000.0))
    return _record(car, generator, name, profile, heater_w, car.cabin_w, AUXILIARY_W, 1)


def draw_profile(generator: np.random.Generator) -> DriveProfile:
    """Return a drive of half an hour to an hour, with hills, in air of -15 ... 8 deg C."""
    seconds = int(generator.uniform(0.5, 1.0) * HOUR_S)
    ambient_c = float(generator.uniform(-15.0, 8.0))
    start_c = ambient_c + float(generator.uniform(0.0, 8.0))
    speed_mps = _speed_mps(generator, seconds)
    acceleration = np.diff(speed_mps, append=speed_mps[-1])
    force_n = (2200.0 * 9.81 * 0.011 * (speed_mps > 0.1) + 0.5 * 1.25 * 0.8 * speed_mps**2 + 2200.0 * acceleration
               + 2200.0 * 9.81 * 0.01 * np.cumsum(generator.normal(0.0, 0.02, seconds)))
    wheel_w = force_n * speed_mps
    propulsion_w = np.clip(np.where(wheel_w > 0.0, wheel_w / 0.88, 0.7 * wheel_w), -60e3, 150e3)
    return DriveProfile(speed_mps, propulsion_w, ambient_c, start_c)


def _speed_mps(generator: np.random.Generator, seconds: int) -> FloatArray:
    """Return a speed with stops, town and motorway [m/s]."""
    levels: list[float] = []
    while len(levels) < seconds:
        fast = generator.random() < 0.4
        lasts_s = int(generator.uniform(60.0, 400.0) if fast else generator.uniform(20.0, 90.0))
        levels += [float(generator.uniform(22.0, 36.0) if fast else generator.choice([0.0, 8.0, 14.0]))] * lasts_s
    wanted = np.array(levels[:seconds])
    speed = np.zeros(seconds)
    for at in range(1, seconds):
        speed[at] = max(0.0, speed[at - 1] + np.clip(0.2 * (wanted[at] - speed[at - 1]), -2.0, 1.8))
    speed[-20:] *= np.linspace(1.0, 0.0, 20)
    return speed


def _night(car: SyntheticCar, generator: np.random.Generator, name: str) -> Recording:
    seconds = NIGHT_H * HOUR_S
    ambient_c = float(generator.uniform(-15.0, 5.0))
    zero = np.zeros(seconds)
    start_c = ambient_c + float(generator.uniform(12.0, 25.0))
    return _record(car, generator, name, DriveProfile(zero, zero, ambient_c, start_c), zero, 0.0, 20.0, 60)


def _record(car: SyntheticCar, generator: np.random.Generator, name: str, profile: DriveProfile,
            heater_w: FloatArray, cabin_w: float, auxiliary_w: float, every_s: int) -> Recording:
    """Integrate a trip second by second, and return its log with one sample every `every_s`."""
    plant = SyntheticPlant(car, profile.ambient_c, profile.start_c, float(generator.uniform(*START_SOCS)))
    columns: list[tuple[float, ...]] = []
    for propulsion, heater, speed in zip(profile.propulsion_w.tolist(), heater_w.tolist(),
                                         profile.speed_mps.tolist()):
        before = plant.sensor_c, plant.soc
        plant.advance(propulsion, heater, cabin_w + auxiliary_w, speed)
        columns.append((*before, plant.voltage_v, plant.current_a))
        if plant.soc < LEAST_SOC:
            # The drive ends at a charger.
            break
    sensor, charge, voltage_v, current = np.array(columns)[::every_s].T
    count = len(sensor)
    time_s = np.arange(0.0, len(columns), every_s)
    read_c = sensor + generator.normal(0.0, TEMPERATURE_NOISE_K, count)
    means = {
        'battery_temperature_c': np.round(read_c / TEMPERATURE_STEP_K) * TEMPERATURE_STEP_K,
        'soc': np.round(charge / SOC_STEP) * SOC_STEP,
        'voltage_v': voltage_v + generator.normal(0.0, VOLTAGE_NOISE_V, count),
        'current_a': current + generator.normal(0.0, CURRENT_NOISE_A, count),
        'speed_mps': profile.speed_mps[:len(columns):every_s], 'ambient_c': np.full(count, profile.ambient_c),
        'battery_heater_w': heater_w[:len(columns):every_s], 'cabin_heater_w': np.full(count, cabin_w),
        'auxiliary_w': np.full(count, auxiliary_w)}
    return Recording(name, {key: Series(time_s, values) for key, values in means.items()})
