# SPDX-License-Identifier: Apache-2.0
"""One drive: the planner's Supervisor and a simulated car, each second or so, without ROS."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.inputs import in_planning_steps
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.simulation.supervised_drive import moments

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.situation import Goal
    from bev_preheat.route import Route
    from bev_preheat.simulation.heater_faults import HeaterFault
    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.vehicle_plant import VehiclePlant
    from bev_preheat.vehicle import Vehicle

# Less than this share of what the cabin leaves is partial duty.
FULL_SHARE = 0.95


@dataclass(frozen=True)
class DriveOutcome:
    """
    What became of one drive.

    `arrival_error_k` is the true temperature on arrival above the target [K], `heating_energy_wh`
    what the HVCH spent on the battery, `battery_energy_wh` what the cells gave. `switch_ons`
    counts how often the command rose from 0 W, first at `first_switch_on_s` [s], None where it
    never did; `partial_duty_s` is how long it was more than 0 W and less than FULL_SHARE of what
    the cabin leaves.
    `verdicts` are the faults that the planner found in the heater on the way, in order;
    `fault_shown_s` is how long one that the heater really had showed until it was found or the drive
    ended [s] (a dead heater that is not commanded does not; None: it never did), and
    `fault_found_after_s` how long after it first showed it was found [s]; None: never.
    `refused_inputs` counts battery states that were refused, `updates_without_plan` the updates
    after which nothing could be planned, `updates` all. `planner_cpu_s` is the planner's time.
    """

    arrival_error_k: float
    arrival_soc: float
    heating_energy_wh: float
    battery_energy_wh: float
    switch_ons: int
    first_switch_on_s: float | None
    partial_duty_s: float
    ran_empty: bool
    verdicts: tuple[str, ...] = ()
    fault_shown_s: float | None = None
    fault_found_after_s: float | None = None
    refused_inputs: int = 0
    updates_without_plan: int = 0
    updates: int = 0
    planner_cpu_s: float = 0.0


@dataclass(frozen=True)
class DriveTrace:
    """
    A drive over time; arrays of one entry for each instant at which the planner took a step.

    Instants [s], temperatures [deg C]: true, measured, as the planner estimates it, and as it
    predicts it for the arrival (NaN where it does not); command [W].
    """

    time_s: FloatArray
    true_c: FloatArray
    measured_c: FloatArray
    estimated_c: FloatArray
    predicted_arrival_c: FloatArray
    command_w: FloatArray


class _DriveTally:
    """What commands amount to: each holds until the next."""

    def __init__(self, vehicle: Vehicle, route: Route) -> None:
        self._vehicle, self._route = vehicle, route
        self.switch_ons, self.partial_duty_s = 0, 0.0
        self.first_switch_on_s: float | None = None
        self._power_w, self._since_s = 0.0, 0.0

    def note(self, now_s: float, power_w: float) -> None:
        """Note that a power [W] is commanded from an instant [s] on."""
        now_s = min(now_s, self._route.total_duration_s)
        if self._is_partial():
            self.partial_duty_s += now_s - self._since_s
        if power_w > 0.0 and self._power_w == 0.0:
            self.switch_ons += 1
            if self.first_switch_on_s is None:
                self.first_switch_on_s = now_s
        self._power_w, self._since_s = power_w, now_s

    def _is_partial(self) -> bool:
        if self._power_w == 0.0:
            return False
        cabin_w = float(
            self._route.cabin_heating_power_w[self._route.segment_at(self._since_s)])
        most_w = self._vehicle.hvch.maximum_power_w - cabin_w
        return self._power_w < FULL_SHARE * most_w


class FaultWatch:
    """
    How long the planner takes to find the fault that the heater really has; the first of them.

    `shown_s` is how long it showed [s], None where it did not; `found_after_s`, how long after it first
    showed it was found [s], None while it is not.
    """

    def __init__(self, faults: Sequence[HeaterFault]) -> None:
        """Watch for the first of the HeaterFaults; without any there is nothing to find."""
        self._fault = faults[0] if faults else None
        self._first_s: float | None = None
        self._shows_since_s: float | None = None
        self.shown_s: float | None = None
        self.found_after_s: float | None = None

    def note(self, now_s: float, command_w: float, estimate: Estimate | None) -> None:
        """Note the command [W] and what is believed at an instant [s]."""
        fault = self._fault
        if fault is None or now_s < fault.from_s or self.found_after_s is not None:
            return
        self.end(now_s)
        # Uncommanded heat shows where none is commanded, a heater that gives less where some is.
        self._shows_since_s = now_s if (command_w == 0.0) == fault.stuck_on else None
        if self._first_s is None and self._shows_since_s is not None:
            self._first_s, self.shown_s = now_s, 0.0
        if (self._first_s is not None and estimate is not None
                and estimate.heater.heater is _kind_of(fault)):
            self.found_after_s = now_s - self._first_s

    def end(self, now_s: float) -> None:
        """Count what showed until an instant [s]."""
        if self._shows_since_s is not None and self.shown_s is not None and self.found_after_s is None:
            self.shown_s += now_s - self._shows_since_s


def _kind_of(fault: HeaterFault) -> Heater:
    if fault.stuck_on:
        return Heater.STUCK_ON
    return Heater.DEAD if fault.share == 0.0 else Heater.DERATED


def drive_with_planner(car: ImperfectCar, goal: Goal,
                       settings: Settings) -> tuple[DriveOutcome, DriveTrace]:
    """Return (DriveOutcome, DriveTrace) of a car under a Supervisor with `settings`."""
    rows: list[tuple[float, ...]] = []
    return drive_noting(car, goal, settings, lambda *row: rows.append(row)), DriveTrace(*np.array(rows).T)


def drive_noting(car: ImperfectCar, goal: Goal, settings: Settings,
                 note: Callable[..., object] | None) -> DriveOutcome:
    """
    Return the DriveOutcome of a car under a Supervisor with `settings`.

    `note` is called at each instant with what a DriveTrace has of it; None: nobody asks for that.
    """
    supervisor, plant = Supervisor(car.vehicle, settings), car.plant
    tally, cpu_s = _DriveTally(car.vehicle, plant.route), 0.0
    refused, without_plan, updates, measured_c = 0, 0, 0, math.nan
    power_w = 0.0
    verdicts: dict[str, float] = {}
    fault = FaultWatch(car.imperfections.heater_faults)
    for moment in moments(car, supervisor, lambda: plant.is_standing):
        cpu_s += moment.cpu_s
        if moment.reading is not None:
            measured_c = moment.reading.temperature_c
            refused += bool(moment.output.refusals)
            without_plan += supervisor.decision.status is Status.INVALID_INPUT
            updates += 1
        output = moment.output
        if output.command is not None:
            power_w = output.command.battery_heating_power_w
        if not moment.is_last:
            continue
        tally.note(moment.time_s, power_w)
        estimate = supervisor.estimate
        if estimate is not None and estimate.heater.heater is not Heater.ANSWERS:
            verdicts.setdefault(estimate.heater.heater.value, moment.time_s)
        fault.note(moment.time_s, power_w, estimate)
        if note is not None:
            plan = supervisor.decision.plan
            note(moment.time_s, plant.temperature_c, measured_c,
                 math.nan if estimate is None else estimate.temperature_c,
                 math.nan if plan is None else plan.arrival_temperature_c, power_w)
    tally.note(plant.time_s, 0.0)
    fault.end(plant.time_s)
    return _drive(plant, goal, tally, refused_inputs=refused, updates_without_plan=without_plan,
                  updates=updates, planner_cpu_s=cpu_s,
                  verdicts=tuple(verdicts), fault_shown_s=fault.shown_s,
                  fault_found_after_s=fault.found_after_s)


def drive_informed(car: ImperfectCar, goal: Goal) -> DriveOutcome:
    """
    Return the DriveOutcome of a car under one plan that knows the true car, its heat path, and drive.

    It is planned in steps as long as the planner's and driven without looking at the battery.
    """
    plant = car.plant
    state = BatteryState(plant.temperature_c, plant.soc)
    route = in_planning_steps(plant.route, Settings.planning_step_s)
    plan = plan_preheating(plant.vehicle, route, state, goal)
    switchings_s = [instant_s for instant_s in (plan.heating_start_s, plan.heating_end_s)
                    if instant_s is not None]
    # Between two of these the plan's power does not change.
    edges_s = np.unique(np.concatenate((plan.time_s, switchings_s)))
    tally = _DriveTally(car.vehicle, plant.route)
    for from_s, to_s in zip(edges_s[:-1].tolist(), edges_s[1:].tolist()):
        power_w = plan.power_at_w(from_s)
        tally.note(from_s, power_w)
        plant.advance(to_s, power_w)
    tally.note(plant.time_s, 0.0)
    return _drive(plant, goal, tally)


def _drive(plant: VehiclePlant, goal: Goal, tally: _DriveTally, **counted: Any) -> DriveOutcome:
    energy_wh = plant.energy_wh
    return DriveOutcome(
        arrival_error_k=plant.temperature_c - goal.target_temperature_c,
        arrival_soc=plant.soc,
        heating_energy_wh=energy_wh.hvch_electric,
        battery_energy_wh=energy_wh.battery_total,
        switch_ons=tally.switch_ons,
        first_switch_on_s=tally.first_switch_on_s,
        partial_duty_s=tally.partial_duty_s,
        ran_empty=plant.empty_at_s is not None, **counted)
