# SPDX-License-Identifier: Apache-2.0
"""The message types that recordings hold."""

from __future__ import annotations

from typing import Any

from bev_preheat.errors import InvalidInput, quoted, shortened

# Of the planner's inputs and outputs, by package.
OWN = 'bev_preheat_msgs'
LONGEST_REASON = 200


def read_message(type_name: str, data: bytes) -> Any:
    """Return the message of bytes (CDR); raises InvalidInput, naming the type, if they are damaged."""
    from rclpy.serialization import deserialize_message
    known = message_type(type_name)
    try:
        return deserialize_message(data, known)
    except Exception as error:
        # rclpy raises errors of many kinds for damaged bytes.
        reason = shortened(f'{type(error).__name__}: {" ".join(str(error).split())}', LONGEST_REASON)
        raise InvalidInput(f'a message of type {type_name} in the recording is damaged, or of another version: '
                           f'{reason}') from error


def message_type(name: str) -> Any:
    """Return the class of a message type such as sensor_msgs/msg/BatteryState; raises InvalidInput if unknown."""
    package, _, short = name.partition('/msg/')
    if package == OWN:
        import bev_preheat_msgs.msg as module
    elif package == 'sensor_msgs':
        import sensor_msgs.msg as module
    else:
        module = None
    found = getattr(module, short, None)
    if found is None:
        raise InvalidInput(f'message type {quoted(name)} of the recording is not known here')
    return found
