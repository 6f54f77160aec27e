# SPDX-License-Identifier: Apache-2.0
"""The bytes (CDR) of an HvchCommand, for recordings."""

from __future__ import annotations

from struct import Struct
from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message, serialize_message

from bev_preheat.control.decision import Command
from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.nodes.convert import command_message
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand

if TYPE_CHECKING:
    from collections.abc import Callable

# Little endian; stamp; frame_id '' with its length; padding; power; valid_until; reason.
_CDR = Struct('<4siIIb3xdiIB')
_HEAD = b'\x00\x01\x00\x00'
_PROBE = (Command(1234.5, 1_700_000_001_000_000_003, Status.HEATING), 1_700_000_000_000_000_002)


def _packed(commanded: tuple[Command, int]) -> bytes:
    command, now_ns = commanded
    sec, nanosec = divmod(now_ns, NS_PER_S)
    until_sec, until_nanosec = divmod(command.valid_until_ns, NS_PER_S)
    return _CDR.pack(_HEAD, sec, nanosec, 1, 0, command.battery_heating_power_w, until_sec, until_nanosec,
                     command.reason)


def _serialized(commanded: tuple[Command, int]) -> bytes:
    return bytes(serialize_message(command_message(*commanded)))


def command_encoder() -> Callable[[tuple[Command, int]], bytes]:
    """Return a function for the bytes of a Command and the instant of its stamp [ns]; packing takes a tenth."""
    # Another middleware or another version of the message may have other bytes; padding may have any.
    try:
        is_same = deserialize_message(_packed(_PROBE), HvchCommand) == command_message(*_PROBE)
    except Exception:
        is_same = False
    return _packed if is_same and len(_packed(_PROBE)) == len(_serialized(_PROBE)) else _serialized
