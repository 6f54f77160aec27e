# SPDX-License-Identifier: Apache-2.0
"""What the heater was told of late."""

from collections import deque

# What lies further back is not asked for.
KEPT_NS = 70_000_000_000


class CommandHistory:
    """The heater's commanded power [W] over the last minutes; instants in nanoseconds."""

    def __init__(self):
        """No command so far: 0 W."""
        self._changes = deque([(0, 0.0)])

    def note(self, instant_ns, power_w):
        """Note that from an instant on this is commanded; instants do not fall."""
        changes = self._changes
        if changes[-1][0] > instant_ns:
            # The clock was set back: what was noted before lies in no time of its own.
            changes.clear()
            changes.append((0, 0.0))
        if changes[-1][1] == power_w:
            return
        changes.append((instant_ns, power_w))
        while len(changes) > 2 and changes[1][0] < instant_ns - KEPT_NS:
            changes.popleft()

    def mean_w(self, from_ns, to_ns):
        """Return the mean commanded power [W] between two instants; at one, where they are one."""
        later_ns, energy = to_ns, 0.0
        for changed_ns, power_w in reversed(self._changes):
            if changed_ns >= later_ns and to_ns > from_ns:
                continue
            if to_ns <= from_ns:
                if changed_ns <= to_ns:
                    return power_w
                continue
            start_ns = max(changed_ns, from_ns)
            energy += power_w * (later_ns - start_ns)
            later_ns = start_ns
            if later_ns <= from_ns:
                break
        return energy / (to_ns - from_ns) if to_ns > from_ns else 0.0
