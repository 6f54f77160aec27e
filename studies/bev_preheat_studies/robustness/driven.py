# SPDX-License-Identifier: Apache-2.0
"""Drives of drawn cars, under the planner's own step or by a single plan that knows the true car; their scores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bev_preheat.control.inputs import in_planning_steps
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.imperfect_car import ImperfectCar
from bev_preheat.simulation.scenario_drive import drive_observed, DriveRecord, HEALTHY
from bev_preheat.vehicle.description import HVCH

# The compared planners, by the method they are set to.
COMPARED = {
    # The paper's heuristic, re-planned from the measured state on each battery state.
    'replanned_paper': Settings(method='paper', estimation=False, minimum_on_time_s=0.0,
                                minimum_off_time_s=0.0),
    'planner': Settings(),
}
# With long periods, commands and battery states are valid for this number of periods.
LEASE_PERIODS = 2.5
TIMEOUT_PERIODS = 5.0
# Times before arrival at which predictions are compared with it [s].
LEADS_S = (1800.0, 600.0, 300.0, 120.0)


@dataclass(frozen=True)
class DriveOutcome:
    """
    Outcome of one drive.

    `arrival_error_k` is the true temperature on arrival above the target [K], `heating_energy_wh` the HVCH's
    energy for the battery, `battery_energy_wh` the energy from the cells. `switch_ons` counts the rises of the
    command from 0 W. `verdicts` are the heater faults that the planner reported, in order; `fault_shown_s` and
    `fault_found_after_s` are those of `fault_times`. `refused`: a battery state was refused. `predictions` holds
    (seconds before arrival, error [K], stated standard deviation [K]) of the arrival temperature at LEADS_S; empty
    if no deviation is stated.
    """

    arrival_error_k: float
    heating_energy_wh: float
    battery_energy_wh: float
    switch_ons: int
    ran_empty: bool = False
    verdicts: tuple[str, ...] = ()
    fault_shown_s: float | None = None
    fault_found_after_s: float | None = None
    refused: bool = False
    predictions: tuple[tuple[float, float, float], ...] = ()


def settings_of_compared(method: str, period_s: float) -> Settings:
    """Return the Settings of a name in COMPARED or of a planning method, for a period [s]."""
    settings = COMPARED[method] if method in COMPARED else Settings(method=method)
    return replace(
        settings, command_period_s=period_s,
        command_lease_s=max(settings.command_lease_s, LEASE_PERIODS * period_s),
        battery_state_timeout_s=max(settings.battery_state_timeout_s, TIMEOUT_PERIODS * period_s))


def drive(car: ImperfectCar, settings: Settings, target_c: float,
          at_each_step: Callable[[], object] = lambda: None) -> DriveRecord:
    """Return the DriveRecord of a car under the planner with `settings`."""
    return drive_observed(car, Supervisor(car.vehicle, settings), target_c, progress=lambda *_: at_each_step())


def drive_with_planner(car: ImperfectCar, goal: Goal, settings: Settings) -> DriveOutcome:
    """Return the DriveOutcome of a single trip under the planner with `settings`."""
    supervisor, predicted = Supervisor(car.vehicle, settings), dict[float, tuple[float, float]]()

    def listen(time_s: float, _: float) -> None:
        decision, arrival_s = supervisor.state.decision, car.plant.route.total_duration_s
        for lead_s in LEADS_S:
            if lead_s not in predicted and 0.0 <= arrival_s - lead_s <= time_s and decision.plan is not None:
                predicted[lead_s] = decision.plan.arrival_temperature_c, decision.arrival_deviation_k

    record = drive_observed(car, supervisor, goal.target_temperature_c, progress=listen)
    shown_s, found_s = fault_times(record, car.imperfections.heater_faults, [(0.0, car.reports[0].ended_s)])
    return _outcome(car, goal, record.switch_ons, verdicts=heater_faults_in(record), fault_shown_s=shown_s,
                    fault_found_after_s=found_s, refused=Status.INVALID_INPUT.name in record.statuses,
                    predictions=tuple((lead_s, said_c - arrival_c(car), deviation_k)
                                      for lead_s, (said_c, deviation_k) in predicted.items()
                                      if np.isfinite(deviation_k)))


def heater_faults_in(record: DriveRecord) -> tuple[str, ...]:
    """Return the faults of the heater that were reported, in order."""
    return tuple(dict.fromkeys(said for _, said in record.heater_verdicts if said != HEALTHY))


def fault_times(record: DriveRecord, faults: Sequence[HeaterFault],
                drives_s: Iterable[tuple[float, float]]) -> tuple[float | None, float | None]:
    """
    Return how long the first real heater fault had an effect, and the driving time until it was found [s].

    `drives_s` are the spans of the drives [s]. The fault has an effect until it is found: a weak heater while heat
    is commanded, uncommanded heat while none is; None: no effect. The time to detection counts from the first
    effect; None: never found. Another source than the HVCH is found when it is named, with whatever fault.
    """
    if not faults:
        return None, None
    fault, driven_s = faults[0], 0.0
    kind = Heater.STUCK_ON if fault.stuck_on else Heater.DEAD if fault.share == 0.0 else Heater.DERATED
    name, shown, named_s = f'{kind.value}, ' if fault.source == HVCH else f'{fault.source} ', [], []
    for start_s, end_s in drives_s:
        commands = [(at_s, command.power_w(fault.source)) for (at_s, _, _), command in zip(
            record.commands, record.by_source) if start_s <= at_s < end_s]
        for (at_s, power_w), until_s in zip(commands, [*(at_s for at_s, _ in commands[1:]), end_s]):
            if until_s > max(at_s, fault.from_s) and (power_w == 0.0) == fault.stuck_on:
                shown.append((driven_s + max(at_s, fault.from_s) - start_s, driven_s + until_s - start_s))
        named_s += [driven_s + at_s - start_s for at_s, said in record.heater_verdicts
                    if name in f'{said}, ' and start_s <= at_s < end_s]
        driven_s += end_s - start_s
    if not shown:
        return None, None
    first_s = shown[0][0]
    found_s = min((at_s for at_s in named_s if at_s >= first_s), default=None)
    until_s = driven_s if found_s is None else found_s
    return (sum(max(0.0, min(to_s, until_s) - from_s) for from_s, to_s in shown),
            None if found_s is None else found_s - first_s)


def drive_informed(car: ImperfectCar, goal: Goal) -> DriveOutcome:
    """
    Return the DriveOutcome of a car under a single plan that knows the true car, its heat path, and drive.

    The plan's steps are as long as the planner's; it is executed without feedback from the battery.
    """
    plant = car.plant
    plan = plan_preheating(plant.vehicle, in_planning_steps(plant.route, Settings.planning_step_s),
                           BatteryState(plant.temperature_c, plant.soc), goal)
    switchings_s = [instant_s for instant_s in (plan.heating_start_s, plan.heating_end_s)
                    if instant_s is not None]
    # The plan's power is constant between two of these.
    edges_s = np.unique(np.concatenate((plan.time_s, switchings_s))).tolist()
    before_w, switch_ons = 0.0, 0
    for from_s, to_s in zip(edges_s[:-1], edges_s[1:]):
        power_w = plan.power_at_w(from_s)
        switch_ons += power_w > 0.0 == before_w
        if plan.source_power_w:
            step = int(plan.time_s.searchsorted(from_s, side='right')) - 1
            plant.sources.commands_w = {name: float(of_w[step]) for name, of_w in plan.source_power_w.items()}
            plant.advance(to_s, plant.sources.commands_w[HVCH])
        else:
            plant.advance(to_s, power_w)
        before_w = power_w
    return _outcome(car, goal, switch_ons)


def arrival_c(car: ImperfectCar) -> float:
    """Return the battery temperature of a car [deg C]; of a shell and a core that its file omits, the mean."""
    plant, path = car.plant, car.plant.vehicle.heat_path
    share = path.shell_share if path.is_shell and not car.vehicle.heat_path.is_shell else 0.0
    return plant.temperature_c + share * (plant.coolant_c - plant.temperature_c)


def _outcome(car: ImperfectCar, goal: Goal, switch_ons: int, **observed: object) -> DriveOutcome:
    plant = car.plant
    return DriveOutcome(
        arrival_c(car) - goal.target_temperature_c, plant.energy_wh.hvch_electric,
        plant.energy_wh.battery_total, switch_ons, plant.empty_at_s is not None,
        **observed)  # type: ignore[arg-type]
