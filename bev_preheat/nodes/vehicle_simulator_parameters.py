# SPDX-License-Identifier: Apache-2.0
"""The vehicle simulator's parameters: their table, and the car and drive that they describe."""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
from typing import TYPE_CHECKING

from bev_preheat.messages.fields import known
from bev_preheat.messages.route_plan import charger_of
from bev_preheat.nodes.parameters import GOAL_PARAMETERS, Parameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.route import route_for
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.nodes.node import Values

PARAMETERS = (
    Parameter('scenario', '', 'Faults and disturbances: a name in config/scenarios or a YAML file, which also '
              'sets car, drive, battery and charger. Empty: none.', read_only=True),
    Parameter('vehicle', 'reference', 'Vehicle: a name in config/vehicles or a YAML file.', read_only=True),
    Parameter('route', 'reference', 'Route: a name in config/routes or a file with an ambient temperature.',
              read_only=True),
    Parameter('initial_battery_temperature', -7.0, 'Battery temperature at the start', 'degC', (-60.0, 60.0),
              read_only=True),
    Parameter('initial_soc', 0.9, 'State of charge at the start', '', (0.0, 1.0), read_only=True),
    *(replace(each, read_only=True) for each in GOAL_PARAMETERS),
    Parameter('publish_clock', True, 'Publish /clock; false: the drive follows the clock of the node.',
              read_only=True),
    Parameter('start_time', 0.0, 'Simulated time at the start, since the epoch; 0: now', 's',
              (0.0, 2.1e9), read_only=True),
    Parameter('lockstep', False,
              'Let the clock go on once the planner has handled every message; speed_up must be 1.0.',
              read_only=True),
    Parameter('lockstep_limit', 60.0,
              'In lockstep, a node that does not answer for this long ends the drive with an error', 's',
              (0.5, 3600.0), read_only=True),
    Parameter('wait_for_planner', False,
              'Hold the clock at the start until a planner with route and battery state commands. lockstep does '
              'so anyway.', read_only=True),
    Parameter('wait_for_listeners', 0,
              'Hold the clock at the start until battery_state has this many subscriptions.', '',
              (0, 1000), read_only=True),
    Parameter('speed_up', 1.0, 'Simulated seconds in each real second', '', (1.0, 1000.0)),
    Parameter('battery_state_period', 1.0,
              'Simulated time between two battery states', 's', (0.01, 60.0)),
    Parameter('heater_status', False, "Publish hvch_status (and heat_source_status), the controllers' answers to "
              'each command.', read_only=True),
    Parameter('exit_on_arrival', False,
              'End the process some seconds after the drive has ended.'),
)

PROGRAM = NodeProgram(
    'vehicle_simulator', 'Drives a route in simulated time and heats its battery as hvch_command '
    'allows.', PARAMETERS,
    subscribes=(('hvch_command', 'bev_preheat_msgs/HvchCommand'),
                ('heat_source_command', 'bev_preheat_msgs/HeatSourceCommand, if the vehicle has heat_sources')),
    publishes=(('battery_state', 'sensor_msgs/BatteryState'),
               ('route_plan', 'bev_preheat_msgs/RoutePlan'),
               ('route_progress', 'bev_preheat_msgs/RouteProgress, where the scenario has it'),
               ('hvch_status', 'bev_preheat_msgs/HvchStatus, with heater_status'),
               ('heat_source_status', 'bev_preheat_msgs/HeatSourceStatus, with heater_status and heat_sources'),
               ('/clock', 'rosgraph_msgs/Clock, with publish_clock'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')))


def departure(values: Values) -> tuple[ImperfectCar, str, Iterable[str]]:
    """Return (ImperfectCar, name of its route, warnings); raises InvalidInput if values do not fit together."""
    if values['scenario']:
        scenario = load_scenario(values['scenario'])
        return scenario.car(), scenario.name, scenario.warnings
    vehicle = load_vehicle(values['vehicle'])
    loaded = route_for(values['route'], vehicle)
    route = loaded.route
    state = BatteryState(values['initial_battery_temperature'], values['initial_soc'])
    target_c = values['target_battery_temperature'] or math.nan
    goal = Goal(target_c, values['minimum_arrival_soc'], values['charging_planned'],
                maximum_arrival_temperature_c=known(values['maximum_arrival_temperature']) or math.inf)
    check_situation(vehicle, route=route, state=state, goal=goal if math.isfinite(target_c) else
                    replace(goal, target_temperature_c=vehicle.defaults.target_battery_temperature_c))
    name = Path(values['route']).stem
    charger = charger_of(values['charger_power'], values['charging_departure_soc'])
    return ImperfectCar(
        vehicle, DrivePhase(route, goal, charger=charger), state,
        Imperfections(sensors=Sensors(period_s=values['battery_state_period'])), route_id=name
    ), name, filter(None, [loaded.warning])
