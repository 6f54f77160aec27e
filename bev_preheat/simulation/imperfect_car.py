# SPDX-License-Identifier: Apache-2.0
"""A simulated car that differs from its description, in traffic, seen through its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.simulation.heater_faults import fault_at, HeaterFault, next_change_s
from bev_preheat.simulation.heater_lease import HeaterLease
from bev_preheat.simulation.mismatch import Mismatch, true_route, true_vehicle
from bev_preheat.simulation.position import Position, PositionReports
from bev_preheat.simulation.sensors import Reading, SensorReadings, Sensors
from bev_preheat.simulation.traffic import clock_offset_s, ClockJump, drive_with_events, Event
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.supervision.inputs import Leg, Mission, NS_PER_S, Progress
from bev_preheat.vehicle.heat_path import HeatPath

if TYPE_CHECKING:
    from bev_preheat.charging.stop import Charger
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class Imperfections:
    """
    All deviations of the simulated drive from vehicle and route file; none by default.

    `heat_path` is None where the car's is that of its vehicle file, `position` where the car does not
    say where it is.
    """

    mismatch: Mismatch = field(default_factory=Mismatch)
    heat_path: HeatPath | None = None
    sensors: Sensors = field(default_factory=Sensors)
    heater_faults: tuple[HeaterFault, ...] = ()
    events: tuple[Event, ...] = ()
    clock_jumps: tuple[ClockJump, ...] = ()
    position: PositionReports | None = None


class ImperfectCar:
    """
    A car on its way.

    `vehicle` is what its file says, `plant` (a VehiclePlant) the truth. Instants are seconds after
    the start; the same arguments make the same car.
    """

    def __init__(self, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                 imperfections: Imperfections = Imperfections(), seed: int | Sequence[int] = 0,
                 route_id: str = 'simulated', standing_time_s: float = 0.0,
                 charger: Charger | None = None) -> None:
        """
        Put the car at the start of a Route, with its battery in `state`; see numpy for `seed`.

        The trip planner says that it stood for `standing_time_s` [s] before; 0: it does not know. It
        knows the Charger at the end; None: it does not.
        """
        drive_seed, sensor_seed, position_seed = np.random.SeedSequence(seed).spawn(3)
        self.vehicle = vehicle
        self.imperfections = imperfections
        self._goal, self._route, self._route_id = goal, route, route_id
        self._standing_time_s, self._charger = standing_time_s, charger
        driven, self._news = drive_with_events(
            route, imperfections.events, goal.charging_planned)
        mismatch = imperfections.mismatch
        self.plant = VehiclePlant(
            true_vehicle(vehicle, mismatch, imperfections.heat_path),
            true_route(driven, mismatch, np.random.default_rng(drive_seed)), state)
        self.readings_of = SensorReadings(
            imperfections.sensors, np.random.default_rng(sensor_seed))
        self.readings_of.take(self.plant)
        self._position = Position(imperfections.position, driven, imperfections.events,
                                  np.random.default_rng(position_seed))
        self._sent_start_ns: int | None = None

    @property
    def time_s(self) -> float:
        """Time since the start [s]."""
        return self.plant.time_s

    @property
    def clock_s(self) -> float:
        """What a clock that started with the drive shows [s]: the time, and its jumps."""
        return self.stamp_s(self.plant.time_s)

    def stamp_s(self, instant_s: float) -> float:
        """Return what the clock showed at an instant [s]."""
        jumps = self.imperfections.clock_jumps
        return instant_s + clock_offset_s(jumps, instant_s) if jumps else instant_s

    def mission(self, start_ns: int) -> Mission:
        """Return the Mission that the trip planner sends at the start, at an instant [ns]."""
        mission = self._send(self._route, 0.0, start_ns, self._goal.charging_planned)
        return replace(mission, standing_time_s=self._standing_time_s)

    def route_news(self, start_ns: int) -> Mission | None:
        """
        Return the Mission that the trip planner sends now; None where it has nothing to say.

        `start_ns` is the instant of the start. Of several that are due the latest is returned.
        """
        due = None
        while self._news and self._news[0].at_s <= self.time_s:
            due = self._news.pop(0)
        if due is None:
            return None
        if due.route is None:
            # The drive has ended: the last segment of what was driven, behind us.
            last = self.plant.route.segments(len(self.plant.route) - 1, len(self.plant.route))
            began_s = self.plant.duration_s - last.total_duration_s
            return self._send(last, began_s, start_ns, due.charging_planned)
        return self._send(due.route, due.at_s, start_ns, due.charging_planned)

    def progress(self, start_ns: int) -> Progress | None:
        """
        Return where on the route that was sent last the car is; None where it does not say so now.

        `start_ns` is the instant of the start.
        """
        distance_m = self._position.report_m(self.time_s)
        if distance_m is None or self._sent_start_ns is None:
            return None
        return Progress(distance_m, start_ns + round(self.clock_s * NS_PER_S), self._route_id,
                        self._sent_start_ns)

    @property
    def next_event_s(self) -> float:
        """When the next battery state is taken, or it, a route plan or a position arrives [s]."""
        news_s = self._news[0].at_s if self._news else math.inf
        return min(self.readings_of.next_s, self.readings_of.next_arrival_s, self._position.next_s, news_s)

    def advance_under(self, lease: HeaterLease, to_s: float) -> None:
        """Drive on to `to_s` [s] under a HeaterLease, and take the readings that are due."""
        readings_of, plant = self.readings_of, self.plant
        while (due_s := readings_of.next_s) <= to_s:
            self._drive(lease, max(due_s, plant.time_s))
            readings_of.take(plant)
        self._drive(lease, to_s)

    def readings(self) -> list[Reading]:
        """Return the Readings that have arrived since the last call, oldest first."""
        return self.readings_of.arrived(self.time_s)

    def _drive(self, lease: HeaterLease, to_s: float) -> None:
        plant, faults = self.plant, self.imperfections.heater_faults
        while plant.time_s < to_s:
            if not faults:
                plant.advance_under(lease, to_s)
                return
            until_s = min(to_s, next_change_s(faults, plant.time_s))
            fault = fault_at(faults, plant.time_s)
            if fault is None:
                plant.advance_under(lease, until_s)
            elif fault.stuck_on:
                plant.advance(until_s, plant.vehicle.hvch.maximum_power_w)
            else:
                plant.advance_under(
                    HeaterLease(fault.share * lease.power_w, lease.until_s), until_s)

    def _send(self, route: Route, at_s: float, start_ns: int, charging_planned: bool) -> Mission:
        """Return the Mission of a route that begins where the car is at an instant of the drive [s]."""
        goal = self._goal
        self._position.begin_route(at_s)
        self._sent_start_ns = start_ns + round(self.stamp_s(at_s) * NS_PER_S)
        return Mission(self._route_id, (Leg(
            route, self._sent_start_ns, charging_planned,
            None if math.isnan(goal.target_temperature_c) else goal.target_temperature_c,
            goal.minimum_arrival_soc, charger=self._charger),))
