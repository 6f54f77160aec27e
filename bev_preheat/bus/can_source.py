# SPDX-License-Identifier: Apache-2.0
"""A CAN bus as a live source, and the way back for the heater's command."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from bev_preheat.bus.battery import BatteryReader
from bev_preheat.bus.can_decoder import CanDecoder, HEATER_FAULT, HEATER_POWER
from bev_preheat.bus.can_link import CanLink
from bev_preheat.bus.heater_frame import HeaterFrame
from bev_preheat.bus.readings import Readings

if TYPE_CHECKING:
    from bev_preheat.bus.battery import LiveBattery
    from bev_preheat.bus.live_map import LiveMap


class CanSource:
    """See source.LiveSource. `heater_frame` is None if the map names none."""

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float]) -> None:
        """Take a map with `can`, and the clock [s] of the readings' instants; raises InvalidInput."""
        assert live_map.can is not None
        self._map, self._clock_s = live_map, clock_s
        self._readings = Readings()
        self._decoder = CanDecoder(live_map)
        self._reader = BatteryReader(live_map, self._decoder.channels)
        self.heater_frame = None if live_map.heater_command is None else HeaterFrame(
            live_map.heater_command, self._decoder.messages, str(live_map.signals.path))
        self._link = CanLink(live_map.can, self._decoder.identifiers, self._on_frame)
        self.name = self._link.name

    @property
    def problem(self) -> str:
        """'' while the bus works, else a sentence."""
        return self._link.problem

    def start(self) -> None:
        """Receive in a thread."""
        self._link.start()

    def close(self) -> None:
        """End the thread and close the bus."""
        self._link.close()

    def battery(self, now_s: float) -> tuple[LiveBattery | None, tuple[str, ...]]:
        """Return the battery at an instant [s]; else a sentence for each missing signal."""
        return self._reader.read(self._readings, now_s)

    def value(self, signal: str, now_s: float) -> float | None:
        """Return another signal of live_map.LIVE_SIGNALS in its own unit, None without a valid value."""
        return self._reader.value(signal, self._readings, now_s)

    def doubts(self, now_s: float) -> dict[str, str]:
        """Return a sentence on the latest dropped input of each cause."""
        return self._readings.doubts(now_s)

    def forget(self) -> None:
        """Drop all readings."""
        self._readings.forget()

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
        checks = [f'{check.message.name} ({", ".join(words)})' for check in self._decoder.checks
                  if (words := check.in_words())]
        return {'frames': str(self._link.frames), 'reconnects': str(max(self._link.reconnects, 0)),
                'checks beyond length and limits': ', '.join(checks) or 'none'}

    def heater_status(self, now_s: float) -> tuple[float | None, str]:
        """Return the heater's measured power [W] (None: unknown), and a sentence on a fault or silence."""
        rule = self._map.heater_status
        if rule is None:
            return None, ''
        measured_w, fault = None, ''
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
        frame = self.heater_frame
        assert frame is not None
        return self._link.send(frame.identifier, frame.is_extended, frame.next(power_w))

    def _on_frame(self, identifier: int, is_extended: bool, data: bytes, age_s: float) -> None:
        self._decoder.take(identifier, is_extended, data, self._clock_s() - age_s, self._readings)
