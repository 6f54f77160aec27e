# SPDX-License-Identifier: Apache-2.0
"""The score of a simulated drive, the same in scenarios, studies and Python: arrival, energy, switching."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.simulation.supervised_drive import moments

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bev_preheat.control.supervisor import Supervisor
    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.supervised_drive import Moment
    from bev_preheat.simulation.vehicle_plant import VehiclePlant


class Switching:
    """Counts the rises of the heater's command from 0 W; the first is at `first_switch_on_s` [s], None: never."""

    def __init__(self) -> None:
        """Start with 0 W."""
        self.switch_ons = 0
        self.first_switch_on_s: float | None = None
        self.power_w = 0.0

    def note(self, now_s: float, power_w: float) -> None:
        """Record the command [W] from an instant [s] on."""
        if power_w > 0.0 == self.power_w:
            self.switch_ons += 1
            if self.first_switch_on_s is None:
                self.first_switch_on_s = now_s
        self.power_w = power_w


@dataclass(frozen=True)
class DriveScore:
    """
    The score of one drive.

    `arrival_error_k` is the true temperature on arrival above the target [K], `heating_energy_wh` the HVCH's
    energy for the battery, `battery_energy_wh` the energy from the cells. `switch_ons` and `first_switch_on_s` are
    those of Switching.
    """

    arrival_error_k: float
    arrival_soc: float
    heating_energy_wh: float
    battery_energy_wh: float
    switch_ons: int
    first_switch_on_s: float | None
    ran_empty: bool


def score_of(plant: VehiclePlant, target_c: float, switching: Switching) -> DriveScore:
    """Return the DriveScore of a car that stands at the end of its drive; `target_c` [deg C]."""
    return DriveScore(
        plant.temperature_c - target_c, plant.soc, plant.energy_wh.hvch_electric, plant.energy_wh.battery_total,
        switching.switch_ons, switching.first_switch_on_s, plant.empty_at_s is not None)


class Instant(NamedTuple):
    """
    A drive at an instant [s], once the planner has answered all that came.

    Temperature of the battery, true, measured and estimated [deg C]; predicted on arrival [deg C]; command [W].
    """

    time_s: float
    true_c: float
    measured_c: float
    estimated_c: float
    predicted_arrival_c: float
    command_w: float


def instants(car: ImperfectCar, supervisor: Supervisor) -> Iterator[tuple[Moment, Instant | None]]:
    """Drive a car under a Supervisor until it stands; yield Moments, the last of an instant with its Instant."""
    plant, measured_c, power_w = car.plant, math.nan, 0.0
    for moment in moments(car, supervisor, lambda: plant.is_standing):
        if moment.reading is not None:
            measured_c = moment.reading.temperature_c
        if moment.output.command is not None:
            power_w = moment.output.command.battery_heating_power_w
        estimate, plan = supervisor.state.estimate, supervisor.state.decision.plan
        yield moment, Instant(
            moment.time_s, plant.temperature_c, measured_c,
            math.nan if estimate is None else estimate.temperature_c,
            math.nan if plan is None else plan.arrival_temperature_c, power_w) if moment.is_last else None
