# SPDX-License-Identifier: Apache-2.0
"""The battery and the car's position as sensors report them: noisy, quantised, late, wrong, or missing."""
from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.route.segments import Places, Route
from bev_preheat.simulation.traffic import Event, Kind
from bev_preheat.simulation.vehicle_plant import VehiclePlant

# From, until [s].
Span = tuple[float, float]


@dataclass(frozen=True)
class Spike:
    """From one instant to another [s] the temperature reads `by_k` [K] too high."""

    from_s: float
    until_s: float
    by_k: float


@dataclass(frozen=True)
class OtherBattery:
    """Another battery on the topic: alternates with the traction battery's states, first if `is_first`."""

    temperature_c: float
    soc: float
    voltage_v: float
    current_a: float = 0.0
    location: str = ''
    is_first: bool = False


@dataclass(frozen=True)
class Sensors:
    """
    Properties of the battery's signals.

    Noise (standard deviations: K, 0 ... 1, V, A) is added before a value is rounded to a multiple of
    its resolution (0: not rounded); `temperature_offset_k` is added to the temperature before that.
    Without `reports_power` voltage and current are unknown. A reading is taken every `period_s`
    [s] and arrives `delay_s` [s] later, or with the probability `loss` never. In the spans (from, until)
    [s] of `drop_outs` no reading is taken, in those of `stuck` the temperature stays constant, in those of
    `invalid` it is NaN.

    Wrong from start to end: `temperature_stuck_at_c` [deg C], `soc_stuck_at` (0 ... 1) and
    `voltage_stuck_at_v` [V] replace the measured values; state of charge and voltage are multiplied by
    `soc_scale` and `voltage_scale`; `reverses_current` shows discharging as charging.
    Every `invalid_every`-th temperature is NaN, every `reordered_every`-th reading arrives after its
    successor (0: never). power_supply_status comes from no source (`supply_status` 'unknown'), from the plug
    ('plugged') or from the sign of the current ('sign'); `location` is that field of the battery states, and
    `other` a second battery on the topic.
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
    spikes: tuple[Spike, ...] = ()
    invalid_every: int = 0
    reordered_every: int = 0
    temperature_stuck_at_c: float | None = None
    soc_stuck_at: float | None = None
    soc_scale: float = 1.0
    voltage_stuck_at_v: float | None = None
    voltage_scale: float = 1.0
    reverses_current: bool = False
    supply_status: str = 'unknown'
    location: str = ''
    other: OtherBattery | None = None


@dataclass(frozen=True)
class Reading:
    """A reading at an instant [s]: deg C, 0 ... 1, V, A (positive = discharging); None, '': not reported."""

    instant_s: float
    temperature_c: float
    soc: float
    voltage_v: float | None
    current_a: float | None
    supply_status: SupplyStatus = SupplyStatus.UNKNOWN
    location: str = ''


class SensorReadings:
    """Takes Readings of a VehiclePlant, and returns those that have arrived."""

    def __init__(self, sensors: Sensors, random: np.random.Generator) -> None:
        self.sensors = sensors
        self._random = random
        self._under_way: deque[Reading] = deque()
        self._stuck_at_c: float | None = None
        self._taken = 0
        # A Reading overtaken by its successor.
        self._held_back: Reading | None = None
        self.next_s = 0.0

    def set_period(self, period_s: float, now_s: float) -> None:
        """Take readings at this interval [s] from now on."""
        self.sensors = replace(self.sensors, period_s=period_s)
        self.next_s = now_s

    def take(self, plant: VehiclePlant, is_charging: bool = False) -> None:
        """Take a reading of a plant, at a charger or not, if it is due (`next_s` reached)."""
        now_s, period_s = plant.time_s, self.sensors.period_s
        # Missed readings are not repeated.
        self.next_s += (math.floor((now_s - self.next_s) / period_s) + 1) * period_s
        reading = self.read(plant, is_charging)
        lost = self.sensors.loss > 0.0 and self._random.random() < self.sensors.loss
        if not lost and not within(now_s, self.sensors.drop_outs):
            self._send(reading)

    def _send(self, reading: Reading) -> None:
        """Send a Reading; another battery may replace it, or its successor overtake it."""
        sensors = self.sensors
        self._taken += 1
        if sensors.invalid_every > 0 and self._taken % sensors.invalid_every == 0:
            reading = replace(reading, temperature_c=math.nan)
        other = sensors.other
        if other is not None and self._taken % 2 == (1 if other.is_first else 0):
            temperature_c = _measured(
                self._random, other.temperature_c, sensors.temperature_noise_k, sensors.temperature_resolution_k)
            reading = Reading(reading.instant_s, temperature_c, other.soc, other.voltage_v, other.current_a,
                              location=other.location)
        held_back, self._held_back = self._held_back, None
        if sensors.reordered_every > 0 and self._taken % sensors.reordered_every == 0:
            self._held_back = reading
        else:
            self._under_way.append(reading)
        if held_back is not None:
            self._under_way.append(held_back)

    def read(self, plant: VehiclePlant, is_charging: bool = False) -> Reading:
        """Return a Reading of a plant now, at a charger or not, whether or not one is due."""
        sensors, random, now_s = self.sensors, self._random, plant.time_s
        spike_k = sum(spike.by_k for spike in sensors.spikes if spike.from_s <= now_s < spike.until_s)
        temperature_c = _measured(random, plant.sensor_c + sensors.temperature_offset_k + spike_k,
                                  sensors.temperature_noise_k, sensors.temperature_resolution_k)
        if not within(now_s, sensors.stuck):
            self._stuck_at_c = None
        elif self._stuck_at_c is None:
            self._stuck_at_c = temperature_c
        else:
            temperature_c = self._stuck_at_c
        if sensors.temperature_stuck_at_c is not None:
            temperature_c = sensors.temperature_stuck_at_c
        if within(now_s, sensors.invalid):
            temperature_c = math.nan
        soc = min(max(_measured(random, plant.soc, sensors.soc_noise, sensors.soc_resolution), 0.0), 1.0)
        if sensors.soc_stuck_at is not None:
            soc = sensors.soc_stuck_at
        power: tuple[float | None, float | None] = (None, None)
        if sensors.reports_power:
            voltage_v = _measured(random, plant.terminal_voltage_v, sensors.voltage_noise_v)
            current_a = _measured(random, plant.current_a, sensors.current_noise_a)
            if sensors.voltage_stuck_at_v is not None:
                voltage_v = sensors.voltage_stuck_at_v
            power = (sensors.voltage_scale * voltage_v, -current_a if sensors.reverses_current else current_a)
        return Reading(now_s, temperature_c, sensors.soc_scale * soc, *power,
                       _supply_status(sensors.supply_status, is_charging, plant.current_a), sensors.location)

    @property
    def next_arrival_s(self) -> float:
        """Return the arrival of the oldest Reading on its way [s]; inf without one."""
        return self._under_way[0].instant_s + self.sensors.delay_s if self._under_way else math.inf

    def arrived(self, now_s: float) -> list[Reading]:
        """Return the Readings that have arrived since the last call, oldest first."""
        arrived = []
        while self.next_arrival_s <= now_s:
            arrived.append(self._under_way.popleft())
        return arrived


def _supply_status(kind: str, is_charging: bool, current_a: float) -> SupplyStatus:
    """Return power_supply_status for a `kind` of Sensors; regeneration has the sign of charging."""
    if kind == 'unknown':
        return SupplyStatus.UNKNOWN
    is_charging = is_charging if kind == 'plugged' else current_a < 0.0
    return SupplyStatus.CHARGING if is_charging else SupplyStatus.DISCHARGING


def _measured(random: np.random.Generator, value: float, noise: float, resolution: float = 0.0) -> float:
    if noise > 0.0:
        value += noise * random.normal()
    return round(value / resolution) * resolution if resolution > 0.0 else value


def within(instant_s: float, spans: Iterable[Span]) -> bool:
    """Return whether an instant lies in one of the spans (from, until) [s]."""
    return any(from_s <= instant_s < until_s for from_s, until_s in spans)


@dataclass(frozen=True)
class PositionReports:
    """Reports every `period_s` [s], with noise (deviation [m]), none in the spans [s] of `drop_outs`."""

    period_s: float = 1.0
    noise_m: float = 0.0
    drop_outs: tuple[Span, ...] = ()


class Position:
    """Reported distances along the route sent last, none after a detour; instants of the drive [s]."""

    def __init__(self, reports: PositionReports | None, driven: Route, events: Sequence[Event],
                 random: np.random.Generator) -> None:
        """Start with the Route actually driven; `reports` None: no reports."""
        self._reports, self._random = reports, random
        self._places = Places.of_route(driven)
        self._detours_s = [event.at_s for event in events if event.kind is Kind.DETOUR]
        self._begins_s = 0.0
        self._count = 0

    def begin_route(self, at_s: float) -> None:
        """Restart at the car's place at an instant [s], where a newly sent route begins."""
        self._begins_s = at_s

    @property
    def next_s(self) -> float:
        """Instant of the next report [s]; inf: never."""
        # Multiples of the period, because sums would drift from the battery states' instants.
        return math.inf if self._reports is None else self._count * self._reports.period_s

    def report_m(self, now_s: float) -> float | None:
        """Return the distance reported now [m]; None if no report is due, or the place is unknown."""
        if self._reports is None or now_s < self.next_s:
            return None
        # Missed reports are not repeated.
        self._count = math.floor(now_s / self._reports.period_s + 1e-9) + 1
        noise_m = self._reports.noise_m * self._random.normal()
        is_lost = any(self._begins_s < detour_s <= now_s for detour_s in self._detours_s)
        if is_lost or within(now_s, self._reports.drop_outs):
            return None
        return max(0.0, self._places.distance_at_m(now_s)
                   - self._places.distance_at_m(self._begins_s) + noise_m)
