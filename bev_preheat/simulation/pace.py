# SPDX-License-Identifier: Apache-2.0
"""Relation of simulated to real time, and waiting for a planner that lags behind."""

import math

# Simulated time between two clock messages [s]: the time resolution of the nodes.
TICK_S = 0.5
# Longest real time between them [s], so that slow simulations run smoothly.
LONGEST_REAL_TICK_S = 0.01
# Simulated time is at most this far [s] ahead of the first unanswered battery state. A planner that is
# silent for this real time [s] is no longer waited for.
MOST_AHEAD_S = 1.5
SILENT_PLANNER_S = 1.0
# Between two looks at most this real time [s] counts: a busy computer delays the planner as it delays the looks.
LONGEST_LOOK_S = 0.02
# Tolerance for a command from a planner that has not received the latest /clock [s].
CLOCK_LAG_S = 1.0


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

    def stand(self, real_s: float) -> None:
        """Stop simulated time until a real instant [s of any steady clock]."""
        if self._real_s is not None:
            self.lost_s += (real_s - self._real_s) * self.speed_up
        self._real_s = real_s

    def follow(self, real_s: float) -> float:
        """Return the simulated seconds at a real instant [s of any steady clock]."""
        if self._real_s is not None:
            tick_s = (real_s - self._real_s) * self.speed_up
            self.lost_s += max(0.0, tick_s - 2.0 * TICK_S)
            self.elapsed_s += min(tick_s, 2.0 * TICK_S)
        self._real_s = real_s
        return self.elapsed_s


class Patience:
    """
    Whether simulated time may advance, or waits for a planner that has not answered a battery state.

    On a busy computer simulated time could outrun the planner, whose answers would then refer to
    instants long past. A planner that is silent for SILENT_PLANNER_S of real time, counted as LONGEST_LOOK_S
    says, is not waited for until it sends a command again. All other instants are in simulated time [s].
    """

    def __init__(self) -> None:
        """Start without an unanswered battery state."""
        self._unanswered_s: float | None = None
        # Real time waited, and the instant of the latest look.
        self._waited_s, self._looked_s = 0.0, math.inf

    def tell(self, instant_s: float) -> None:
        """Note that a battery state was published."""
        if self._unanswered_s is None or instant_s < self._unanswered_s:
            # The first unanswered state; an earlier one if the clock was set back.
            self._unanswered_s = instant_s

    def hear(self, instant_s: float) -> None:
        """Note a command with an instant of the planner's clock, which may lag slightly."""
        self._waited_s, self._looked_s = 0.0, math.inf
        if self._unanswered_s is not None and instant_s >= self._unanswered_s - CLOCK_LAG_S:
            self._unanswered_s = None

    def lets_go_on(self, clock_s: float, real_s: float) -> bool:
        """Return whether simulated time may advance, at a clock instant and a real instant [s of any clock]."""
        if self._unanswered_s is None or clock_s - self._unanswered_s <= MOST_AHEAD_S:
            return True
        self._waited_s += min(max(real_s - self._looked_s, 0.0), LONGEST_LOOK_S)
        self._looked_s = real_s
        return self._waited_s >= SILENT_PLANNER_S
