# SPDX-License-Identifier: Apache-2.0
"""
The messages between planner and heater controllers: HvchCommand and HvchStatus.

HeatSourceCommand and HeatSourceStatus are the same for another heat source of the vehicle, with its name.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from functools import partial
from typing import Any

from bev_preheat.control.decision import Command
from bev_preheat.control.events import (
    HeaterStatusArrived,
    HeaterStatusUnreadable,
    SourceStatusArrived,
    SourceStatusUnreadable,
)
from bev_preheat.control.heater import HeaterStatus
from bev_preheat.errors import InvalidInput, shortened
from bev_preheat.messages.fields import nanoseconds, stamp_problems, time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.description import HVCH, Vehicle
from bev_preheat.vehicle.heater_controller import HeaterAnswer, HeaterCommand, Refusal
from bev_preheat_msgs.msg import HeatSourceCommand, HeatSourceStatus, HvchCommand, HvchStatus

REFUSALS = frozenset(map(int, Refusal))
# A measured power may lie this share above the heater's maximum.
ABOVE_MAXIMUM = 0.1
LONGEST_HEATER_REASON = 200


def command_message(command: Command, now_ns: int, message: Any = None) -> Any:
    """Return the HvchCommand of a Command made now, or fill the same fields of another message but the power."""
    message = HvchCommand() if message is None else message
    # Filled in place, because rclpy creates the parts of a message anyway and the heater waits for this one.
    stamp, valid_until = message.header.stamp, message.valid_until
    stamp.sec, stamp.nanosec = divmod(now_ns, NS_PER_S)
    valid_until.sec, valid_until.nanosec = divmod(command.valid_until_ns, NS_PER_S)
    message.battery_heating_power = command.battery_heating_power_w
    message.reason = int(command.reason)
    return message


def source_messages(command: Command, vehicle: Vehicle, now_ns: int) -> Iterator[HeatSourceCommand]:
    """Yield the HeatSourceCommand of each heat source of a Vehicle beside the HVCH, for a Command made now."""
    for source in vehicle.heat_sources:
        message = command_message(command, now_ns, HeatSourceCommand(name=source.name))
        message.battery_heating_power = command.power_w(source.name)
        yield message


def heater_command(message: HvchCommand | HeatSourceCommand, sender: Hashable = None) -> HeaterCommand:
    """Return the HeaterCommand of a message; the controller checks it."""
    return HeaterCommand(float(message.battery_heating_power), nanoseconds(message.header.stamp),
                         nanoseconds(message.valid_until), sender)


def source_status_event(message: HeatSourceStatus,
                        vehicle: Vehicle) -> HeaterStatusArrived | HeaterStatusUnreadable:
    """Return the event of a HeatSourceStatus, as `heater_status_event`; the HVCH has a message of its own."""
    try:
        if message.name == HVCH:
            raise InvalidInput(f'name: {HVCH} is not allowed; its controller answers with hvch_status')
        event = heater_status_event(message, vehicle.most_w(message.name))
    except InvalidInput as error:
        return SourceStatusUnreadable(error, message.name)
    return (SourceStatusArrived(event.status, message.name) if isinstance(event, HeaterStatusArrived) else
            SourceStatusUnreadable(event.error, message.name))


def heater_status_event(message: HvchStatus | HeatSourceStatus,
                        maximum_power_w: float) -> HeaterStatusArrived | HeaterStatusUnreadable:
    """Return the event of a status; powers up to ABOVE_MAXIMUM above the heater's maximum [W] count as it."""
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


def status_message(answer: HeaterAnswer, now_ns: int, measured_w: float | None = None, name: str = HVCH) -> Any:
    """
    Return the HvchStatus of an answer at an instant [ns]; `measured_w` [W] None: not measured.

    Of another heat source, by its name, it is a HeatSourceStatus.
    """
    message = (HvchStatus if name == HVCH else partial(HeatSourceStatus, name=name))(
        requested_power=answer.requested_w, active_power=answer.active_w,
        measured_power=0.0 if measured_w is None else measured_w, measured_power_known=measured_w is not None,
        refusal=int(answer.refusal), explanation=answer.sentence)
    message.header.stamp = time_message(now_ns)
    return message
