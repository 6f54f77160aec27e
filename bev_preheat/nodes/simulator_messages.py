# SPDX-License-Identifier: Apache-2.0
"""The messages of the simulated vehicle."""

from __future__ import annotations

from dataclasses import dataclass, fields
import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import BatteryState

from bev_preheat.planning.dynamics import Energies
from bev_preheat.simulation.evaluation import PhaseEnd
from bev_preheat.simulation.phases import Charge, Park

if TYPE_CHECKING:
    from dataclasses import Field
    from typing import Any

    from builtin_interfaces.msg import Time

    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.phases import Phase
    from bev_preheat.simulation.sensors import Reading

# The name of the entry in /diagnostics begins with the node's name.
ENTRY = ': trip'
TEMPERATURE = 'battery temperature [degC]'
WITHOUT_COMMAND = 'time without a valid command [s]'
DRIVING, ARRIVED, EMPTY = 'driving', 'arrived', 'the battery is empty'
CHARGING, PARKED = 'charging', 'parked'
# Keys of a finished phase, by fields of PhaseEnd and PhaseReport.
PHASE_KEYS = {'started_s': 'start [s]', 'ended_s': 'end [s]', 'arrival_c': 'arrival temperature [degC]'}


@dataclass(frozen=True)
class SimulatedDriveReport:
    """
    The state of a trip: DRIVING, CHARGING, PARKED, ARRIVED or EMPTY, and its energies so far [Wh].

    `without_command_s` is how long the vehicle drove without a valid heater command [s].
    """

    state: str
    energy_wh: Energies
    without_command_s: float


def battery_state_message(reading: Reading, capacity_ah: float, stamp: Time) -> BatteryState:
    """Return the BatteryState of a Reading [capacity: Ah]; unknown fields are NaN."""
    current_a = math.nan if reading.current_a is None else reading.current_a
    message = BatteryState(
        voltage=math.nan if reading.voltage_v is None else reading.voltage_v,
        temperature=reading.temperature_c,
        # sensor_msgs has it negative when discharging.
        current=-current_a,
        charge=reading.soc * capacity_ah,
        capacity=math.nan,
        design_capacity=capacity_ah,
        percentage=reading.soc,
        power_supply_status=int(reading.supply_status),
        location=reading.location,
        power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_UNKNOWN,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_UNKNOWN,
        present=True)
    message.header.stamp = stamp
    return message


def trip_diagnostics(node_name: str, car: ImperfectCar, stamp: Time) -> DiagnosticArray:
    """Return the DiagnosticArray with the true state so far, and the end of each phase."""
    plant = car.plant
    if plant.empty_at_s is not None:
        level, text = DiagnosticStatus.ERROR, EMPTY
    else:
        level = DiagnosticStatus.WARN if plant.undeliverable_power_w else DiagnosticStatus.OK
        text = ARRIVED if car.is_over else _doing(car.phase)
    values = {
        'time [s]': plant.time_s,
        TEMPERATURE: plant.temperature_c,
        'state of charge [1]': plant.soc,
        WITHOUT_COMMAND: plant.without_lease_s,
        'friction brake energy [Wh]': plant.friction_brake_energy_wh,
        'undeliverable power [W]': plant.undeliverable_power_w,
        'undeliverable energy [Wh]': plant.undeliverable_energy_wh,
        **{_energy_key(field): getattr(plant.energy_wh, field.name) for field in fields(Energies)},
        **{f'phase {number}: {key}': getattr(report, name)
           for number, report in enumerate(car.reports, start=1) for name, key in PHASE_KEYS.items()},
    }
    message = DiagnosticArray(status=[DiagnosticStatus(
        name=node_name.lstrip('/') + ENTRY, hardware_id=plant.vehicle.name, level=level, message=text,
        values=[KeyValue(key=key, value=f'{value:.4f}') for key, value in values.items()])])
    message.header.stamp = stamp
    return message


def outcome_from_diagnostics(message: DiagnosticArray) -> SimulatedDriveReport | None:
    """Return the SimulatedDriveReport in the simulator's DiagnosticArray; None for any other."""
    for status in message.status:
        if status.name.endswith(ENTRY):
            values = {item.key: item.value for item in status.values}
            return SimulatedDriveReport(
                state=status.message,
                energy_wh=Energies(**{field.name: float(values[_energy_key(field)])
                                      for field in fields(Energies)}),
                without_command_s=float(values[WITHOUT_COMMAND]))
    return None


def lost_commands_sentence(without_command_s: float, speed_up: float | None) -> str:
    """
    Return the cause of `without_command_s` [s] of a drive without a valid command.

    `speed_up` is in simulated seconds per real second; None: in lockstep.
    """
    sentence = f'but no command was valid for {without_command_s:.1f} s of the drive: '
    if speed_up is None:
        return sentence + 'the planner sent none'
    return sentence + (f'this computer was too slow for {speed_up:g} times real time; without --speed-up the '
                       'drive waits for every command')


def phase_ends(message: DiagnosticArray) -> list[PhaseEnd]:
    """Return the PhaseEnds in the simulator's DiagnosticArray."""
    (status,) = (status for status in message.status if status.name.endswith(ENTRY))
    values = {item.key: float(item.value) for item in status.values}
    ends: list[PhaseEnd] = []
    while f'phase {len(ends) + 1}: {PHASE_KEYS["started_s"]}' in values:
        number = len(ends) + 1
        ends.append(PhaseEnd(**{name: values[f'phase {number}: {key}'] for name, key in PHASE_KEYS.items()}))
    return ends


def _doing(phase: Phase) -> str:
    if isinstance(phase, Charge):
        return CHARGING
    return PARKED if isinstance(phase, Park) else DRIVING


def _energy_key(field: Field[Any]) -> str:
    return f'{field.name.replace("_", " ")} energy [Wh]'
