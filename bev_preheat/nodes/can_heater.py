# SPDX-License-Identifier: Apache-2.0
"""A heater on CAN behind `heater_controller`: commands as frames, its status as a fault and measured power."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from bev_preheat.bus.bus_clock import steady_s
from bev_preheat.bus.can_source import CanSource
from bev_preheat.bus.live_map import load_live_map
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.bus_messages import bus_entry

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticStatus

LAST_FRAMES = 3


class CanHeater:
    """
    The output of a heater_controller; call it at least every `period_s` [s].

    It has a connection to the bus of its own. Frames end with the calls, and the heater's own timeout applies
    then: no thread goes on for a controller that hangs.
    """

    def __init__(self, name_or_file: str, maximum_power_w: float) -> None:
        """
        Open the bus of a signal map whose heater_command describes the frame.

        Raises InvalidInput if there is none, or if its frame cannot carry the vehicle's maximum power [W].
        """
        live_map = load_live_map(name_or_file)
        if not live_map.can or live_map.heater_command is None:
            raise InvalidInput(f'{live_map.signals.path}: live.heater_command: is missing; it names the frame '
                               "with the heater's power")
        self._source = CanSource(live_map, steady_s, maximum_power_w)
        frame = self._source.heater_frame
        assert frame is not None
        if frame.highest_w < maximum_power_w:
            raise InvalidInput(f'{live_map.signals.path}: live.heater_command: carries at most '
                               f'{frame.highest_w:g} W; hvch.maximum_power_w of the vehicle is '
                               f'{maximum_power_w:g} W')
        self.name, self.period_s = live_map.signals.name, frame.period_s
        self._next_s = -1.0
        self._sent = 0
        self._unsent = ''
        self._source.start()

    @property
    def bus_problem(self) -> str:
        """A sentence if the bus does not work, else ''."""
        return f'{self._source.name}: {self._source.problem}' if self._source.problem else ''

    def fault(self) -> str:
        """Return a sentence if bus or heater do not work, else ''."""
        return self._source.heaters_problem or self._source.heater_status(steady_s())[1]

    def __call__(self, power_w: float) -> float | None:
        """Send the power [W] if the next frame is due; return the measured one [W], None if it is not known."""
        now_s = time.monotonic()
        # A timer's jitter must neither skip a frame nor send two.
        if now_s >= self._next_s - 0.5 * self.period_s:
            self._next_s = now_s + self.period_s
            self._send(power_w)
        return self._source.heater_status(steady_s())[0]

    def _send(self, power_w: float) -> None:
        self._unsent = self._source.send_power(power_w)
        self._sent += not self._unsent
        if self._unsent and power_w > 0.0:
            raise ConnectionError(self._unsent)

    def end(self) -> None:
        """Send 0 W a few times, and close the bus."""
        for _ in range(LAST_FRAMES):
            self._source.send_power(0.0)
        self._source.close()

    def entry(self, node_name: str) -> DiagnosticStatus:
        """Return the DiagnosticStatus `NODE: bus`."""
        doubts = list(self._source.doubts(steady_s()).values())
        problem = self.bus_problem or self._unsent
        return bus_entry(node_name, 'bus', self.name, [problem] if problem else [], doubts,
                         f'{self._source.name}: works', {**self._source.figures(), 'sent frames': str(self._sent)})
