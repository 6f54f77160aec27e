# SPDX-License-Identifier: Apache-2.0
"""A live source of the battery's signals: what CAN and VSS have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.bus.battery import read_battery, View
from bev_preheat.bus.readings import Readings

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bev_preheat.bus.battery import LiveBattery
    from bev_preheat.bus.live_map import LiveMap
    from bev_preheat.bus.readings import LiveChannel


class LiveSource:
    """A bus that is being received; `name` is the bus in words, such as `socketcan can0`."""

    name: str

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float],
                 channels: Mapping[str, tuple[tuple[LiveChannel, ...], ...]],
                 confirmed_s: float | None = None) -> None:
        """
        Take a map, the clock [s] of the readings' instants, and the channels of readings.live_channels.

        On a bus that sends values on change only, `confirmed_s` is when its connection was last alive [s].
        """
        self._map, self._clock_s, self._channels, self._confirmed_s = live_map, clock_s, channels, confirmed_s
        self._readings = Readings()

    @property
    def problem(self) -> str:
        """'' while the bus works, else a sentence."""
        raise NotImplementedError

    def start(self) -> None:
        """Receive in a thread; a bus that cannot be reached is tried again."""
        raise NotImplementedError

    def close(self) -> None:
        """End the thread and close the bus."""
        raise NotImplementedError

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
        raise NotImplementedError

    def battery(self, now_s: float) -> tuple[LiveBattery | None, tuple[str, ...]]:
        """Return the battery at an instant [s]; else a sentence for each missing signal."""
        return read_battery(self._view(now_s))

    def value(self, signal: str, now_s: float) -> float | None:
        """Return another signal of live_map.LIVE_SIGNALS in its own unit, None without a valid value."""
        view = self._view(now_s)
        return None if view.is_lost else view.value(signal)

    def _view(self, now_s: float) -> View:
        return View(self._map, self._channels, self._readings, now_s, self._confirmed_s)

    def doubts(self, now_s: float) -> dict[str, str]:
        """Return a sentence on the latest dropped input of each cause."""
        return self._readings.doubts(now_s)

    def forget(self) -> None:
        """Drop all readings, because the clock fell back."""
        self._readings.forget()
