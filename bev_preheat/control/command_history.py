# SPDX-License-Identifier: Apache-2.0
"""The heater's commands: power over the last minutes, and time of heating."""

from collections import deque

from bev_preheat.numerics.factors import NS_PER_S

# No caller asks further back.
KEPT_NS = 70_000_000_000


class CommandHistory:
    """The heater's commanded power [W] over the last minutes; instants in nanoseconds."""

    def __init__(self) -> None:
        """No command so far: 0 W."""
        self._changes = deque([(0, 0.0)])
        self._heated_ns = 0

    def note(self, instant_ns: int, power_w: float) -> None:
        """Note that `power_w` is commanded from an instant on; instants do not fall."""
        changes = self._changes
        if changes[-1][0] > instant_ns:
            # The clock was set back: earlier entries are void.
            changes.clear()
            changes.append((0, 0.0))
        if changes[-1][1] == power_w:
            return
        self._heated_ns += self._heating_for_ns(instant_ns)
        changes.append((instant_ns, power_w))
        while len(changes) > 2 and changes[1][0] < instant_ns - KEPT_NS:
            changes.popleft()

    def heating_for_s(self, now_ns: int) -> float:
        """Return for how long [s] the latest power, if it is not 0, has been commanded."""
        return self._heating_for_ns(now_ns) / NS_PER_S

    def heated_s(self, now_ns: int) -> float:
        """Return for how long [s] heating has been commanded since `forget_heating`."""
        return (self._heated_ns + self._heating_for_ns(now_ns)) / NS_PER_S

    def forget_heating(self, now_ns: int) -> None:
        """Count the time of heating from 0 again, because another drive begins."""
        self._heated_ns = -self._heating_for_ns(now_ns)

    def _heating_for_ns(self, now_ns: int) -> int:
        since_ns, power_w = self._changes[-1]
        return max(0, now_ns - since_ns) if power_w > 0.0 else 0

    def mean_w(self, from_ns: int, to_ns: int) -> float:
        """Return the mean commanded power [W] between two instants; the power then if they are equal."""
        if to_ns <= from_ns:
            return self.power_w(to_ns)
        later_ns, energy = to_ns, 0.0
        for changed_ns, power_w in reversed(self._changes):
            if changed_ns >= later_ns:
                continue
            start_ns = max(changed_ns, from_ns)
            energy += power_w * (later_ns - start_ns)
            later_ns = start_ns
            if later_ns <= from_ns:
                break
        return energy / (to_ns - from_ns)

    def power_w(self, instant_ns: int) -> float:
        """Return the power [W] that was commanded at an instant."""
        for changed_ns, power_w in reversed(self._changes):
            if changed_ns <= instant_ns:
                return power_w
        return 0.0
