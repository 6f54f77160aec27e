# SPDX-License-Identifier: Apache-2.0
"""The vehicle simulator's drive: its parameters, the car that they describe, and its entry in /diagnostics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
import math
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from bev_preheat.messages.diagnostics import entry, ERROR, OK, values_of, WARN
from bev_preheat.messages.fields import known
from bev_preheat.messages.route_offer import unused_in_goal
from bev_preheat.messages.route_plan import charger_of
from bev_preheat.nodes.node import Values
from bev_preheat.nodes.parameters import GOAL_PARAMETERS, Parameter, StartParameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.planning.dynamics import Energies
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.route import route_for
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import Charge, DrivePhase, Park, Phase
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.scenario_drive import PhaseEnd
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle

PARAMETERS = (
    StartParameter('scenario', '', 'Faults and disturbances: a name in config/scenarios or a YAML file, which '
                   'also sets car, drive, battery and charger. Empty: none.'),
    StartParameter('vehicle', 'reference', 'Vehicle: a name in config/vehicles or a YAML file.'),
    StartParameter('route', 'reference', 'Route: a name in config/routes or a file with an ambient temperature.'),
    StartParameter('initial_battery_temperature', -7.0, 'Battery temperature at the start', 'degC', (-60.0, 60.0)),
    StartParameter('initial_soc', 0.9, 'State of charge at the start', '', (0.0, 1.0)),
    *(replace(each, read_only=True) for each in GOAL_PARAMETERS),
    StartParameter('publish_clock', True, 'Publish /clock; false: the drive follows the clock of the node.'),
    StartParameter('start_time', 0.0, 'Simulated time at the start, since the epoch; 0: now', 's', (0.0, 2.1e9)),
    StartParameter('lockstep', False, 'Let the clock go on once the planner has handled every message; speed_up '
                   'must be 1.0.'),
    StartParameter('lockstep_limit', 60.0, 'In lockstep, a node that does not answer for this long ends the drive '
                   'with an error', 's', (0.5, 3600.0)),
    StartParameter('wait_for_planner', False, 'Hold the clock at the start until a planner with route and battery '
                   'state commands. lockstep does so anyway.'),
    StartParameter('wait_for_listeners', 0, 'Hold the clock at the start until battery_state has this many '
                   'subscriptions.', '', (0, 1000)),
    Parameter('speed_up', 1.0, 'Simulated seconds in each real second', '', (1.0, 1000.0)),
    Parameter('battery_state_period', 1.0,
              'Simulated time between two battery states', 's', (0.01, 60.0)),
    StartParameter('heater_status', False, "Publish hvch_status (and heat_source_status), the controllers' "
                   'answers to each command.'),
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
    ), name, [*filter(None, [loaded.warning]), *unused_in_goal(values)]


TRIP = 'trip'
ENERGIES = tuple(field.name for field in fields(Energies))
TEMPERATURE = 'battery temperature [degC]'
WITHOUT_COMMAND = 'time without a valid command [s]'
DRIVING, ARRIVED, EMPTY = 'driving', 'arrived', 'the battery is empty'
CHARGING, PARKED = 'charging', 'parked'
# Of phases but drives.
STATES: dict[type[Phase], str] = {Charge: CHARGING, Park: PARKED}
# Keys of a finished phase, by fields of PhaseEnd and PhaseReport.
PHASE_KEYS = {'started_s': 'start [s]', 'ended_s': 'end [s]', 'arrival_c': 'arrival temperature [degC]'}


@dataclass(frozen=True)
class SimulatedDriveReport:
    """
    The state of a trip: DRIVING, CHARGING, PARKED, ARRIVED or EMPTY, and its energies so far [Wh].

    `without_command_s` is how long the vehicle drove without a valid heater command [s]; `ends` are the ends of
    its phases so far.
    """

    state: str
    energy_wh: Energies
    without_command_s: float
    ends: tuple[PhaseEnd, ...] = ()


def trip_diagnostics(car: ImperfectCar) -> DiagnosticStatus:
    """Return the entry with the true state so far, and the end of each phase."""
    plant = car.plant
    if plant.empty_at_s is not None:
        level, text = ERROR, EMPTY
    else:
        level = WARN if plant.undeliverable_power_w else OK
        text = ARRIVED if car.is_over else STATES.get(type(car.phase), DRIVING)
    values = {
        'time [s]': plant.time_s,
        TEMPERATURE: plant.temperature_c,
        'state of charge [1]': plant.soc,
        WITHOUT_COMMAND: plant.without_lease_s,
        'friction brake energy [Wh]': plant.friction_brake_energy_wh,
        'undeliverable power [W]': plant.undeliverable_power_w,
        'undeliverable energy [Wh]': plant.undeliverable_energy_wh,
        **{_energy_key(name): getattr(plant.energy_wh, name) for name in ENERGIES},
        **{f'phase {number}: {key}': getattr(report, name)
           for number, report in enumerate(car.reports, start=1) for name, key in PHASE_KEYS.items()},
    }
    return entry(TRIP, level, text, {key: f'{value:.4f}' for key, value in values.items()})


def outcome_from_diagnostics(message: DiagnosticArray) -> SimulatedDriveReport | None:
    """Return the SimulatedDriveReport in the simulator's DiagnosticArray; None for any other."""
    for status in message.status:
        if status.name.endswith(f': {TRIP}'):
            values = {key: float(value) for key, value in values_of(status).items()}
            ends: list[PhaseEnd] = []
            while (phase := f'phase {len(ends) + 1}: ') + PHASE_KEYS['started_s'] in values:
                ends.append(PhaseEnd(**{name: values[phase + key] for name, key in PHASE_KEYS.items()}))
            return SimulatedDriveReport(
                status.message, Energies(**{name: values[_energy_key(name)] for name in ENERGIES}),
                values[WITHOUT_COMMAND], tuple(ends))
    return None


def _energy_key(name: str) -> str:
    return f'{name.replace("_", " ")} energy [Wh]'
