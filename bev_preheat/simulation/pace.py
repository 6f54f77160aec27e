# SPDX-License-Identifier: Apache-2.0
"""How simulated time follows real time, and waits for a planner that lags behind."""

# Simulated time between two instants of the clock [s]: what the nodes that live by it can resolve.
TICK_S = 0.5
# Real time between them is no longer than this [s], so that slow simulations run smoothly.
LONGEST_REAL_TICK_S = 0.01
# Simulated time is at most this far [s] ahead of the first battery state that has not been answered.
# A planner that is silent for so long in real time [s] is waited for no more.
MOST_AHEAD_S = 1.5
PATIENCE_S = 1.0
# A command counts as the answer though the planner's clock has not heard the latest /clock [s].
CLOCK_LAG_S = 1.0


class Pace:
    """
    Simulated seconds since the start, `speed_up` of them in each real second.

    Where a call comes late, on a busy computer, the simulation slows down rather than jumps:
    whoever lives by its clock (leases, time limits) sees at most two ticks at once. `lost_s` sums
    up the simulated seconds that were left out so.
    """

    def __init__(self, speed_up: float) -> None:
        """Stand at 0 until the first call of `follow`."""
        self.speed_up = speed_up
        self.elapsed_s = 0.0
        self.lost_s = 0.0
        self._real_s: float | None = None

    @property
    def real_tick_s(self) -> float:
        """Real time between two calls of `follow` that suits the speed [s]."""
        return min(LONGEST_REAL_TICK_S, TICK_S / self.speed_up)

    def stand(self, real_s: float) -> None:
        """Let no simulated time pass until a real instant [s of any steady clock]."""
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
    Whether simulated time may go on, or waits for a planner that has not answered a battery state.

    On a busy computer simulated time could outrun the planner, whose answers would then come for
    instants long past. A planner that says nothing for PATIENCE_S of real time is waited for no more
    until it commands again. All other instants are those of simulated time [s].
    """

    def __init__(self) -> None:
        """Wait for nobody: nothing has been told."""
        self._unanswered_s: float | None = None
        self._waiting_since_s: float | None = None

    def tell(self, instant_s: float) -> None:
        """Note that a battery state was published."""
        if self._unanswered_s is None or instant_s < self._unanswered_s:
            # The first that is not answered; an earlier one where the clock was set back.
            self._unanswered_s = instant_s

    def hear(self, instant_s: float) -> None:
        """Note a command that was made at an instant of the planner's clock, which may lag a little."""
        self._waiting_since_s = None
        if self._unanswered_s is not None and instant_s >= self._unanswered_s - CLOCK_LAG_S:
            self._unanswered_s = None

    def lets_go_on(self, clock_s: float, real_s: float) -> bool:
        """Return whether time may go on, at an instant and a real instant [s of any clock]."""
        if self._unanswered_s is None or clock_s - self._unanswered_s <= MOST_AHEAD_S:
            return True
        if self._waiting_since_s is None:
            self._waiting_since_s = real_s
        return real_s - self._waiting_since_s >= PATIENCE_S
