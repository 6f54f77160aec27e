# SPDX-License-Identifier: Apache-2.0
"""A scenario driven with the planner's own step, without ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.experiments.supervised_drive import moments
from bev_preheat.simulation.evaluation import DriveRecord
from bev_preheat.supervision.settings import settings_of
from bev_preheat.supervision.supervisor import Supervisor

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.simulation.scenario import Scenario

# How long the planner is watched after the arrival [s].
AFTERWARDS_S = 120.0


def drive_scenario(
        scenario: Scenario,
        progress: Callable[[float, float], object] = lambda time_s, total_s: None) -> DriveRecord:
    """
    Return the DriveRecord of a Scenario.

    `progress(time_s, total_s)` is called as the drive goes on.
    """
    supervisor, car = Supervisor(scenario.vehicle, settings_of(scenario.planner)), scenario.car()
    record = DriveRecord(scenario.goal.target_temperature_c)
    total_s = car.plant.duration_s + AFTERWARDS_S
    for moment in moments(car, supervisor, lambda: car.time_s >= total_s):
        for output in moment.outputs:
            if output.decision is not None:
                record.statuses.add(output.decision.status.name)
            if output.command is not None:
                reason = output.command.reason.name
                record.statuses.add(reason)
                record.commands.append(
                    (moment.clock_s, output.command.battery_heating_power_w, reason))
        if supervisor.estimate is not None and not car.plant.is_standing:
            record.heater = supervisor.estimate.heater.heater.value
        progress(car.time_s, total_s)
    if car.plant.has_arrived:
        record.arrival_c = car.plant.temperature_c
    return record
