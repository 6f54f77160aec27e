# SPDX-License-Identifier: Apache-2.0
"""The messages of a heater controller: commands read, status and diagnostics written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bev_preheat.heater.controller import HeaterCommand, Refusal
from bev_preheat.nodes.convert import nanoseconds, time_message
from bev_preheat_msgs.msg import HvchStatus

if TYPE_CHECKING:
    from collections.abc import Hashable

    from bev_preheat.heater.controller import HeaterAnswer
    from bev_preheat_msgs.msg import HvchCommand

# Others are OK: the heater does as it is told, within its limits.
LEVELS = {
    Refusal.NO_COMMAND: DiagnosticStatus.WARN,
    Refusal.LOW_CHARGE: DiagnosticStatus.WARN,
    Refusal.HOT_BATTERY: DiagnosticStatus.WARN,
    Refusal.IN_MOTION: DiagnosticStatus.WARN,
    Refusal.OTHER: DiagnosticStatus.WARN,
    Refusal.INVALID_COMMAND: DiagnosticStatus.ERROR,
    Refusal.INVALID_LEASE: DiagnosticStatus.ERROR,
    Refusal.COMMAND_CONFLICT: DiagnosticStatus.ERROR,
    Refusal.HEATER_FAULT: DiagnosticStatus.ERROR,
}


def heater_command(message: HvchCommand, sender: Hashable = None) -> HeaterCommand:
    """Return the HeaterCommand of a message; the controller checks it."""
    return HeaterCommand(float(message.battery_heating_power), nanoseconds(message.header.stamp),
                         nanoseconds(message.valid_until), sender)


def status_message(answer: HeaterAnswer, now_ns: int, measured_w: float | None = None) -> HvchStatus:
    """Return the HvchStatus of an answer at an instant [ns]; `measured_w` [W] None: not measured."""
    message = HvchStatus(
        requested_power=answer.requested_w, active_power=answer.active_w,
        measured_power=0.0 if measured_w is None else measured_w, measured_power_known=measured_w is not None,
        refusal=int(answer.refusal), explanation=answer.sentence)
    message.header.stamp = time_message(now_ns)
    return message


def heater_diagnostics(node_name: str, vehicle_name: str, answer: HeaterAnswer, now_ns: int,
                       setup: DiagnosticStatus) -> DiagnosticArray:
    """Return the DiagnosticArray with the entry `NODE: command` and the entry on the setup."""
    message = DiagnosticArray(status=[DiagnosticStatus(
        name=f'{node_name.lstrip("/")}: command', hardware_id=vehicle_name,
        level=LEVELS.get(answer.refusal, DiagnosticStatus.OK),
        message=f'{answer.refusal.name}: {answer.sentence}' if answer.sentence else 'the command is served',
        values=[KeyValue(key='requested power [W]', value=f'{answer.requested_w:.1f}'),
                KeyValue(key='active power [W]', value=f'{answer.active_w:.1f}')]), setup])
    message.header.stamp = time_message(now_ns)
    return message
