# SPDX-License-Identifier: Apache-2.0
"""The simulated heater controller's lease on a command, which expires by itself."""

from dataclasses import dataclass
import math

from bev_preheat.errors import InvalidInput


@dataclass(frozen=True)
class HeaterLease:
    """
    Permission to use `power_w` [W] for the battery up to the instant `until_s`, then 0 W.

    Instants are seconds after the start of the route.
    """

    power_w: float
    until_s: float


NO_LEASE = HeaterLease(0.0, -math.inf)


def lease_of_command(power_w: float, until_s: float, now_s: float,
                     maximum_power_w: float) -> HeaterLease:
    """
    Return the HeaterLease of a command; raise InvalidInput if the command is invalid.

    `power_w` [W] must be 0 ... `maximum_power_w`, the heater's own. The cabin may leave less; the vehicle
    then limits the power. `until_s` must be after `now_s`.
    """
    problems = []
    if not 0.0 <= power_w <= maximum_power_w:
        problems.append(f'battery_heating_power: {power_w:g} W is not allowed; it must be '
                        f'0 ... {maximum_power_w:g} W')
    if not until_s > now_s:
        problems.append(f'valid_until: is {now_s - until_s:.3f} s in the past')
    if problems:
        raise InvalidInput(problems)
    return HeaterLease(power_w, until_s)
