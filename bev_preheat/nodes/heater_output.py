# SPDX-License-Identifier: Apache-2.0
"""
Writes `hvch_command` to CAN, frame by frame.

While the lease of the latest command lasts, the frames carry its power; after it, and while two nodes publish
commands, they carry 0 W. Frames end with the process, or with the bus; the heater's own timeout applies then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType

from bev_preheat.bus.bus_clock import steady_s
from bev_preheat.bus.command_lease import CommandLease
from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.bus_messages import bus_entry
from bev_preheat.nodes.convert import nanoseconds
from bev_preheat_msgs.msg import HvchCommand

if TYPE_CHECKING:
    from collections.abc import Callable

    from diagnostic_msgs.msg import DiagnosticStatus
    from rclpy.node import Node

    from bev_preheat.bus.can_source import CanSource

TOPIC = 'hvch_command'
# Looks at the publishers, each half a second: a publisher that is being replaced is there for one look.
LOOK_PERIOD_S, CONFLICT_LOOKS = 0.5, 2
LAST_FRAMES = 3


class HeaterOutput:
    """The commands of a topic on their way to the heater's frame."""

    def __init__(self, node: Node, source: CanSource, longest_lease_s: float,
                 refuse: Callable[[str], None]) -> None:
        """Subscribe and begin to send; `refuse` logs a sentence."""
        assert source.heater_frame is not None
        self._node, self._source, self._refuse = node, source, refuse
        self._lease = CommandLease(longest_lease_s)
        self._refusal = self._unsent = ''
        self._looks_in_conflict = 0
        self._power_w = 0.0
        self._sent = self._refused = 0
        node.create_subscription(HvchCommand, TOPIC, self._on_command, 1)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(source.heater_frame.period_s, self._on_frame, clock=steady)
        node.create_timer(LOOK_PERIOD_S, self._on_look, clock=steady)

    def _now_s(self) -> float:
        return float(self._node.get_clock().now().nanoseconds) / NS_PER_S

    def _on_command(self, message: HvchCommand) -> None:
        try:
            self._lease.take(message.battery_heating_power, nanoseconds(message.valid_until) / NS_PER_S,
                             self._now_s(), steady_s())
            self._refusal = ''
        except InvalidInput as error:
            self._refused += 1
            self._refusal = f'hvch_command refused: {error}'
            self._refuse(self._refusal)

    def _on_look(self) -> None:
        publishers = self._node.count_publishers(TOPIC)
        self._looks_in_conflict = self._looks_in_conflict + 1 if publishers > 1 else 0

    @property
    def _is_in_conflict(self) -> bool:
        return self._looks_in_conflict >= CONFLICT_LOOKS

    def _on_frame(self) -> None:
        self._power_w = 0.0 if self._is_in_conflict else self._lease.power_w(self._now_s(), steady_s())
        self._unsent = self._source.send_power(self._power_w)
        self._sent += not self._unsent

    def end(self) -> None:
        """Send 0 W a few times."""
        self._lease.end()
        for _ in range(LAST_FRAMES):
            self._source.send_power(0.0)

    def entry(self, node_name: str, hardware: str) -> DiagnosticStatus:
        """Return the DiagnosticStatus `NODE: heater command`."""
        assert self._source.heater_frame is not None
        errors = [f'{self._node.count_publishers(TOPIC)} nodes publish hvch_command; 0 W until one is left'
                  ] if self._is_in_conflict else []
        errors += filter(None, [self._refusal, self._unsent])
        is_valid = self._lease.is_valid(self._now_s(), steady_s())
        highest_w = self._source.heater_frame.highest_w
        warnings = [] if is_valid or errors else ['no valid hvch_command: 0 W']
        if self._power_w > highest_w:
            warnings.append(f'the frame carries at most {highest_w:g} W of {self._power_w:g} W')
        return bus_entry(node_name, 'heater command', hardware, errors, warnings,
                         f'{self._power_w:g} W',
                         {'power [W]': f'{self._power_w:g}', 'frames': str(self._sent),
                          'refused commands': str(self._refused)})
