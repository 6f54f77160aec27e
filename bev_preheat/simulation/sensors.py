# SPDX-License-Identifier: Apache-2.0
"""The battery as its sensors report it: noisy, in steps, late, or not at all."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from bev_preheat.simulation.vehicle_plant import VehiclePlant

# From, until [s].
Span = tuple[float, float]


@dataclass(frozen=True)
class Sensors:
    """
    How the battery is reported.

    Noise (standard deviations: K, 0 ... 1, V, A) is added before a value is rounded to a multiple of
    its resolution (0: not rounded); the temperature is off by `temperature_offset_k` before that.
    Without `reports_power` voltage and current are not known. A reading is taken every `period_s`
    [s] and arrives `delay_s` [s] later, or with the probability `loss` never. In the spans (from, until)
    [s] of `drop_outs` none is taken, in those of `stuck` the temperature repeats itself, in those of
    `invalid` it is NaN.
    """

    temperature_noise_k: float = 0.0
    temperature_resolution_k: float = 0.0
    temperature_offset_k: float = 0.0
    soc_noise: float = 0.0
    soc_resolution: float = 0.0
    voltage_noise_v: float = 0.0
    current_noise_a: float = 0.0
    reports_power: bool = True
    period_s: float = 1.0
    delay_s: float = 0.0
    loss: float = 0.0
    drop_outs: tuple[Span, ...] = ()
    stuck: tuple[Span, ...] = ()
    invalid: tuple[Span, ...] = ()


@dataclass(frozen=True)
class Reading:
    """
    What the sensors said at an instant [s]: deg C, 0 ... 1, V, A (positive = discharging).

    Voltage and current are None where they are not reported.
    """

    instant_s: float
    temperature_c: float
    soc: float
    voltage_v: float | None
    current_a: float | None


class SensorReadings:
    """Takes Readings of a VehiclePlant, and gives out those that have arrived."""

    def __init__(self, sensors: Sensors, random: np.random.Generator) -> None:
        """`random` is a numpy Generator."""
        self.sensors = sensors
        self._random = random
        self._under_way: deque[Reading] = deque()
        self._stuck_at_c: float | None = None
        self.next_s = 0.0

    def set_period(self, period_s: float, now_s: float) -> None:
        """Take readings this often [s], from now on."""
        self.sensors = _with_period(self.sensors, period_s)
        self.next_s = now_s

    def take(self, plant: VehiclePlant) -> None:
        """Take a reading of a plant; it is due when its time is `next_s` or later."""
        now_s, period_s = plant.time_s, self.sensors.period_s
        # What was missed is not made up for.
        self.next_s += (math.floor((now_s - self.next_s) / period_s) + 1) * period_s
        reading = self.read(plant)
        lost = self.sensors.loss > 0.0 and self._random.random() < self.sensors.loss
        if not lost and not within(now_s, self.sensors.drop_outs):
            self._under_way.append(reading)

    def read(self, plant: VehiclePlant) -> Reading:
        """Return the Reading of a plant now, whether it is due or not."""
        sensors, random, now_s = self.sensors, self._random, plant.time_s
        temperature_c = _measured(
            random, plant.sensor_c + sensors.temperature_offset_k,
            sensors.temperature_noise_k, sensors.temperature_resolution_k)
        if not within(now_s, sensors.stuck):
            self._stuck_at_c = None
        elif self._stuck_at_c is None:
            self._stuck_at_c = temperature_c
        else:
            temperature_c = self._stuck_at_c
        if within(now_s, sensors.invalid):
            temperature_c = math.nan
        soc = _measured(random, plant.soc, sensors.soc_noise, sensors.soc_resolution)
        power: tuple[float | None, float | None] = (None, None)
        if sensors.reports_power:
            power = (_measured(random, plant.terminal_voltage_v, sensors.voltage_noise_v),
                     _measured(random, plant.current_a, sensors.current_noise_a))
        return Reading(now_s, temperature_c, min(max(soc, 0.0), 1.0), *power)

    @property
    def next_arrival_s(self) -> float:
        """When the oldest Reading under way arrives [s]; inf where none is."""
        return (self._under_way[0].instant_s + self.sensors.delay_s if self._under_way
                else math.inf)

    def arrived(self, now_s: float) -> list[Reading]:
        """Return the Readings that have arrived since the last call, oldest first."""
        arrived = []
        while self._under_way and self._under_way[0].instant_s + self.sensors.delay_s <= now_s:
            arrived.append(self._under_way.popleft())
        return arrived


def _with_period(sensors: Sensors, period_s: float) -> Sensors:
    return Sensors(**{**vars(sensors), 'period_s': period_s})


def _measured(random: np.random.Generator, value: float, noise: float,
              resolution: float = 0.0) -> float:
    if noise > 0.0:
        value += noise * random.normal()
    return round(value / resolution) * resolution if resolution > 0.0 else value


def within(instant_s: float, spans: Iterable[Span]) -> bool:
    """Return whether an instant lies in one of the spans (from, until) [s]."""
    for from_s, until_s in spans:
        if from_s <= instant_s < until_s:
            return True
    return False
