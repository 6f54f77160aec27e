# SPDX-License-Identifier: Apache-2.0
"""A heater that does not do what it is told."""

from collections.abc import Sequence
from dataclasses import dataclass
import math


@dataclass(frozen=True)
class HeaterFault:
    """
    From one instant to another [s] the heater gives `share` (0 ... 1) of what is commanded.

    With `stuck_on` it heats with all that the cabin leaves, whatever is commanded.
    """

    from_s: float
    until_s: float = math.inf
    share: float = 1.0
    stuck_on: bool = False


def fault_at(faults: Sequence[HeaterFault], instant_s: float) -> HeaterFault | None:
    """Return the HeaterFault that holds at an instant [s], the last one named; None where none."""
    return next((fault for fault in reversed(faults)
                 if fault.from_s <= instant_s < fault.until_s), None)


def next_change_s(faults: Sequence[HeaterFault], instant_s: float) -> float:
    """Return the next instant [s] after this one at which a fault begins or ends; inf: none."""
    return min((edge_s for fault in faults for edge_s in (fault.from_s, fault.until_s)
                if edge_s > instant_s), default=math.inf)
