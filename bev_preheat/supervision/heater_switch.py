# SPDX-License-Identifier: Apache-2.0
"""Keeps the heater from being switched too often."""

from bev_preheat.supervision.inputs import NS_PER_S


class HeaterSwitch:
    """
    Least times on and off between a plan's wish and the command; instants in nanoseconds.

    They hold what is wanted back, never what must be: `force_off` takes effect at once, and leaves
    no waiting time behind.
    """

    def __init__(self) -> None:
        """Start with the heater off."""
        self.is_on = False
        self._since_ns: int | None = None
        self._power_w = 0.0

    def force_off(self) -> None:
        """Switch off because something is in doubt, or there is nothing to heat for."""
        self.is_on, self._since_ns, self._power_w = False, None, 0.0

    def allow(self) -> None:
        """Let the heater be switched at once: what made it wait is no longer true."""
        self._since_ns = None

    def power_w(self, now_ns: int, wanted_w: float, limit_w: float, minimum_on_time_s: float,
                minimum_off_time_s: float) -> float:
        """
        Return the power [W] to command: `wanted_w`, unless the latest switching was too recent.

        What is held on keeps its power, up to `limit_w` [W].
        """
        wants_on = wanted_w > 0.0
        if wants_on != self.is_on and not self._must_wait(
                now_ns, minimum_on_time_s if self.is_on else minimum_off_time_s):
            self.is_on, self._since_ns = wants_on, now_ns
        if not self.is_on:
            return 0.0
        if wants_on:
            self._power_w = wanted_w
        self._power_w = min(self._power_w, limit_w)
        return self._power_w

    def _must_wait(self, now_ns: int, least_s: float) -> bool:
        # A clock that was set back tells nothing of how long ago it was.
        return (self._since_ns is not None
                and 0 <= now_ns - self._since_ns < round(least_s * NS_PER_S))
