# SPDX-License-Identifier: Apache-2.0
"""Keeps the heater from being switched too often."""

from bev_preheat.control.heating_pause import HeatingPause
from bev_preheat.control.inputs import NS_PER_S


class HeaterSwitch:
    """
    Least times on and off between a plan's request and the command; instants in nanoseconds.

    They delay requests, never a forced shutdown: `force_off` and `doubt` take effect at once. After a
    `doubt` the heater stays off for a while, whatever is requested.
    """

    def __init__(self) -> None:
        """Start with the heater off."""
        self.is_on = False
        # On only because of the least time.
        self.is_held = False
        self.pause = HeatingPause()
        self._since_ns: int | None = None
        self._power_w = 0.0

    def force_off(self) -> None:
        """Switch off because no heating is needed, or the driver does not want it."""
        self.is_on = self.is_held = False
        self._since_ns, self._power_w = None, 0.0

    def turn_off(self, now_ns: int) -> None:
        """Switch off at once because the plan has no more use for heat; the least time off begins."""
        was_on = self.is_on
        since_ns = self._since_ns
        self.force_off()
        self._since_ns = now_ns if was_on else since_ns

    def doubt(self, now_ns: int, cause: str, minimum_off_time_s: float) -> None:
        """Switch off because something is in doubt, for a cause in words; a pause begins."""
        self.pause.let_time_pass(now_ns)
        self.pause.doubt(cause, self.is_on, minimum_off_time_s)
        self.force_off()

    def allow(self) -> None:
        """Let the heater be switched at once: the reason to wait no longer holds; a pause continues."""
        self._since_ns = None

    def power_w(self, now_ns: int, wanted_w: float, limit_w: float, minimum_on_time_s: float,
                minimum_off_time_s: float) -> float:
        """
        Return the power [W] to command: `wanted_w`, unless the latest switching was too recent.

        A heater held on keeps its power, up to `limit_w` [W].
        """
        self.pause.let_time_pass(now_ns)
        wants_on = wanted_w > 0.0
        if wants_on != self.is_on and not self._must_wait(
                now_ns, self._least_s(minimum_on_time_s if self.is_on else minimum_off_time_s)) and not (
                wants_on and self.pause.left_s > 0.0):
            self.is_on, self._since_ns = wants_on, now_ns
            if wants_on:
                self.pause.note_switch_on()
        self.is_held = self.is_on and not wants_on
        if not self.is_on:
            return 0.0
        if wants_on:
            self._power_w = wanted_w
        self._power_w = min(self._power_w, limit_w)
        return self._power_w

    def held_for_s(self, now_ns: int, minimum_on_time_s: float, minimum_off_time_s: float) -> float:
        """Return the time [s] until the heater may be switched again."""
        if self._since_ns is None:
            return 0.0
        least_s = self._least_s(minimum_on_time_s if self.is_on else minimum_off_time_s)
        return max(0.0, least_s - (now_ns - self._since_ns) / NS_PER_S)

    def _least_s(self, minimum_s: float) -> float:
        return max(minimum_s, self.pause.spacing_s)

    def _must_wait(self, now_ns: int, least_s: float) -> bool:
        # After the clock was set back the time since the last switching is unknown.
        return (self._since_ns is not None
                and 0 <= now_ns - self._since_ns < round(least_s * NS_PER_S))
