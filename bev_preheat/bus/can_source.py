# SPDX-License-Identifier: Apache-2.0
"""A CAN bus as a live source, and the way back for the heater's command."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from bev_preheat.bus.can_decoder import BusMessages, CanDecoder, FOLLOWED, HEATER_FAULT, HEATER_POWER
from bev_preheat.bus.can_link import CanLink
from bev_preheat.bus.heater_frame import HeaterFrame
from bev_preheat.bus.live_map import HeaterStatusRule
from bev_preheat.bus.source import LiveSource
from bev_preheat.errors import InvalidInput

if TYPE_CHECKING:
    from bev_preheat.bus.live_map import LiveMap

# The readings that a set-point follows are valid for as long as those of this signal.
TEMPERATURE = 'battery_temperature_c'


class CanSource(LiveSource):
    """A CAN bus, or several. `heater_frame` is None if the map names none."""

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float],
                 vehicle_power_w: float | None = None) -> None:
        """
        Take a map with `can`, and the clock [s] of the readings' instants; raises InvalidInput.

        `vehicle_power_w` [W] is the heater's maximum power in the vehicle file, None: not known.
        """
        assert live_map.can
        messages, rule = BusMessages(live_map), live_map.heater_command
        frame = self.heater_frame = None if rule is None else HeaterFrame(
            rule, messages.by_name, str(live_map.signals.path), vehicle_power_w)
        self._follows, full_power_w = (None, None) if frame is None else (frame.follows, frame.full_power_w)
        self._decoder = CanDecoder(live_map, messages, self._follows, full_power_w)
        super().__init__(live_map, clock_s, self._decoder.channels)
        heaters_bus = None if rule is None else messages.bus[rule.message]
        try:
            self._links = [CanLink(
                settings, self._decoder.identifiers[number], partial(self.on_frame, number),
                self._decoder.has_fd[number] or (number == heaters_bus and frame is not None and frame.is_fd))
                for number, settings in enumerate(live_map.can)]
        except InvalidInput as error:
            raise InvalidInput([f'{live_map.signals.path}: {problem}' for problem in error.problems]) from error
        self._heaters_link = None if heaters_bus is None else self._links[heaters_bus]
        self.name = ' and '.join(link.name for link in self._links)

    @property
    def problem(self) -> str:
        """'' while all buses work, else a sentence."""
        if len(self._links) == 1:
            return self._links[0].problem
        return '; '.join(f'{link.name}: {link.problem}' for link in self._links if link.problem)

    @property
    def heaters_problem(self) -> str:
        """'' while the bus of the heater's command works, else a sentence that names it."""
        link = self._heaters_link
        return f'{link.name}: {link.problem}' if link is not None and link.problem else ''

    def start(self) -> None:
        """Receive, in a thread for each bus."""
        for link in self._links:
            link.start()

    def close(self) -> None:
        """End the threads and close the buses."""
        for link in self._links:
            link.close()

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
        checks = [f'{check.message.name} ({", ".join(words)})' for check in self._decoder.checks
                  if (words := check.in_words())]
        return {'frames': str(sum(link.frames for link in self._links)),
                'reconnects': str(sum(max(link.reconnects, 0) for link in self._links)),
                'checks beyond length and limits': ', '.join(checks) or 'none'}

    def heater_status(self, now_s: float) -> tuple[float | None, str]:
        """Return the heater's measured power [W] (None: unknown), and a sentence on a fault or silence."""
        rule = self._map.heater_status or HeaterStatusRule()
        measured_w, fault = None, ''
        if self._follows is not None and self._followed_c(now_s) is None:
            fault = (f'no valid {self._follows} for {self._map.valid_for_s[TEMPERATURE]:g} s, which the set-point '
                     'follows')
        for signal, channel in ((HEATER_POWER, rule.power), (HEATER_FAULT, rule.fault)):
            if channel is None:
                continue
            reading = self._readings.latest(signal, channel)
            if reading is None or not 0.0 <= now_s - reading.instant_s <= rule.valid_for_s:
                fault = f'no valid {channel} for {rule.valid_for_s:g} s'
            elif signal == HEATER_POWER:
                measured_w = reading.value
            elif reading.value != 0.0:
                fault = f'{channel}: {self._decoder.value_in_words(channel, reading.value)}'
        return measured_w, fault

    def send_power(self, power_w: float) -> str:
        """Send the next frame of the heater's command [W]; return '' or why it was not sent."""
        frame, link = self.heater_frame, self._heaters_link
        assert frame is not None and link is not None
        data = frame.next(power_w, self._followed_c(self._clock_s()))
        return link.send(frame.identifier, frame.is_extended, data, frame.is_fd)

    def _followed_c(self, now_s: float) -> float | None:
        """Return the valid temperature that the set-point follows [deg C] at an instant [s], None without one."""
        if self._follows is None:
            return None
        reading = self._readings.latest(FOLLOWED, self._follows)
        if reading is None or not 0.0 <= now_s - reading.instant_s <= self._map.valid_for_s[TEMPERATURE]:
            return None
        return reading.value

    def on_frame(self, bus: int, identifier: int, is_extended: bool, data: bytes, age_s: float) -> None:
        """Take a frame of a bus in that arrived some seconds ago."""
        self._decoder.take(identifier, is_extended, data, self._clock_s() - age_s, self._readings, bus)
