# SPDX-License-Identifier: Apache-2.0
"""The lease on a power under which a simulated car drives; it expires by itself."""

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class HeaterLease:
    """
    Permission to use `power_w` [W] for the battery up to the instant `until_s`, then 0 W.

    Instants are seconds after the start of the route.
    """

    power_w: float
    until_s: float


NO_LEASE = HeaterLease(0.0, -math.inf)
