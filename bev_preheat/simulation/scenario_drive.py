# SPDX-License-Identifier: Apache-2.0
"""Drives a car, or a scenario's, under the planner's own step and observes it, without ROS."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.control.settings import settings_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.simulation.evaluation import DriveRecord, fill_phases, PhaseEnd
from bev_preheat.simulation.supervised_drive import moments

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.control.state import State
    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.scenario import Scenario
    from bev_preheat.simulation.supervised_drive import Moment, Wire

# The planner is observed for this long after the arrival [s].
AFTERWARDS_S = 120.0


def drive_scenario(
        scenario: Scenario,
        progress: Callable[[float, float], object] = lambda time_s, total_s: None,
        wire: Callable[[Supervisor], Wire] | None = None) -> DriveRecord:
    """
    Return the DriveRecord of a Scenario.

    `progress(time_s, total_s)` is called during the drive; `wire(supervisor)` makes its Wire, None: none.
    """
    car = scenario.car()
    record = drive_observed(car, Supervisor(scenario.vehicle, settings_of(scenario.planner)),
                            scenario.goal.target_temperature_c, AFTERWARDS_S, progress, wire)
    fill_phases(record, scenario, [
        PhaseEnd(report.started_s, report.ended_s, report.arrival_c) for report in car.reports])
    return record


def drive_observed(
        car: ImperfectCar, supervisor: Supervisor, target_c: float, afterwards_s: float = 0.0,
        progress: Callable[[float, float], object] = lambda time_s, total_s: None,
        wire: Callable[[Supervisor], Wire] | None = None) -> DriveRecord:
    """Return the DriveRecord of a car under a Supervisor, until `afterwards_s` [s] after its last phase."""
    record = DriveRecord(target_c)
    ended_s = math.inf

    def is_over() -> bool:
        nonlocal ended_s
        if car.is_over:
            ended_s = min(ended_s, car.time_s)
        return car.time_s >= ended_s + afterwards_s

    for moment in moments(car, supervisor, is_over, wire=None if wire is None else wire(supervisor)):
        _note(record, moment, supervisor.state, car)
        progress(car.time_s, max(car.time_s, car.longest_s) + afterwards_s)
    return record


def _note(record: DriveRecord, moment: Moment, state: State, car: ImperfectCar) -> None:
    output = moment.output
    if output.decision is not None:
        record.statuses.add(output.decision.status.name)
    if output.command is not None:
        reason, power_w = output.command.reason.name, output.command.battery_heating_power_w
        record.statuses.add(reason)
        record.commands.append((moment.clock_s, power_w, reason))
        if power_w > 0.0:
            record.hottest_heated_c = max(record.hottest_heated_c, car.plant.temperature_c)
    if state.estimate is not None and not car.is_over:
        record.note_heater(moment.clock_s, state.estimate.heater.heater.value)
    record.regimes.append((moment.clock_s, state.regime.regime.value))
    record.note_signals(moment.clock_s, {verdict.signal for verdict in state.signal_verdicts})
