# SPDX-License-Identifier: Apache-2.0
"""The entry of the simulated drive in /diagnostics: written by the simulator, and read back."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from bev_preheat.messages.diagnostics import entry, ERROR, OK, values_of, WARN
from bev_preheat.planning.dynamics import Energies
from bev_preheat.simulation.phases import Charge, Park
from bev_preheat.simulation.scenario_drive import PhaseEnd

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.phases import Phase

TRIP = 'trip'
ENERGIES = tuple(field.name for field in fields(Energies))
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
        text = ARRIVED if car.is_over else _doing(car.phase)
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


def _doing(phase: Phase) -> str:
    if isinstance(phase, Charge):
        return CHARGING
    return PARKED if isinstance(phase, Park) else DRIVING


def _energy_key(name: str) -> str:
    return f'{name.replace("_", " ")} energy [Wh]'
