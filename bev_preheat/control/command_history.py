# SPDX-License-Identifier: Apache-2.0
"""The heater's commands: power over the last minutes, and time of heating."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bev_preheat.numerics.factors import NS_PER_S

# No caller asks further back.
KEPT_NS = 70_000_000_000
NO_CHANGES: tuple[tuple[int, float], ...] = ((0, 0.0),)


@dataclass(frozen=True)
class CommandHistory:
    """
    The heater's commanded power [W] over the last minutes; instants in nanoseconds.

    `changes` are the instants of changes with the power after each; `heated_ns` is the time of heating up to the
    latest change, since `without_heating`.
    """

    changes: tuple[tuple[int, float], ...] = NO_CHANGES
    heated_ns: int = 0

    def noted(self, instant_ns: int, power_w: float) -> CommandHistory:
        """Return the history with `power_w` commanded from an instant on; instants do not fall."""
        # A clock that was set back voids earlier entries.
        changes = NO_CHANGES if self.changes[-1][0] > instant_ns else self.changes
        if changes[-1][1] == power_w:
            return self if changes is self.changes else replace(self, changes=changes)
        heated_ns = self.heated_ns + _heating_for_ns(changes, instant_ns)
        changes = (*changes, (instant_ns, power_w))
        while len(changes) > 2 and changes[1][0] < instant_ns - KEPT_NS:
            changes = changes[1:]
        return CommandHistory(changes, heated_ns)

    def heating_for_s(self, now_ns: int) -> float:
        """Return for how long [s] the latest power, if it is not 0, has been commanded."""
        return _heating_for_ns(self.changes, now_ns) / NS_PER_S

    def heated_s(self, now_ns: int) -> float:
        """Return for how long [s] heating has been commanded since `without_heating`."""
        return (self.heated_ns + _heating_for_ns(self.changes, now_ns)) / NS_PER_S

    def without_heating(self, now_ns: int) -> CommandHistory:
        """Return the history that counts the time of heating from 0 again, because another drive begins."""
        return replace(self, heated_ns=-_heating_for_ns(self.changes, now_ns))

    def mean_w(self, from_ns: int, to_ns: int) -> float:
        """Return the mean commanded power [W] between two instants; the power then if they are equal."""
        if to_ns <= from_ns:
            return self.power_w(to_ns)
        later_ns, energy = to_ns, 0.0
        for changed_ns, power_w in reversed(self.changes):
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
        for changed_ns, power_w in reversed(self.changes):
            if changed_ns <= instant_ns:
                return power_w
        return 0.0


def _heating_for_ns(changes: tuple[tuple[int, float], ...], now_ns: int) -> int:
    since_ns, power_w = changes[-1]
    return max(0, now_ns - since_ns) if power_w > 0.0 else 0
