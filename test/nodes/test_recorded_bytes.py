# SPDX-License-Identifier: Apache-2.0
"""The bytes of recorded commands and battery states are those of the messages."""

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.control.decision import Command
from bev_preheat.messages.fields import time_message
from bev_preheat.messages.heater import command_message
from bev_preheat.nodes import recorded_bytes
from bev_preheat.nodes.recorded_bytes import _packed_command, _packed_state, command_encoder, state_encoder
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand

NANOSECONDS = st.integers(0, 2**31 * 10**9 - 1)
SINGLE, BYTE = st.floats(width=32), st.integers(0, 255)
CELLS = st.lists(SINGLE, max_size=4)
# Mostly empty, as in cars.
TEXT = st.just('') | st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=5)


@given(st.builds(Command, st.floats(0.0, 2e4), NANOSECONDS, st.sampled_from(Status)), NANOSECONDS)
def test_a_packed_command_is_the_message(command, now_ns):
    assert deserialize_message(_packed_command((command, now_ns)), HvchCommand) == command_message(command, now_ns)


@given(NANOSECONDS, TEXT, st.fixed_dictionaries({
    **dict.fromkeys(('voltage', 'temperature', 'current', 'charge', 'capacity', 'design_capacity', 'percentage'),
                    SINGLE),
    **dict.fromkeys(('power_supply_status', 'power_supply_health', 'power_supply_technology'), BYTE),
    'present': st.booleans(), 'cell_voltage': CELLS, 'cell_temperature': CELLS, 'location': TEXT,
    'serial_number': TEXT}))
def test_a_packed_battery_state_is_the_message(now_ns, frame_id, fields):
    message = BatteryState(**fields)
    message.header.stamp, message.header.frame_id = time_message(now_ns), frame_id
    # NaN equals nothing.
    assert repr(deserialize_message(_packed_state(message), BatteryState)) == repr(message)


def test_a_number_beyond_single_precision_is_recorded_as_it_is_sent():
    message = BatteryState(voltage=1e300, check_fields=False)
    assert deserialize_message(_packed_state(message), BatteryState).voltage == deserialize_message(
        bytes(serialize_message(message)), BatteryState).voltage


def test_messages_are_packed_unless_their_bytes_have_changed(monkeypatch):
    """With another version of a message, the bytes are rclpy's."""
    assert command_encoder() is _packed_command and state_encoder() is _packed_state
    commanded, state = (Command(7.5, 10, Status.HEATING), 11), BatteryState(voltage=7.5)
    for name in ('_packed_command', '_packed_state'):
        monkeypatch.setattr(recorded_bytes, name, lambda content: b'\x00\x01\x00\x00' + bytes(33))
    assert deserialize_message(command_encoder()(commanded), HvchCommand) == command_message(*commanded)
    assert deserialize_message(state_encoder()(state), BatteryState) == state
