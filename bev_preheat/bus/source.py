# SPDX-License-Identifier: Apache-2.0
"""A live source of the battery's signals, whatever the bus."""

from __future__ import annotations

from typing import Protocol, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.bus.battery import LiveBattery


class LiveSource(Protocol):
    """A bus that is being received."""

    # The bus in words, such as `socketcan can0`.
    name: str

    @property
    def problem(self) -> str:
        """'' while the bus works, else a sentence."""

    def start(self) -> None:
        """Receive in a thread; a bus that cannot be reached is tried again."""

    def close(self) -> None:
        """End the thread and close the bus."""

    def battery(self, now_s: float) -> tuple[LiveBattery | None, tuple[str, ...]]:
        """Return the battery at an instant [s]; else a sentence for each missing signal."""

    def value(self, signal: str, now_s: float) -> float | None:
        """Return another signal of live_map.LIVE_SIGNALS in its own unit, None without a valid value."""

    def doubts(self, now_s: float) -> dict[str, str]:
        """Return a sentence on the latest dropped input of each cause."""

    def forget(self) -> None:
        """Drop all readings, because the clock fell back."""

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
