# SPDX-License-Identifier: Apache-2.0
"""The heater's command on its way to the bus: valid within its lease, by two clocks."""

from __future__ import annotations

import math

from bev_preheat.errors import figure, InvalidInput


class CommandLease:
    """
    The power of the latest command while its lease lasts, then 0 W.

    A lease ends at its instant on the caller's clock, or when its length has passed on the steady clock: a clock
    that is set back does not lengthen it.
    """

    def __init__(self, longest_s: float) -> None:
        """Take the length [s] beyond which a lease is refused."""
        self._longest_s = longest_s
        self.end()

    def end(self) -> None:
        """End the lease now."""
        self._power_w, self._until_s, self._steady_until_s = 0.0, -math.inf, -math.inf

    def take(self, power_w: float, until_s: float, now_s: float, steady_s: float) -> None:
        """
        Take a command: power [W] until an instant [s] on the clock that shows `now_s`.

        Raises InvalidInput, and ends the lease before it, if the power is not 0 or more, or if the lease is
        over or longer than allowed.
        """
        self.end()
        lasts_s = until_s - now_s
        if not (math.isfinite(power_w) and power_w >= 0.0):
            raise InvalidInput(f'battery_heating_power: {power_w:g} W is not allowed; it must be 0 W or more')
        if not 0.0 < lasts_s:
            raise InvalidInput(f'valid_until: is {figure(-lasts_s, 3)} s in the past')
        if lasts_s > self._longest_s:
            raise InvalidInput(f'valid_until: is {figure(lasts_s, 3)} s ahead of the clock; at most '
                               f'{self._longest_s:g} s are allowed')
        self._power_w, self._until_s, self._steady_until_s = power_w, until_s, steady_s + lasts_s

    def is_valid(self, now_s: float, steady_s: float) -> bool:
        """Return whether the lease lasts at an instant [s]."""
        return now_s < self._until_s and steady_s < self._steady_until_s

    def power_w(self, now_s: float, steady_s: float) -> float:
        """Return the power [W] at an instant [s]: that of the command within its lease, else 0."""
        return self._power_w if self.is_valid(now_s, steady_s) else 0.0
