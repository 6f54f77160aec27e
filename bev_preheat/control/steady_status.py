# SPDX-License-Identifier: Apache-2.0
"""Keeps a plan's status from flickering, as successive plans may lie on either side of a bound."""

from __future__ import annotations

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.control.margins import LEAST_STATUS_S
from bev_preheat.planning.status import Status

OF_PLAN = frozenset((
    Status.NOT_NEEDED, Status.WAITING, Status.HEATING, Status.TARGET_UNREACHABLE, Status.SOC_LIMITED,
    Status.POWER_LIMITED))


class SteadyStatus:
    """
    The status that is shown; instants in nanoseconds.

    Doubt, the driver and the heater's switching show at once.
    """

    def __init__(self) -> None:
        """Begin without any status."""
        self._shown: Status | None = None
        self._differs_since_ns: int | None = None
        self._was_on = False

    def forget(self) -> None:
        """Let the next status be shown at once."""
        self._shown = self._differs_since_ns = None

    def settle(self, now_ns: int, status: Status, is_on: bool) -> Status:
        """Return the Status to show for a `status` of now; `is_on`: the heater is on."""
        shown, was_on = self._shown, self._was_on
        self._was_on = is_on
        if shown is None or status is shown or is_on is not was_on or not {shown, status} <= OF_PLAN:
            self._shown, self._differs_since_ns = status, None
            return status
        # After a clock that was set back the time begins again.
        if self._differs_since_ns is None or now_ns < self._differs_since_ns:
            self._differs_since_ns = now_ns
        if now_ns - self._differs_since_ns >= LEAST_STATUS_S * NS_PER_S:
            self._shown, self._differs_since_ns = status, None
            return status
        return shown
