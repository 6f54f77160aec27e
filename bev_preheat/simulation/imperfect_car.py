# SPDX-License-Identifier: Apache-2.0
"""A simulated car that differs from its vehicle file, in traffic, seen through its sensors."""
from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.control.inputs import Leg, Mission, Progress
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import Route
from bev_preheat.simulation.heater import fault_at, HeaterFault, HeaterLease, next_change_s
from bev_preheat.simulation.phases import Charge, DrivePhase, Phase
from bev_preheat.simulation.sensors import Position, Reading, SensorReadings, Sensors
from bev_preheat.simulation.traffic import (
    clock_offset_s,
    ClockJump,
    drive_with_events,
    TrafficNews,
    vary,
    with_cycles,
)
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.vehicle.description import HeatPath, Vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, with_heat


@dataclass(frozen=True)
class Mismatch:
    """
    The true car and drive, as multiples of the values in vehicle and route file.

    `heater` is a factor on the efficiency of the HVCH, `sources` on the heat of others;
    `propulsion_power_variability` is the standard deviation of the logarithm of a factor that varies about 1 from
    segment to segment. With `visible_variation` the power variation within a segment takes place over seconds, so
    that the sensors see it; without, it is a ripple too fast for them.
    """

    heat_capacity: float = 1.0
    leakage: float = 1.0
    resistance: float = 1.0
    heater: float = 1.0
    sources: float = 1.0
    propulsion_power: float = 1.0
    propulsion_power_variability: float = 0.0
    visible_variation: bool = False


def true_vehicle(vehicle: Vehicle, mismatch: Mismatch, heat_path: HeatPath | None) -> Vehicle:
    """Return the true Vehicle, with a HeatPath; None: its own."""
    factors = (mismatch.heat_capacity, mismatch.leakage, mismatch.resistance, mismatch.heater)
    if factors != (1.0,) * 4:
        vehicle = corrected_vehicle(vehicle, Corrections(*factors))
    if mismatch.sources != mismatch.heater:
        # All heat has the heater's factor.
        vehicle = replace(vehicle, heat_sources=tuple(
            with_heat(source, mismatch.sources / mismatch.heater) for source in vehicle.heat_sources))
    if heat_path is None or heat_path == vehicle.heat_path:
        return vehicle
    return replace(vehicle, heat_path=heat_path)


def true_route(route: Route, mismatch: Mismatch, random: np.random.Generator) -> Route:
    """Return the Route as driven: other propulsion power, same speed and times."""
    route = route.with_propulsion(vary(
        random, len(route), mismatch.propulsion_power, mismatch.propulsion_power_variability))
    return with_cycles(route) if mismatch.visible_variation else route


@dataclass(frozen=True)
class Imperfections:
    """The deviations of a drive from the files; `heat_path` None: that of the vehicle file."""

    mismatch: Mismatch = field(default_factory=Mismatch)
    heat_path: HeatPath | None = None
    sensors: Sensors = field(default_factory=Sensors)
    heater_faults: tuple[HeaterFault, ...] = ()
    clock_jumps: tuple[ClockJump, ...] = ()


# The car's computers fall asleep this long after the last battery state [s].
COMPUTERS_GO_ON_S = 60.0


@dataclass(frozen=True)
class PhaseReport:
    """A Phase's instants [s], battery at its end, heater's energy [Wh], and whether the battery ran empty."""

    phase: Phase
    started_s: float
    ended_s: float
    temperature_c: float
    soc: float
    heating_energy_wh: float
    ran_empty: bool

    @property
    def arrival_c(self) -> float:
        """The battery's temperature at the end of a drive [deg C]; NaN without an arrival."""
        return self.temperature_c if isinstance(self.phase, DrivePhase) and not self.ran_empty else math.nan


class _Letter(NamedTuple):
    """A message of the trip planner, due at `at_s` [s], about a Drive that begins at `begins_s` [s]."""

    at_s: float
    begins_s: float
    drive: DrivePhase
    news: TrafficNews
    route_id: str


