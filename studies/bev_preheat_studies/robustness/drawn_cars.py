# SPDX-License-Identifier: Apache-2.0
"""Draw cars that differ from their vehicle file, each from its own seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections, Mismatch
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import PositionReports, Sensors
from bev_preheat.simulation.traffic import Event, Kind
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.description import HeatPath, HVCH
from bev_preheat.vehicle.variants import with_shell

# Each factor is uniform in 1 +- this.
SPREAD = {
    'heat_capacity': 0.10,
    'leakage': 0.20,
    'resistance': 0.20,
    'heater': 0.05,
    'propulsion_power': 0.10,
}
# Standard deviation of the logarithm of the factor on the propulsion power, which varies from segment to
# segment like traffic.
PROPULSION_POWER_VARIABILITY = 0.2
TEMPERATURE_NOISE_K = 0.2
TEMPERATURE_RESOLUTION_K = 1.0
POSITION_NOISE_M = 5.0
# Pace and shell have their own random streams, so that the cars are the same with and without them.
PACE_STREAM = 1
SHELL_STREAM = 2


# Uniform distributions: lag of the heater [s], heat capacity [J/K] and conductance [W/K] of the coolant, lag of
# the sensor [s].
HEATER_LAG_S = (0.0, 90.0)
COOLANT_J_PER_K = (5e3, 40e3)
COOLANT_W_PER_K = (200.0, 1000.0)
SENSOR_LAG_S = (0.0, 120.0)
# Share of the battery and, log-uniform, conductance [W/K] of a shell.
SHELL_SHARE = (0.12, 0.4)
SHELL_W_PER_K = (150.0, 1500.0)
# The parts of the heat path in each plant; 'ripple': the current's variation is not measured; 'shell': a battery
# of shell and core with the sensor on either.
PLANTS: dict[str, frozenset[str]] = {
    'nominal': frozenset(), 'lag': frozenset(('lag',)), 'coolant': frozenset(('coolant',)),
    'sensor_lag': frozenset(('sensor_lag',)), 'ripple': frozenset(('ripple',)),
    'all': frozenset(('lag', 'coolant', 'sensor_lag', 'ripple')),
    'shell': frozenset(('lag', 'sensor_lag', 'shell'))}


# Real heater faults by name: the share of its command that it delivers, or uncommanded heating.
FAULTS: dict[str, HeaterFault | None] = {
    'none': None, 'dead': HeaterFault(0.0, share=0.0), 'derated': HeaterFault(0.0, share=0.5),
    'stuck_on': HeaterFault(0.0, stuck_on=True)}
# A fault starts in this part of the drive, drawn uniformly.
FAULT_BEGINS = (0.1, 0.5)


@dataclass(frozen=True)
class Conditions:
    """
    The conditions that all trips of a study share.

    Vehicle and Routes as in their files (trips use the Routes alternately), the state at the start, the goal, the
    period of battery states and commands [s], whether battery states carry voltage and current, the names
    of a plant (PLANTS), a fault (FAULTS) and the faulty heat source, the largest relative deviation of a trip's
    duration from its route's (`traffic`), and whether the car reports its position.
    """

    vehicle: Vehicle
    routes: tuple[Route, ...]
    state: BatteryState
    goal: Goal
    period_s: float = 1.0
    reports_power: bool = True
    plant: str = 'nominal'
    fault: str = 'none'
    fault_source: str = HVCH
    traffic: float = 0.0
    tells_position: bool = False


@dataclass(frozen=True)
class DrawnCar:
    """A drawn car on its trip, reproducible from `seed` and `number`."""

    seed: int
    number: int
    conditions: Conditions
    mismatch: Mismatch
    heat_path: HeatPath
    heater_faults: tuple[HeaterFault, ...] = ()
    pace: float = 1.0

    @property
    def route(self) -> Route:
        """The route as in its file."""
        routes = self.conditions.routes
        return routes[self.number % len(routes)]

    def car(self, sensors: Sensors | None = None) -> ImperfectCar:
        """Return a new car at the start, with other Sensors or its own; every such car drives identically."""
        conditions = self.conditions
        return ImperfectCar(
            conditions.vehicle, DrivePhase(
                self.route, conditions.goal, events=pace_events(self.route, self.pace),
                position=(PositionReports(conditions.period_s, POSITION_NOISE_M)
                          if conditions.tells_position else None)),
            conditions.state,
            Imperfections(self.mismatch, self.heat_path, sensors or self.sensors(), self.heater_faults),
            [self.seed, self.number])

    def sensors(self) -> Sensors:
        """Return the car's Sensors."""
        return Sensors(
            temperature_noise_k=TEMPERATURE_NOISE_K,
            temperature_resolution_k=TEMPERATURE_RESOLUTION_K,
            reports_power=self.conditions.reports_power,
            period_s=self.conditions.period_s)


