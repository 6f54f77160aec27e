# SPDX-License-Identifier: Apache-2.0
"""Faults of a heater that disobeys its command."""

from collections.abc import Sequence
from dataclasses import dataclass
import math


@dataclass(frozen=True)
class HeaterFault:
    """
    From one instant to another [s] the heater delivers `share` (0 ... 1) of the command.

    With `stuck_on` it uses all the power left by the cabin, whatever the command.
    """

    from_s: float
    until_s: float = math.inf
    share: float = 1.0
    stuck_on: bool = False


def fault_at(faults: Sequence[HeaterFault], instant_s: float) -> HeaterFault | None:
    """Return the last HeaterFault in the list that is active at an instant [s], or None."""
    return next((fault for fault in reversed(faults)
                 if fault.from_s <= instant_s < fault.until_s), None)


def next_change_s(faults: Sequence[HeaterFault], instant_s: float) -> float:
    """Return the next instant [s] after this one at which a fault begins or ends, or inf."""
    return min((edge_s for fault in faults for edge_s in (fault.from_s, fault.until_s)
                if edge_s > instant_s), default=math.inf)
