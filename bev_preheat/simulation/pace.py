# SPDX-License-Identifier: Apache-2.0
"""Relation of simulated to real time."""

# Simulated time between two clock messages [s]: the time resolution of the nodes.
TICK_S = 0.5
# Longest real time between them [s], so that slow simulations run smoothly.
LONGEST_REAL_TICK_S = 0.01


class Pace:
    """
    Simulated seconds since the start, `speed_up` per real second.

    If a call is late, on a busy computer, the simulation slows down instead of jumping:
    leases and time limits that use its clock see at most two ticks at once. `lost_s` is the
    total simulated time [s] skipped in this way.
    """

    def __init__(self, speed_up: float) -> None:
        """Stay at 0 until the first call of `follow`."""
        self.speed_up = speed_up
        self.elapsed_s = 0.0
        self.lost_s = 0.0
        self._real_s: float | None = None

    @property
    def real_tick_s(self) -> float:
        """Suitable real time between two calls of `follow` [s]."""
        return min(LONGEST_REAL_TICK_S, TICK_S / self.speed_up)

    def follow(self, real_s: float) -> float:
        """Return the simulated seconds at a real instant [s of any steady clock]."""
        if self._real_s is not None:
            tick_s = (real_s - self._real_s) * self.speed_up
            self.lost_s += max(0.0, tick_s - 2.0 * TICK_S)
            self.elapsed_s += min(tick_s, 2.0 * TICK_S)
        self._real_s = real_s
        return self.elapsed_s
