# SPDX-License-Identifier: Apache-2.0
"""The messages of a heater controller: commands read, status and diagnostics written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bev_preheat.control.events import HeaterStatusArrived, HeaterStatusUnreadable
from bev_preheat.control.heater_answer import HeaterStatus
from bev_preheat.errors import InvalidInput, shortened
from bev_preheat.heater.controller import HeaterCommand, Refusal
from bev_preheat.nodes.convert import nanoseconds, stamp_problems, time_message
from bev_preheat_msgs.msg import HvchStatus

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from bev_preheat.control.heater_answer import HeaterAnswerReport
    from bev_preheat.heater.controller import HeaterAnswer
    from bev_preheat_msgs.msg import HvchCommand

REFUSALS = frozenset(map(int, Refusal))
# A measured power may lie this share above the heater's maximum.
ABOVE_MAXIMUM = 0.1
LONGEST_HEATER_REASON = 200
# Others are OK: the heater follows the command within its limits.
# The heater's status is published so often [s].
STATUS_PERIOD_S = 0.5
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


class RefusalNews:
    """Words for the log when a refusal begins or ends."""

    def __init__(self) -> None:
        """Start as a heater does: without a command."""
        self._refusal, self._told = Refusal.NO_COMMAND, ''

    def sentence(self, answer: HeaterAnswer) -> tuple[bool, str]:
        """Return whether the heater is refused now, and the news since the call before; '' without news."""
        is_refused = answer.refusal in LEVELS
        if answer.refusal is self._refusal:
            return is_refused, ''
        ended = f'{self._told} is over' if self._told else ''
        begun = f'{answer.refusal.name}: {answer.sentence}' if is_refused else 'the command is served'
        sentence = '; '.join(filter(None, [ended, begun if is_refused or ended else '']))
        self._refusal, self._told = answer.refusal, answer.refusal.name if is_refused else ''
        return is_refused, sentence


def heater_command(message: HvchCommand, sender: Hashable = None) -> HeaterCommand:
    """Return the HeaterCommand of a message; the controller checks it."""
    return HeaterCommand(float(message.battery_heating_power), nanoseconds(message.header.stamp),
                         nanoseconds(message.valid_until), sender)


def heater_status_event(message: HvchStatus,
                        maximum_power_w: float) -> HeaterStatusArrived | HeaterStatusUnreadable:
    """Return the event of an HvchStatus; powers up to ABOVE_MAXIMUM above the heater's maximum [W] count as it."""
    most_w = (1.0 + ABOVE_MAXIMUM) * maximum_power_w
    powers = {'requested_power': message.requested_power, 'active_power': message.active_power}
    if message.measured_power_known:
        powers['measured_power'] = message.measured_power
    problems = [f'{name}: {power_w:g} W is not allowed; it must be 0 ... {maximum_power_w:g} W'
                for name, power_w in powers.items() if not 0.0 <= power_w <= most_w]
    problems += stamp_problems(message.header.stamp)
    if problems:
        return HeaterStatusUnreadable(InvalidInput(problems))
    refusal = Refusal(message.refusal) if message.refusal in REFUSALS else Refusal.OTHER
    return HeaterStatusArrived(HeaterStatus(
        nanoseconds(message.header.stamp), min(message.requested_power, maximum_power_w),
        min(message.active_power, maximum_power_w), refusal, shortened(message.explanation, LONGEST_HEATER_REASON),
        min(message.measured_power, maximum_power_w) if message.measured_power_known else None))


def heater_answer_entry(name: str, hardware: str, report: HeaterAnswerReport) -> DiagnosticStatus:
    """Return the planner's entry on `hvch_status`: ERROR in doubt, WARN for a refusal or silence."""
    level = (DiagnosticStatus.ERROR if report.doubt else DiagnosticStatus.WARN
             if report.refusal or report.silence or report.problem else DiagnosticStatus.OK)
    status = report.status
    values = {} if status is None else {
        'requested power [W]': f'{status.requested_w:.0f}', 'active power [W]': f'{status.active_w:.0f}',
        'measured power [W]': 'not measured' if status.measured_w is None else f'{status.measured_w:.0f}',
        'refusal': status.refusal.name, 'explanation': status.sentence}
    return DiagnosticStatus(
        name=f'{name}: heater status', hardware_id=hardware, level=level,
        message=report.doubt or report.refusal or report.silence or report.problem or 'the command is served',
        values=[KeyValue(key=key, value=value) for key, value in values.items()])


def status_message(answer: HeaterAnswer, now_ns: int, measured_w: float | None = None) -> HvchStatus:
    """Return the HvchStatus of an answer at an instant [ns]; `measured_w` [W] None: not measured."""
    message = HvchStatus(
        requested_power=answer.requested_w, active_power=answer.active_w,
        measured_power=0.0 if measured_w is None else measured_w, measured_power_known=measured_w is not None,
        refusal=int(answer.refusal), explanation=answer.sentence)
    message.header.stamp = time_message(now_ns)
    return message


def heater_diagnostics(node_name: str, vehicle_name: str, answer: HeaterAnswer, now_ns: int,
                       others: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return the DiagnosticArray with the entry `NODE: command` and other entries."""
    message = DiagnosticArray(status=[DiagnosticStatus(
        name=f'{node_name.lstrip("/")}: command', hardware_id=vehicle_name,
        level=LEVELS.get(answer.refusal, DiagnosticStatus.OK),
        message=f'{answer.refusal.name}: {answer.sentence}' if answer.sentence else 'the command is served',
        values=[KeyValue(key='requested power [W]', value=f'{answer.requested_w:.1f}'),
                KeyValue(key='active power [W]', value=f'{answer.active_w:.1f}')]), *others])
    message.header.stamp = time_message(now_ns)
    return message
