# SPDX-License-Identifier: Apache-2.0
"""A simulated car, driven second by second, and its sensors."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from bev_preheat.control.inputs import Measurement
from bev_preheat.estimation.estimate import DriveInputs
from bev_preheat.estimation.estimator import DrivenInterval
from bev_preheat.numerics import FLOATS, NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.model import make_rates
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

VEHICLE = load_vehicle('reference')
CABIN_W, AUXILIARY_W, AMBIENT_C, SPEED_MPS = 1400.0, 500.0, -10.0, 24.0
LIMIT_W = VEHICLE.hvch.maximum_power_w - CABIN_W
PROPULSION_W = 16e3
START_NS = 1000 * NS_PER_S
# The route is constant, and has no end.
DRIVE = DriveInputs(SPEED_MPS, AMBIENT_C, PROPULSION_W, 0.0, abs(PROPULSION_W), CABIN_W, AUXILIARY_W, 0.0)


class Commands:
    """Full power from an instant to another [s]."""

    def __init__(self, on_s=()):
        self.on_s = on_s

    def at_w(self, second):
        return LIMIT_W if any(start <= second < end for start, end in self.on_s) else 0.0

    def mean_w(self, from_ns, to_ns):
        from_s, to_s = ((at_ns - START_NS) / NS_PER_S for at_ns in (from_ns, to_ns))
        if to_s <= from_s:
            return self.at_w(to_s)
        on_s = sum(max(0.0, min(end, to_s) - max(start, from_s)) for start, end in self.on_s)
        return LIMIT_W * on_s / (to_s - from_s)


def observed(estimator, measurement, commands, drive=DRIVE, vehicle=VEHICLE):
    """Return the Estimator after a MeasuredState on the route under Commands."""
    return estimator.observed(measurement, [
        DrivenInterval((to_ns - from_ns) / NS_PER_S, drive, commands.mean_w(from_ns, to_ns), LIMIT_W)
        for from_ns, to_ns in pairwise(estimator.edges_ns(measurement.stamp_ns))], vehicle)


@dataclass
class DrivenCar:
    """
    The true car. `heater` maps (second, commanded power) to the heater's power [W].

    Traffic varies the power by `traffic_w` (standard deviation, correlated over half a minute). The sensor's
    place is warmer than the battery by `local_k` (standard deviation, correlated over 100 s), by
    `rise_k_per_kw` of Joule heat, with a lag of 100 s, and by `place` times the warming still under way. Heat lags
    by `heat_lag_s`, the sensor by `sensor_lag_s`. `source_w` are another source's electrical power, and its
    heat as HVCH power [W].
    """

    corrections: Corrections = Corrections()
    temperature_c: float = -6.0
    soc: float = 0.8
    traffic_w: float = 2000.0
    commands: Commands = field(default_factory=Commands)
    heater: object = staticmethod(lambda second, commanded_w: commanded_w)
    noise_k: float = 0.2
    step_k: float = 1.0
    local_k: float = 0.0
    rise_k_per_kw: float = 0.0
    place: float = 0.0
    heat_lag_s: float = 0.0
    sensor_lag_s: float = 0.0
    source_w: tuple[float, float] = (0.0, 0.0)
    seed: int = 0
    with_power: bool = True
    second: int = 0

    def __post_init__(self):
        self._car = corrected_vehicle(VEHICLE, self.corrections)
        self._rates = make_rates(self._car, FLOATS)
        self._drawn = np.random.default_rng(self.seed)
        self._extra_w = self._local_k = self._arriving_w = 0.0
        self._sensor_c = self.temperature_c
        self._drawn_locally = np.random.default_rng([self.seed, 1])

    def drive(self, seconds=1):
        """Drive on for some seconds, and return the MeasuredState at their end."""
        for _ in range(seconds):
            self._extra_w += -self._extra_w / 30.0 + self.traffic_w * np.sqrt(
                2 / 30.0) * self._drawn.standard_normal()
            heater_w = self.heater(self.second, self.commands.at_w(self.second))
            propulsion_w = PROPULSION_W + self._extra_w
            terminal_w = propulsion_w + CABIN_W + AUXILIARY_W + heater_w + self.source_w[0]
            gamma = self._car.battery.leakage.coefficient_w_per_k(SPEED_MPS)
            made_w = self._car.hvch.efficiency * (heater_w + self.source_w[1])
            self._arriving_w += (made_w - self._arriving_w) / max(1.0, self.heat_lag_s)
            heat_w = (self._arriving_w + gamma * AMBIENT_C
                      + self._car.drivetrain.heat_to_battery_w(abs(propulsion_w)))
            soc_rate, temperature_rate, joule_w = self._rates(
                self.soc, self.temperature_c, terminal_w, 0.0, heat_w, gamma)
            self.soc += soc_rate
            self.temperature_c += temperature_rate
            under_way_k = self.heat_lag_s * self._arriving_w / self._car.pack_heat_capacity_j_per_k
            self._sensor_c += (self.temperature_c + self.place * under_way_k - self._sensor_c) / max(
                1.0, self.sensor_lag_s)
            steady_k = 1e-3 * self.rise_k_per_kw * joule_w
            self._local_k += (steady_k - self._local_k) / 100.0 + self.local_k * np.sqrt(
                2 / 100.0) * self._drawn_locally.standard_normal()
            self.second += 1
        seen_c = self._sensor_c + self._local_k + self.noise_k * self._drawn.standard_normal()
        if self.step_k:
            seen_c = round(seen_c / self.step_k) * self.step_k
        return Measurement(
            BatteryState(float(seen_c), float(round(self.soc, 3))), START_NS + self.second * NS_PER_S,
            *((float(terminal_w / 400.0), 400.0) if self.with_power else ()))
