# SPDX-License-Identifier: Apache-2.0
"""Draws cars that differ from their description, each from its own seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import Vehicle

# Each factor is drawn evenly within 1 +- this.
SPREAD = {
    'heat_capacity': 0.10,
    'leakage': 0.20,
    'resistance': 0.20,
    'heater': 0.05,
    'propulsion_power': 0.10,
}
# Standard deviation of the logarithm of a factor on the propulsion power that wanders from segment
# to segment, as traffic does.
PROPULSION_POWER_VARIABILITY = 0.2
TEMPERATURE_NOISE_K = 0.2
TEMPERATURE_RESOLUTION_K = 1.0


@dataclass(frozen=True)
class Conditions:
    """
    What all trips of a study have in common.

    Vehicle and Route as described, the state at the start, the goal, the time between two battery
    states and between two commands [s], and whether battery states carry voltage and current.
    """

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    period_s: float = 1.0
    reports_power: bool = True


@dataclass(frozen=True)
class DrawnCar:
    """One drawn car on its way; `seed` and `number` make it again."""

    seed: int
    number: int
    conditions: Conditions
    mismatch: Mismatch

    def car(self) -> ImperfectCar:
        """Return the car at its start; each one drives, and is measured, in the same way."""
        conditions = self.conditions
        sensors = Sensors(
            temperature_noise_k=TEMPERATURE_NOISE_K,
            temperature_resolution_k=TEMPERATURE_RESOLUTION_K,
            reports_power=conditions.reports_power,
            period_s=conditions.period_s)
        return ImperfectCar(
            conditions.vehicle, conditions.route, conditions.state, conditions.goal,
            Imperfections(self.mismatch, sensors=sensors), [self.seed, self.number])


def draw_car(conditions: Conditions, seed: int, number: int) -> DrawnCar:
    """Return trip `number` of a study."""
    random = np.random.default_rng([seed, number])
    factors = {name: float(random.uniform(1.0 - spread, 1.0 + spread))
               for name, spread in SPREAD.items()}
    return DrawnCar(seed, number, conditions, Mismatch(
        **factors, propulsion_power_variability=PROPULSION_POWER_VARIABILITY))
