# SPDX-License-Identifier: Apache-2.0
"""
The bytes (CDR) of the two messages that every recorded step has: HvchCommand and BatteryState.

Packing a command takes a tenth, and packing a battery state half of the time of rclpy's `serialize_message`.
"""

from __future__ import annotations

import struct
from struct import Struct
from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.control.decision import Command
from bev_preheat.messages.fields import time_message
from bev_preheat.messages.heater import command_message
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

# Little endian. Both begin with the stamp and frame_id '', its length first, padded to words.
_HEAD = b'\x00\x01\x00\x00'
# Power; valid_until; reason.
_COMMAND = Struct('<4siIIb3xdiIB')
# Voltage to percentage; the enumerations and `present`; the number of cell voltages.
_STATE = Struct('<4siIIb3x7f4BI')
_COUNT = Struct('<I')
# location and serial_number ''.
_NO_TEXTS = b'\x01\x00\x00\x00\x00\x00\x00\x00\x01\x00\x00\x00\x00'
_PROBE = (Command(1234.5, 1_700_000_001_000_000_003, Status.HEATING), 1_700_000_000_000_000_002)


def serialized(message: Any) -> bytes:
    """Return the bytes of any message, made by rclpy."""
    return bytes(serialize_message(message))


def _packed_command(commanded: tuple[Command, int]) -> bytes:
    command, now_ns = commanded
    sec, nanosec = divmod(now_ns, NS_PER_S)
    until_sec, until_nanosec = divmod(command.valid_until_ns, NS_PER_S)
    return _COMMAND.pack(_HEAD, sec, nanosec, 1, 0, command.battery_heating_power_w, until_sec, until_nanosec,
                         command.reason)


def _serialized_command(commanded: tuple[Command, int]) -> bytes:
    return serialized(command_message(*commanded))


def _packed_state(message: BatteryState) -> bytes:
    header = message.header
    stamp, voltages, temperatures = header.stamp, message.cell_voltage, message.cell_temperature
    if header.frame_id or message.location or message.serial_number:
        return serialized(message)
    try:
        head = _STATE.pack(
            _HEAD, stamp.sec, stamp.nanosec, 1, 0, message.voltage, message.temperature, message.current,
            message.charge, message.capacity, message.design_capacity, message.percentage,
            message.power_supply_status, message.power_supply_health, message.power_supply_technology,
            message.present, len(voltages))
    except (OverflowError, struct.error):
        # Beyond single precision.
        return serialized(message)
    return head + voltages.tobytes() + _COUNT.pack(len(temperatures)) + temperatures.tobytes() + _NO_TEXTS


def command_encoder() -> Callable[[tuple[Command, int]], bytes]:
    """Return a function for the bytes of a Command and the instant of its stamp [ns]."""
    return _packed_command if _fits(_packed_command(_PROBE), command_message(*_PROBE)) else _serialized_command


def state_encoder() -> Callable[[BatteryState], bytes]:
    """Return a function for the bytes of a BatteryState."""
    probe = BatteryState(
        voltage=1.5, temperature=2.5, current=3.5, charge=4.5, capacity=5.5, design_capacity=6.5, percentage=7.5,
        power_supply_status=1, power_supply_health=2, power_supply_technology=3, present=True,
        cell_voltage=[8.5, 9.5], cell_temperature=[10.5])
    probe.header.stamp = time_message(_PROBE[1])
    return _packed_state if _fits(_packed_state(probe), probe) else serialized


def _fits(data: bytes, message: HvchCommand | BatteryState) -> bool:
    """Return whether bytes are a message's: another middleware or version may have other bytes."""
    try:
        # Padding may have any bytes.
        return bool(deserialize_message(data, type(message)) == message) and len(data) == len(serialized(message))
    except Exception:
        return False