def pace_events(route: Route, pace: float) -> tuple[Event, ...]:
    """Return the events that change the pace of a whole route; the trip planner does not report them."""
    return () if pace == 1.0 else (Event(Kind.OTHER_PACE, 0.0, None, route.total_duration_s, pace),)


def draw_car(conditions: Conditions, seed: int, number: int) -> DrawnCar:
    """Return trip `number` of a study."""
    random = np.random.default_rng([seed, number])
    factors = {name: float(random.uniform(1.0 - spread, 1.0 + spread))
               for name, spread in SPREAD.items()}
    parts = PLANTS[conditions.plant]
    car = DrawnCar(seed, number, conditions, Mismatch(
        **factors, propulsion_power_variability=PROPULSION_POWER_VARIABILITY,
        visible_variation='ripple' not in parts), _draw_heat_path(
            random, parts, conditions.vehicle.heat_path),
        pace=_draw_pace(seed, number, conditions.traffic))
    if 'shell' in parts:
        car = _with_drawn_shell(car, np.random.default_rng([seed, number, SHELL_STREAM]))
    fault = FAULTS[conditions.fault]
    if fault is None:
        return car
    begins_s = float(random.uniform(*FAULT_BEGINS)) * car.route.total_duration_s
    return replace(car, heater_faults=(replace(fault, from_s=begins_s, source=conditions.fault_source),))


def _with_drawn_shell(car: DrawnCar, random: np.random.Generator) -> DrawnCar:
    """Return a car whose battery has the same heat capacity and leakage in two masses."""
    share, capacity = float(random.uniform(*SHELL_SHARE)), car.mismatch.heat_capacity
    shell = with_shell(
        replace(car.conditions.vehicle, heat_path=car.heat_path), share, math.exp(random.uniform(
            *np.log(SHELL_W_PER_K))), 'shell' if random.uniform() < 0.5 else 'core').heat_path
    return replace(
        car, mismatch=replace(car.mismatch, heat_capacity=(1.0 - share) * capacity), heat_path=replace(
            shell, coolant_heat_capacity_j_per_k=capacity * shell.coolant_heat_capacity_j_per_k))


def _draw_pace(seed: int, number: int, traffic: float) -> float:
    """Return a trip's duration as a multiple of its route's."""
    random = np.random.default_rng([seed, number, PACE_STREAM])
    return 1.0 + traffic * float(random.uniform(-1.0, 1.0))


def _draw_heat_path(random: np.random.Generator, parts: frozenset[str],
                    described: HeatPath) -> HeatPath:
    """Return the vehicle file's HeatPath with drawn parts; every plant uses the same random numbers."""
    heater_lag_s, coolant_j_per_k, coolant_w_per_k, sensor_lag_s = (
        float(random.uniform(*span))
        for span in (HEATER_LAG_S, COOLANT_J_PER_K, COOLANT_W_PER_K, SENSOR_LAG_S))
    path = described
    if 'lag' in parts:
        path = replace(path, heater_lag_s=heater_lag_s)
    if 'coolant' in parts:
        path = replace(path, coolant_heat_capacity_j_per_k=coolant_j_per_k,
                       coolant_conductance_w_per_k=coolant_w_per_k)
    if 'sensor_lag' in parts:
        path = replace(path, sensor_lag_s=sensor_lag_s)
    return path
