# SPDX-License-Identifier: Apache-2.0
"""
Values of a plan, stored for the plans after it: an update is then the forward pass alone.

The values of `value_function` are the worth of each temperature at each instant of a drive, so they serve
wherever the battery is a moment later. They are found again once they no longer hold: for another route, heater,
goal, uncertainty or price, or after VALUES_KEPT_S of driving, because the corrected model has moved on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from bev_preheat.planning import engine
from bev_preheat.tunables import MOST_CHANGED_SHARE, MOST_DEVIATION_SHARE, VALUES_KEPT_S

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.situation import Uncertainty
    from bev_preheat.planning.trip import Trip

# An update makes plans for a heater as it is and as it should be.
KEPT_VALUE_FUNCTIONS = 2


@dataclass(frozen=True)
class Requirements:
    """The target on arrival [deg C], the charge that heating must leave, the Uncertainty, and prices of steps."""

    target_c: float
    reserve: float
    uncertainty: Uncertainty
    price: FloatArray | None = None


class KeptValues:
    """
    The values of the latest plans of a drive, with their trips and requirements, while a plan is made.

    `latest` is what to begin with, and after the plan what to begin the next one with.
    """

    def __init__(self, latest: tuple[Kept, ...] = ()) -> None:
        """Begin with the values of the plans before."""
        self.latest = latest

    def keep(self, trip: Trip, start: States, wanted: Requirements, values: Any) -> None:
        """Keep the values of a plan; None: it found none."""
        kept = Kept(trip, start, wanted, values is not None)
        _VALUES[kept] = values
        self.latest = (kept, *self.latest)[:KEPT_VALUE_FUNCTIONS]

    def that_hold(self, trip: Trip, wanted: Requirements) -> Any:
        """Return the values that hold for the rest of their trip, or None."""
        return next((kept.values for kept in self.latest if kept.holds_for(trip, wanted)), None)


@dataclass(frozen=True, eq=False)
class Kept:
    """
    One plan whose values are kept: its trip, start and requirements, from which they follow; a value.

    `has_values`: a plan was found.
    """

    trip: Trip
    start: States
    wanted: Requirements
    has_values: bool

    @property
    def values(self) -> Any:
        """The values; they are found again if they are not in this process."""
        if self not in _VALUES:
            _VALUES[self] = (engine.find_values(self.trip, self.start, self.wanted).values
                             if self.has_values else None)
        return _VALUES[self]

    def holds_for(self, trip: Trip, wanted: Requirements) -> bool:
        """Return whether the values hold for the rest of their trip."""
        if not _is_rest_of(self.trip, trip):
            return False
        made = self.wanted
        passed = len(self.trip.route) - len(trip.route)
        left_share = trip.route.total_duration_s / self.trip.route.total_duration_s
        expected_k = made.uncertainty.deviation_k * left_share
        return ((wanted.target_c, wanted.reserve) == (made.target_c, made.reserve)
                and abs(wanted.uncertainty.deviation_k - expected_k) <= MOST_DEVIATION_SHARE * expected_k
                and (wanted.price is None) == (made.price is None)
                and (wanted.price is None or made.price is None
                     or np.array_equal(wanted.price, made.price[passed:])))


# The values of the plans that are kept.
_VALUES: WeakKeyDictionary[Kept, Any] = WeakKeyDictionary()


def _is_rest_of(whole: Trip, trip: Trip) -> bool:
    """Return whether a trip is the rest of another, as far as the values of that depend on it."""
    passed = len(whole.route) - len(trip.route)
    passed_s = whole.route.total_duration_s - trip.route.total_duration_s
    battery, battery_then = trip.vehicle.battery, whole.vehicle.battery
    if not (passed >= 0 and 0.0 <= passed_s <= VALUES_KEPT_S
            and battery.discharge_power_limit == battery_then.discharge_power_limit
            and battery.charge_power_limit == battery_then.charge_power_limit
            and battery.temperature_range_c == battery_then.temperature_range_c):
        return False
    power_w = whole.idle_power_w[passed:]
    return bool(
        np.array_equal(trip.route.duration_s[1:], whole.route.duration_s[passed + 1:])
        and np.array_equal(trip.heater_limit_w, whole.heater_limit_w[passed:])
        and np.abs(trip.idle_power_w - power_w).max() <= MOST_CHANGED_SHARE * np.abs(power_w).max())
