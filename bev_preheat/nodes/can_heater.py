# SPDX-License-Identifier: Apache-2.0
"""A heater on CAN as an output: commands as frames, its status as a fault and measured power."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from bev_preheat.bus.can_source import CanSource
from bev_preheat.bus.live_map import load_live_map
from bev_preheat.bus.readings import steady_s
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.diagnostics import judged
from bev_preheat.vehicle.heater_controller import Refusal, SERVED, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable

    from diagnostic_msgs.msg import DiagnosticStatus

    from bev_preheat.vehicle.heater_controller import Instant

LAST_FRAMES = 3


class CanHeater:
    """
    The output of a heater whose frame a CanSource sends; call it at least every `period_s` [s].

    Frames end with the calls, and the heater's own timeout applies then: no thread goes on for a controller that
    hangs.
    """

    def __init__(self, source: CanSource, clock_s: Callable[[], float] = steady_s) -> None:
        """Take the source, and the clock [s] of its readings."""
        assert source.heater_frame is not None
        self._source, self._clock_s, self.period_s = source, clock_s, source.heater_frame.period_s
        self.maximum_w = source.heater_frame.highest_w
        self._next_s, self._sent, self._unsent = -1.0, 0, ''

    @property
    def bus_problem(self) -> str:
        """A sentence if the bus does not work, else ''."""
        return f'{self._source.name}: {self._source.problem}' if self._source.problem else ''

    def obstacle(self, now: Instant) -> Verdict:
        """Return the Verdict of bus and heater."""
        fault = self._source.heaters_problem or self._source.heater_status(self._clock_s())[1]
        return Verdict(Refusal.HEATER_FAULT, fault) if fault else SERVED

    def __call__(self, power_w: float) -> float | None:
        """Send the power [W] if the next frame is due; return the measured one [W], None if it is not known."""
        now_s = time.monotonic()
        # A timer's jitter must neither skip a frame nor send two.
        if now_s >= self._next_s - 0.5 * self.period_s:
            self._next_s = now_s + self.period_s
            self._unsent = self._source.send_power(power_w)
            self._sent += not self._unsent
            if self._unsent and power_w > 0.0:
                raise ConnectionError(self._unsent)
        return self._source.heater_status(self._clock_s())[0]

    def end(self) -> None:
        """Send 0 W a few times, and close the bus."""
        for _ in range(LAST_FRAMES):
            self._source.send_power(0.0)
        self._source.close()

    def entry(self, node_name: str, hardware: str) -> DiagnosticStatus:
        """Return the DiagnosticStatus `NODE: bus`."""
        problem = self.bus_problem or self._unsent
        return judged(node_name, 'bus', hardware, [problem] if problem else [],
                      list(self._source.doubts(self._clock_s()).values()), f'{self._source.name}: works',
                      {**self._source.figures(), 'sent frames': str(self._sent)})


def open_can_heater(name_or_file: str, maximum_power_w: float) -> CanHeater:
    """
    Open the bus of a signal map whose heater_command describes the frame, for this heater alone.

    Raises InvalidInput without such a frame, or if it cannot carry the vehicle's maximum power [W].
    """
    live_map = load_live_map(name_or_file)
    if not live_map.can or live_map.heater_command is None:
        raise InvalidInput(f'{live_map.signals.path}: live.heater_command: is missing; it names the frame '
                           "with the heater's power")
    source = CanSource(live_map, steady_s, maximum_power_w)
    heater = CanHeater(source)
    if heater.maximum_w < maximum_power_w:
        raise InvalidInput(f'{live_map.signals.path}: live.heater_command: carries at most '
                           f'{heater.maximum_w:g} W; hvch.maximum_power_w of the vehicle is '
                           f'{maximum_power_w:g} W')
    source.start()
    return heater
