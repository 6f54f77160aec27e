# SPDX-License-Identifier: Apache-2.0
"""A scenario driven with the planner's own Supervisor, without ROS."""

import math

from bev_preheat.control.inputs import Measurement, NS_PER_S
from bev_preheat.control.settings import settings_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.evaluation import DriveRecord
from bev_preheat.simulation.heater_lease import HeaterLease

# The drive starts at this instant of the planner's clock; 0 would mean that it has not started.
START_NS = 1_000_000 * NS_PER_S
# How long it is watched after the arrival [s].
AFTERWARDS_S = 120.0


def drive_scenario(scenario, progress=lambda time_s, total_s: None):
    """
    Return the DriveRecord of a Scenario.

    Each command period the supervisor gets what has arrived, plans and commands.
    `progress(time_s, total_s)` is called as the drive goes on.
    """
    settings = settings_of(scenario.planner)
    supervisor, car = Supervisor(scenario.vehicle, settings), scenario.car()
    supervisor.accept_mission(car.mission(START_NS).in_planning_steps(settings.planning_step_s))
    record = DriveRecord(scenario.goal.target_temperature_c)
    total_s = car.plant.duration_s + AFTERWARDS_S
    period_s, steps = settings.command_period_s, 0
    while car.time_s < total_s:
        news = car.route_news(START_NS)
        if news is not None:
            supervisor.accept_mission(news.in_planning_steps(settings.planning_step_s))
        now_ns = START_NS + round(car.clock_s * NS_PER_S)
        for reading in car.readings():
            _hand_over(supervisor, reading,
                       START_NS + round(car.stamp_s(reading.instant_s) * NS_PER_S), now_ns)
        decision = supervisor.replan(now_ns)
        command = supervisor.command(now_ns)
        record.statuses |= {decision.status.name, command.reason.name}
        record.commands.append(
            (car.clock_s, command.battery_heating_power_w, command.reason.name))
        if supervisor.estimate is not None and not car.plant.is_standing:
            record.heater = supervisor.estimate.heater.heater.value
        lasts_s = (command.valid_until_ns - now_ns) / NS_PER_S
        steps += 1
        car.advance_under(HeaterLease(command.battery_heating_power_w, car.time_s + lasts_s),
                          steps * period_s)
        progress(car.time_s, total_s)
    if car.plant.has_arrived:
        record.arrival_c = car.plant.temperature_c
    return record


def _hand_over(supervisor, reading, stamp_ns, now_ns):
    """Give a Reading to the supervisor, as the planner's node would."""
    if math.isnan(reading.temperature_c):
        supervisor.refuse_battery(InvalidInput('temperature: nan is not a known value'))
        return
    state = BatteryState(reading.temperature_c, reading.soc)
    try:
        supervisor.accept_battery(
            Measurement(state, stamp_ns, reading.voltage_v, reading.current_a), now_ns)
    except InvalidInput:
        # Refused, which the supervisor has noted.
        pass