class ImperfectCar:
    """
    A car on its way, through one phase or several.

    `vehicle` is the nominal one, `plant` (a VehiclePlant) the true one in the current `phase`, `reports`
    are the results of finished phases. Instants are seconds after the start. The car is
    reproducible: equal arguments give equal cars.
    """

    def __init__(self, vehicle: Vehicle, drive: DrivePhase, state: BatteryState,
                 imperfections: Imperfections = Imperfections(), seed: int | Sequence[int] = 0,
                 route_id: str = 'simulated', following: Sequence[Phase] = ()) -> None:
        """Put the car at the start of a drive, with `following` Phases after it; see numpy for `seed`."""
        self._drive_seed, sensor_seed, self._position_seed = np.random.SeedSequence(seed).spawn(3)
        self.vehicle = vehicle
        self.imperfections = imperfections
        self.phase: Phase = drive
        self.reports: list[PhaseReport] = []
        self._first_state = state
        self._following, self._phases = deque(following), 1 + len(following)
        self._route_id, self._drives, self._charger = route_id, 0, drive.charger
        self._true_vehicle = true_vehicle(vehicle, imperfections.mismatch, imperfections.heat_path)
        self._letters: list[_Letter] = []
        self._heats_itself, self._asleep_from_s = False, math.inf
        self.plant = VehiclePlant(self._true_vehicle, self._begin_drive(drive, 0.0), state)
        self._latest_drive = self.plant
        self.readings_of = SensorReadings(imperfections.sensors, np.random.default_rng(sensor_seed))
        self.readings_of.take(self.plant)

    @property
    def time_s(self) -> float:
        """Time since the start [s]."""
        return self.plant.time_s

    @property
    def clock_s(self) -> float:
        """The clock's reading since the start of the drive, including its jumps [s]."""
        return self.stamp_s(self.plant.time_s)

    def stamp_s(self, instant_s: float) -> float:
        """Return the clock's reading at an instant [s]."""
        jumps = self.imperfections.clock_jumps
        return instant_s + clock_offset_s(jumps, instant_s) if jumps else instant_s

    @property
    def is_over(self) -> bool:
        """Whether the last phase has ended."""
        return not self._following and self._has_ended()

    @property
    def in_words(self) -> str:
        """The phases ahead, as a suffix to the name of the first drive; '' without any."""
        return ''.join(f', {type(phase).__name__.lower()}' for phase in self._following)

    @property
    def is_charging(self) -> bool:
        """Whether the car is at a charger."""
        return isinstance(self.phase, Charge)

    @property
    def longest_s(self) -> float:
        """Longest duration of all phases [s]; late drives extend it."""
        return self.plant.end_s + sum(
            phase.route.total_duration_s if isinstance(phase, DrivePhase) else phase.duration_s
            for phase in self._following)

    @property
    def asleep_until_s(self) -> float | None:
        """Instant at which the car and its computers wake up [s]; None: they are awake."""
        wakes_s = self.plant.end_s
        return wakes_s if self._asleep_from_s + COMPUTERS_GO_ON_S <= self.time_s < wakes_s else None

    def mission(self, start_ns: int) -> Mission:
        """Return the Mission that the trip planner sends at the start, at an instant [ns]."""
        drive = self.phase
        assert isinstance(drive, DrivePhase)
        return self._send(_Letter(0.0, 0.0, drive, TrafficNews(0.0, drive.route, drive.goal.charging_planned),
                                  self._route_id), start_ns)

    def route_news(self, start_ns: int) -> Mission | None:
        """Return the latest Mission due now, None without one; `start_ns` is the instant of the start."""
        due = None
        while self._letters and self._letters[0].at_s <= self.time_s:
            due = self._letters.pop(0)
        return None if due is None else self._send(due, start_ns)

    def progress(self, start_ns: int) -> Progress | None:
        """Return the car's position on the route sent last, None: no report is due; `start_ns` is the start."""
        if self.time_s < self._next_position_s:
            return None
        # Differences may fall short of the original instants by rounding.
        distance_m = self._position.report_m(max(self.time_s - self.plant.start_s, self._position.next_s))
        if distance_m is None or self._sent_start_ns is None:
            return None
        return Progress(distance_m, start_ns + round(self.clock_s * NS_PER_S), self._sent_route_id,
                        self._sent_start_ns)

    @property
    def next_event_s(self) -> float:
        """Return the next instant of a reading, an arriving message or a phase's end [s]."""
        news_s = self._letters[0].at_s if self._letters else math.inf
        end_s = self.plant.end_s if self._following else math.inf
        return min(self.readings_of.next_s, self.readings_of.next_arrival_s, self._next_position_s, news_s, end_s)

    @property
    def _next_position_s(self) -> float:
        return self.plant.start_s + self._position.next_s if isinstance(self.phase, DrivePhase) else math.inf

    def advance_under(self, lease: HeaterLease, to_s: float) -> None:
        """Drive on to `to_s` [s] under a HeaterLease, and take the readings due by then."""
        readings_of = self.readings_of
        while (due_s := readings_of.next_s) <= to_s:
            if self._asleep_from_s < due_s < self.plant.end_s:
                readings_of.next_s = self.plant.end_s
                continue
            self._go_on(lease, max(due_s, self.time_s))
            readings_of.take(self.plant, self.is_charging)
        self._go_on(lease, to_s)

    def readings(self) -> list[Reading]:
        """Return the Readings that have arrived since the last call, oldest first."""
        return self.readings_of.arrived(self.time_s)

    def read(self) -> Reading:
        """Return a Reading taken now, whether or not one is due."""
        return self.readings_of.read(self.plant, self.is_charging)

    # Phases

    def _go_on(self, lease: HeaterLease, to_s: float) -> None:
        """Advance to an instant [s], through all phases that begin by then."""
        while self.time_s < to_s:
            self._drive(lease, min(to_s, self.plant.end_s) if self._following else to_s)
            if self._following and self._has_ended():
                self._end_phase()
                self._begin(self._following.popleft())
        if self.is_over and len(self.reports) < self._phases:
            self._end_phase()

    def _has_ended(self) -> bool:
        phase, plant = self.phase, self.plant
        return plant.is_standing or (isinstance(phase, Charge) and plant.soc >= phase.until_soc)

    def _end_phase(self) -> None:
        plant = self.plant
        self.reports.append(PhaseReport(
            self.phase, plant.start_s, min(plant.time_s, plant.end_s), plant.temperature_c, plant.soc,
            plant.energy_wh.hvch_electric, plant.empty_at_s is not None))

    def _begin(self, phase: Phase) -> None:
        now_s, vehicle = self.time_s, self._true_vehicle
        self.phase, self._heats_itself, self._asleep_from_s = phase, False, math.inf
        if isinstance(phase, DrivePhase):
            route = self._begin_drive(phase, now_s)
            self.plant = self._latest_drive = (
                VehiclePlant(vehicle, route, self._first_state, now_s) if phase.starts_over
                else self.plant.followed_by(vehicle, route))
        elif isinstance(phase, Charge):
            self.plant = self.plant.followed_by(phase.vehicle(vehicle), phase.route(), phase.cooling(vehicle))
        else:
            self.plant = self.plant.followed_by(vehicle, phase.route())
            if phase.awake_s < phase.duration_s:
                self._asleep_from_s = now_s + phase.awake_s
            next_phase = self._following[0] if self._following else None
            if isinstance(next_phase, DrivePhase) and next_phase.announced_s > 0.0:
                begins_s = self.plant.end_s
                self._letters.append(_Letter(
                    max(now_s, begins_s - next_phase.announced_s), begins_s, next_phase,
                    TrafficNews(0.0, next_phase.route, next_phase.goal.charging_planned), self._next_id))

    def _begin_drive(self, drive: DrivePhase, begins_s: float) -> Route:
        """Return the Route actually driven in a DrivePhase, and prepare its reports."""
        driven, news = drive_with_events(drive.route, drive.events, drive.goal.charging_planned)
        if self._drives > 0 and drive.announced_s == 0.0:
            news.insert(0, TrafficNews(0.0, drive.route, drive.goal.charging_planned))
        # Messages about the previous drive that have not arrived yet are dropped.
        self._letters = [
            _Letter(begins_s + each.at_s, begins_s, drive, each, self._next_id) for each in news]
        random = self._random_of(self._drive_seed)
        self._position = Position(drive.position, driven, drive.events, self._random_of(self._position_seed))
        if drive.announced_s == 0.0:
            self._sent_start_ns: int | None = None
        self._drives += 1
        return true_route(driven, self.imperfections.mismatch, random)

    def _random_of(self, seed: np.random.SeedSequence) -> np.random.Generator:
        """Return the random generator of a drive; the first drive uses the seed's own."""
        return np.random.default_rng(seed if self._drives == 0 else seed.spawn(1)[0])

    @property
    def _next_id(self) -> str:
        return self._route_id if self._drives == 0 else f'{self._route_id} {self._drives + 1}'

    def _drive(self, lease: HeaterLease, to_s: float) -> None:
        plant, faults, phase = self.plant, self.imperfections.heater_faults, self.phase
        while plant.time_s < to_s:
            if plant.time_s >= self._asleep_from_s:
                # Its high-voltage system is off.
                plant.advance(to_s, 0.0)
                return
            own_w = 0.0
            if isinstance(phase, Charge):
                own_w = phase.own_heat_w(self.vehicle, plant.temperature_c, self._heats_itself)
                self._heats_itself = own_w > 0.0
            until_s = min(to_s, self._asleep_from_s, next_change_s(faults, plant.time_s))
            fault = fault_at(faults, plant.time_s) if faults else None
            plant.sources.shares = {
                name: math.inf if own.stuck_on else own.share for name in plant.sources.energy_wh
                if (own := fault_at(faults, plant.time_s, name)) is not None}
            share = 1.0 if fault is None else fault.share
            uncommanded_w = (plant.vehicle.hvch.maximum_power_w if fault is not None and fault.stuck_on else
                             share * own_w if own_w > 0.0 else None)
            plant.advance_under(lease if fault is None else replace(
                lease, power_w=share * lease.power_w), until_s, uncommanded_w)

    def _send(self, letter: _Letter, start_ns: int) -> Mission:
        """Return the Mission of a letter; its route begins at the car's position or at the planned start."""
        drive, news, goal = letter.drive, letter.news, letter.drive.goal
        route, at_s, standing_time_s = news.route, letter.begins_s + news.at_s, 0.0
        if route is None:
            # The drive has ended: send its last segment, which is already driven.
            driven = self._latest_drive
            route = driven.route.segments(len(driven.route) - 1, len(driven.route))
            at_s = driven.start_s + driven.duration_s - route.total_duration_s
        elif news.at_s == 0.0 and route is drive.route:
            standing_time_s = drive.standing_time_s
        self._position.begin_route(at_s - letter.begins_s)
        self._sent_start_ns = start_ns + round(self.stamp_s(at_s) * NS_PER_S)
        self._sent_route_id = letter.route_id
        return Mission(letter.route_id, (Leg(
            route, self._sent_start_ns, news.charging_planned,
            None if math.isnan(goal.target_temperature_c) else goal.target_temperature_c,
            goal.minimum_arrival_soc, charger=drive.charger or self._charger,
            maximum_arrival_temperature_c=goal.maximum_arrival_temperature_c,
            prospect=drive.prospect if news.probability is None else replace(
                drive.prospect, probability=news.probability)),), standing_time_s)
