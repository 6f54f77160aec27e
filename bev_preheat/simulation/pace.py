# SPDX-License-Identifier: Apache-2.0
"""How simulated time follows real time."""

# Simulated time between two instants of the clock [s]: what the nodes that live by it can resolve.
TICK_S = 0.5
# Real time between them is no longer than this [s], so that slow simulations run smoothly.
LONGEST_REAL_TICK_S = 0.01


class Pace:
    """
    Simulated seconds since the start, `speed_up` of them in each real second.

    Where a call comes late, on a busy computer, the simulation slows down rather than jumps:
    whoever lives by its clock (leases, time limits) sees at most two ticks at once. `lost_s` sums
    up the simulated seconds that were left out so.
    """

    def __init__(self, speed_up):
        """Stand at 0 until the first call of `follow`."""
        self.speed_up = speed_up
        self.elapsed_s = 0.0
        self.lost_s = 0.0
        self._real_s = None

    @property
    def real_tick_s(self):
        """Real time between two calls of `follow` that suits the speed [s]."""
        return min(LONGEST_REAL_TICK_S, TICK_S / self.speed_up)

    def follow(self, real_s):
        """Return the simulated seconds at a real instant [s of any steady clock]."""
        if self._real_s is not None:
            tick_s = (real_s - self._real_s) * self.speed_up
            self.lost_s += max(0.0, tick_s - 2.0 * TICK_S)
            self.elapsed_s += min(tick_s, 2.0 * TICK_S)
        self._real_s = real_s
        return self.elapsed_s
