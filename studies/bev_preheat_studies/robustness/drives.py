# SPDX-License-Identifier: Apache-2.0
"""Simulate one drive: the planner's Supervisor and a simulated car, one step per battery state, without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.inputs import in_planning_steps
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.simulation.drive_score import DriveScore, instants, score_of, Switching

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

# Below this share of the power that the cabin leaves, a command is partial duty.
FULL_SHARE = 0.95


@dataclass(frozen=True)
class DriveOutcome(DriveScore):
    """
    Outcome of one drive: its score, and the behaviour of the planner.

    `partial_duty_s` is the time with a command above 0 W and below FULL_SHARE of the power that the cabin leaves.
    `verdicts` are the heater faults that the planner reported, in order;
    `fault_shown_s` is how long a real heater fault had an effect until it was found or the drive
    ended [s] (a dead heater has none while it is not commanded; None: no effect), and
    `fault_found_after_s` the time from its first effect until it was found [s]; None: never.
    `refused_inputs` counts refused battery states, `updates_without_plan` the updates
    without a plan, `updates` all updates. `planner_cpu_s` is the planner's processor time.
    """

    partial_duty_s: float = 0.0
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
    A drive over time: arrays with one entry for each step of the planner.

    Instants [s], temperatures [deg C]: true, measured, estimated by the planner, and predicted by the planner
    for the arrival (NaN without a prediction); command [W].
    """

    time_s: FloatArray
    true_c: FloatArray
    measured_c: FloatArray
    estimated_c: FloatArray
    predicted_arrival_c: FloatArray
    command_w: FloatArray


class _DriveTally(Switching):
    """Totals of the commands; each holds until the next."""

    def __init__(self, vehicle: Vehicle, route: Route) -> None:
        super().__init__()
        self._vehicle, self._route = vehicle, route
        self.partial_duty_s = self._since_s = 0.0

    def note(self, now_s: float, power_w: float) -> None:
        """Record the command [W] from an instant [s] on."""
        now_s = min(now_s, self._route.total_duration_s)
        if self._is_partial():
            self.partial_duty_s += now_s - self._since_s
        self._since_s = now_s
        super().note(now_s, power_w)

    def _is_partial(self) -> bool:
        if self.power_w == 0.0:
            return False
        cabin_w = float(
            self._route.cabin_heating_power_w[self._route.segment_at(self._since_s)])
        most_w = self._vehicle.hvch.maximum_power_w - cabin_w
        return self.power_w < FULL_SHARE * most_w


class FaultWatch:
    """
    Measures how long the planner takes to find the first real heater fault.

    `shown_s` is how long it has had an effect [s] (None: none yet); `found_after_s` is the time from its first
    effect until it was found [s], None until then.
    """

    def __init__(self, faults: Sequence[HeaterFault]) -> None:
        """Watch for the first of the HeaterFaults; does nothing without any."""
        self._fault = faults[0] if faults else None
        self._first_s: float | None = None
        self._shows_since_s: float | None = None
        self.shown_s: float | None = None
        self.found_after_s: float | None = None

    def note(self, now_s: float, command_w: float, estimate: Estimate | None) -> None:
        """Record the command [W] and the planner's estimate at an instant [s]."""
        fault = self._fault
        if fault is None or now_s < fault.from_s or self.found_after_s is not None:
            return
        self.end(now_s)
        # Uncommanded heat has an effect while no heat is commanded; a weak heater while heat is commanded.
        self._shows_since_s = now_s if (command_w == 0.0) == fault.stuck_on else None
        if self._first_s is None and self._shows_since_s is not None:
            self._first_s, self.shown_s = now_s, 0.0
        if (self._first_s is not None and estimate is not None
                and estimate.heater.heater is _kind_of(fault)):
            self.found_after_s = now_s - self._first_s

    def end(self, now_s: float) -> None:
        """Add the time with an effect up to an instant [s]."""
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

    `note` is called at each instant with the values of a DriveTrace; None: no trace.
    """
    supervisor, plant = Supervisor(car.vehicle, settings), car.plant
    tally, cpu_s = _DriveTally(car.vehicle, plant.route), 0.0
    refused, without_plan, updates = 0, 0, 0
    verdicts: dict[str, float] = {}
    fault = FaultWatch(car.imperfections.heater_faults)
    for moment, instant in instants(car, supervisor):
        cpu_s += moment.cpu_s
        if moment.reading is not None:
            refused += bool(moment.output.refusals)
            without_plan += supervisor.state.decision.status is Status.INVALID_INPUT
            updates += 1
        if instant is None:
            continue
        tally.note(instant.time_s, instant.command_w)
        estimate = supervisor.state.estimate
        if estimate is not None and estimate.heater.heater is not Heater.ANSWERS:
            verdicts.setdefault(estimate.heater.heater.value, instant.time_s)
        fault.note(instant.time_s, instant.command_w, estimate)
        if note is not None:
            note(*instant)
    tally.note(plant.time_s, 0.0)
    fault.end(plant.time_s)
    return _drive(plant, goal, tally, refused_inputs=refused, updates_without_plan=without_plan,
                  updates=updates, planner_cpu_s=cpu_s,
                  verdicts=tuple(verdicts), fault_shown_s=fault.shown_s,
                  fault_found_after_s=fault.found_after_s)


def drive_informed(car: ImperfectCar, goal: Goal) -> DriveOutcome:
    """
    Return the DriveOutcome of a car under a single plan that knows the true car, its heat path, and drive.

    The plan's steps are as long as the planner's; it is executed without feedback from the battery.
    """
    plant = car.plant
    state = BatteryState(plant.temperature_c, plant.soc)
    route = in_planning_steps(plant.route, Settings.planning_step_s)
    plan = plan_preheating(plant.vehicle, route, state, goal)
    switchings_s = [instant_s for instant_s in (plan.heating_start_s, plan.heating_end_s)
                    if instant_s is not None]
    # The plan's power is constant between two of these.
    edges_s = np.unique(np.concatenate((plan.time_s, switchings_s)))
    tally = _DriveTally(car.vehicle, plant.route)
    for from_s, to_s in zip(edges_s[:-1].tolist(), edges_s[1:].tolist()):
        power_w = plan.power_at_w(from_s)
        tally.note(from_s, power_w)
        plant.advance(to_s, power_w)
    tally.note(plant.time_s, 0.0)
    return _drive(plant, goal, tally)


def _drive(plant: VehiclePlant, goal: Goal, tally: _DriveTally, **counted: Any) -> DriveOutcome:
    score = score_of(plant, goal.target_temperature_c, tally)
    return DriveOutcome(**vars(score), partial_duty_s=tally.partial_duty_s, **counted)
