# SPDX-License-Identifier: Apache-2.0
"""One drive: the planner's Supervisor and a simulated car, each second or so, without ROS."""

from dataclasses import dataclass
import math
from time import process_time
from typing import Optional

import numpy as np

from bev_preheat.control.inputs import in_planning_steps, Measurement, NS_PER_S
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.simulation.heater_lease import HeaterLease

# The drives start at this instant of the planner's clock; 0 would mean that it has not started.
START_NS = 1000 * NS_PER_S
# Less than this share of what the cabin leaves is partial duty.
FULL_SHARE = 0.95


@dataclass(frozen=True)
class Drive:
    """
    What became of one drive.

    `arrival_error_k` is the true temperature on arrival above the target [K], `heating_energy_wh`
    what the HVCH spent on the battery, `battery_energy_wh` what the cells gave. `switch_ons`
    counts how often the command rose from 0 W, first at `first_switch_on_s` [s], None where it
    never did; `partial_duty_s` is how long it was more than 0 W and less than FULL_SHARE of what
    the cabin leaves.
    `refused_inputs` counts battery states that were refused, `updates_without_plan` the updates
    after which nothing could be planned, `updates` all. `planner_cpu_s` is the planner's time.
    """

    arrival_error_k: float
    arrival_soc: float
    heating_energy_wh: float
    battery_energy_wh: float
    switch_ons: int
    first_switch_on_s: Optional[float]
    partial_duty_s: float
    ran_empty: bool
    refused_inputs: int = 0
    updates_without_plan: int = 0
    updates: int = 0
    planner_cpu_s: float = 0.0


@dataclass(frozen=True)
class Course:
    """
    A drive over time; arrays of shape (updates,).

    Instants [s], temperatures [deg C]: true, measured, as the planner estimates it, and as it
    predicts it for the arrival (NaN where it does not); command [W].
    """

    time_s: np.ndarray
    true_c: np.ndarray
    measured_c: np.ndarray
    estimated_c: np.ndarray
    predicted_arrival_c: np.ndarray
    command_w: np.ndarray


class _Tally:
    """What commands amount to."""

    def __init__(self, vehicle, route):
        self._vehicle, self._route = vehicle, route
        self.switch_ons, self.first_switch_on_s, self.partial_duty_s = 0, None, 0.0
        self._power_w = 0.0

    def note(self, from_s, to_s, power_w):
        """Note a power [W] that is commanded between two instants [s]."""
        if power_w > 0.0 and self._power_w == 0.0:
            self.switch_ons += 1
            if self.first_switch_on_s is None:
                self.first_switch_on_s = from_s
        self._power_w = power_w
        cabin_w = float(self._route.cabin_heating_power_w[self._route.segment_at(from_s)])
        if 0.0 < power_w < FULL_SHARE * (self._vehicle.hvch.maximum_power_w - cabin_w):
            self.partial_duty_s += min(to_s, self._route.total_duration_s) - from_s


def drive_with_planner(car, goal, settings, period_s):
    """
    Return (Drive, Course) of a car under a Supervisor with `settings`.

    Every `period_s` [s] the supervisor gets the readings that have arrived, plans and commands.
    """
    supervisor = Supervisor(car.vehicle, settings)
    supervisor.accept_mission(car.mission(START_NS).in_planning_steps(settings.planning_step_s))
    plant, tally, rows, cpu_s = car.plant, _Tally(car.vehicle, car.plant.route), [], 0.0
    refused, without_plan, measured_c = 0, 0, math.nan
    while not plant.is_standing:
        now_s = car.time_s
        now_ns = START_NS + round(now_s * NS_PER_S)
        readings = car.readings()
        started = process_time()
        for reading in readings:
            measured_c = reading.temperature_c
            refused += not _accepted(supervisor, reading, now_ns)
        decision = supervisor.replan(now_ns)
        command = supervisor.command(now_ns)
        cpu_s += process_time() - started
        without_plan += decision.status is Status.INVALID_INPUT
        power_w = command.battery_heating_power_w
        tally.note(now_s, now_s + period_s, power_w)
        estimate, plan = supervisor.estimate, decision.plan
        rows.append((now_s, plant.temperature_c, measured_c,
                     math.nan if estimate is None else estimate.temperature_c,
                     math.nan if plan is None else plan.arrival_temperature_c, power_w))
        # Numbered, not summed up: sums of periods do not end on the readings' instants.
        car.advance_under(
            HeaterLease(power_w, (command.valid_until_ns - START_NS) / NS_PER_S),
            len(rows) * period_s)
    drive = _drive(plant, goal, tally, refused_inputs=refused, updates_without_plan=without_plan,
                   updates=len(rows), planner_cpu_s=cpu_s)
    return drive, Course(*np.array(rows).T)


def drive_informed(car, goal):
    """
    Return the Drive of a car under one plan, made at the start, that knows the true car and drive.

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
    tally = _Tally(car.vehicle, plant.route)
    for from_s, to_s in zip(edges_s[:-1].tolist(), edges_s[1:].tolist()):
        power_w = plan.power_at_w(from_s)
        tally.note(from_s, to_s, power_w)
        plant.advance(to_s, power_w)
    return _drive(plant, goal, tally)


def _accepted(supervisor, reading, now_ns):
    state = BatteryState(reading.temperature_c, reading.soc)
    stamp_ns = START_NS + round(reading.instant_s * NS_PER_S)
    try:
        supervisor.accept_battery(
            Measurement(state, stamp_ns, reading.voltage_v, reading.current_a), now_ns)
    except InvalidInput:
        return False
    return True


def _drive(plant, goal, tally, **counted):
    energy_wh = plant.energy_wh
    return Drive(
        arrival_error_k=plant.temperature_c - goal.target_temperature_c,
        arrival_soc=plant.soc,
        heating_energy_wh=energy_wh.hvch_electric,
        battery_energy_wh=energy_wh.battery_total,
        switch_ons=tally.switch_ons,
        first_switch_on_s=tally.first_switch_on_s,
        partial_duty_s=tally.partial_duty_s,
        ran_empty=plant.empty_at_s is not None, **counted)
