# SPDX-License-Identifier: Apache-2.0
"""The message types that recordings hold."""

from __future__ import annotations

from typing import Any

from bev_preheat.errors import InvalidInput, quoted

# Of the planner's inputs and outputs, by package.
OWN = 'bev_preheat_msgs'


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
