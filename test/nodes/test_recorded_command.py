# SPDX-License-Identifier: Apache-2.0
"""The bytes of recorded commands are those of the published ones."""

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message

from bev_preheat.control.decision import Command
from bev_preheat.nodes.command_bytes import _packed, command_encoder
from bev_preheat.nodes.convert import command_message
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand

NANOSECONDS = st.integers(0, 2**31 * 10**9 - 1)


@given(st.builds(Command, st.floats(0.0, 2e4), NANOSECONDS, st.sampled_from(Status)), NANOSECONDS)
def test_a_packed_command_is_the_message(command, now_ns):
    assert deserialize_message(_packed((command, now_ns)), HvchCommand) == command_message(command, now_ns)


def test_commands_are_packed_unless_their_bytes_have_changed(monkeypatch):
    """With another version of the message, the bytes are rclpy's."""
    assert command_encoder() is _packed
    from bev_preheat.nodes import command_bytes
    monkeypatch.setattr(command_bytes, '_packed', lambda commanded: b'\x00\x01\x00\x00' + bytes(33))
    commanded = (Command(7.5, 10, Status.HEATING), 11)
    data = command_encoder()(commanded)
    assert deserialize_message(data, HvchCommand) == command_message(*commanded)
