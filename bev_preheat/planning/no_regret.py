# SPDX-License-Identifier: Apache-2.0
"""
Make sure that no plan is worse than not heating: compare each with the trip without paid heating.

Paid heating costs charge. If the charge is not enough for the trip, nothing is heated. A plan that would use
charge from the reserve, or that increases a power deficit of the drive, is made again for the warmest target that
does neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TYPE_CHECKING

from bev_preheat.numerics import FLOATS
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.limits import drive_as_planned, limits_hold, run_unheated
from bev_preheat.planning.outcome import find_stranding, power_deficit
from bev_preheat.planning.schedule import HeldBack, Method, Schedule
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.tunables import NO_WORSE_W, SOC_TOLERANCE, TARGET_HALVINGS
from bev_preheat.vehicle.model import hottest_c

if TYPE_CHECKING:
    from bev_preheat.planning.trip import Trip


# Returns the Schedule for a target [deg C].
Proposal = Callable[[float], Schedule]


def unheated_within_limits(trip: Trip, state: BatteryState, unheated: Schedule) -> Schedule:
    """Return the unheated Schedule if it keeps the limits, else a Schedule heated with free surplus only."""
    return unheated if limits_hold(trip, unheated) else run_unheated(trip, state)


class NoRegretCheck:
    """Checks proposals for one trip, state and goal against the trip without paid heating."""

    def __init__(self, trip: Trip, state: BatteryState, goal: Goal, unheated: Schedule) -> None:
        """`unheated` is the Schedule without any heating, ignoring limits."""
        self._trip, self._goal = trip, goal
        self.unheated = unheated_within_limits(trip, state, unheated)
        self._reserve = reserve_soc(trip.vehicle, goal)
        self._lowest_soc = trip.vehicle.battery.soc_range[0]
        deficit_w = power_deficit(trip, self.unheated).worst_w
        self._allowed_w = deficit_w + NO_WORSE_W if deficit_w > 0.0 else 0.0
        # If the reserve is missed without heating, heat may still pay for itself.
        self._least_spare = min(self._spare_soc(self.unheated), 0.0)

    def serve(self, proposals: Sequence[Proposal]) -> Schedule:
        """
        Return the first allowed Schedule of proposals, the last one's for the warmest allowed target, or unheated.

        A proposal is a function of a target [deg C] that returns a Schedule; the most demanding comes first.
        """
        if self.unheated.empty_at_s is not None:
            return self.unheated
        wanted_c = self._goal.target_temperature_c
        for propose in proposals:
            wanted = propose(wanted_c)
            if self.allows(wanted):
                return wanted
        held_back = HeldBack.RESERVE if self._spare_soc(wanted) < self._least_spare else HeldBack.POWER
        return replace(self._warmest(propose, wanted_c), held_back=held_back)

    def allows(self, schedule: Schedule) -> bool:
        """Return whether a Schedule keeps the reserve, as far as the unheated one does, and the drive's power."""
        return (self._spare_soc(schedule) >= self._least_spare
                and power_deficit(self._trip, schedule).worst_w <= self._allowed_w)

    def _spare_soc(self, schedule: Schedule) -> float:
        """
        Charge to spare: above the reserve on arrival, and above the lowest state of charge on the way.

        Negative by the deficit if the charge runs out, even without a reserve.
        """
        spare = min(float(schedule.soc[-1]) - self._reserve,
                    float(schedule.soc.min()) - self._lowest_soc)
        stranding = find_stranding(self._trip, schedule)
        if stranding is None:
            return spare
        battery = self._trip.vehicle.battery
        whole_wh = battery.capacity_ah * battery.open_circuit_voltage.function(FLOATS)(
            0.0, float(schedule.temperature_c[-1]))
        return spare - max(stranding.deficit_wh / whole_wh, SOC_TOLERANCE)

    def _warmest(self, propose: Proposal, wanted_c: float) -> Schedule:
        """Return the warmest allowed Schedule of a proposal that is not allowed for its target [deg C]."""
        best = self.unheated

        def is_allowed(target_c: float) -> bool:
            nonlocal best
            schedule = propose(target_c)
            allowed = self.allows(schedule)
            best = schedule if allowed else best
            return allowed

        # Also above the arrival of the wanted plan: a heater that gives way to the drive misses any target.
        halve(float(best.temperature_c[-1]), wanted_c, is_allowed, TARGET_HALVINGS)
        return best


def giving_way(method: Method) -> Method:
    """Return the method with its heater cut wherever the drive needs the power."""
    def plan(trip: Trip, state: BatteryState, goal: Goal, **options: Any) -> Schedule:
        schedule = method(trip, state, goal, **options)
        if power_deficit(trip, schedule).worst_w == 0.0 and is_described(trip, schedule):
            return schedule
        return drive_as_planned(trip, state, schedule.heater_power_w)
    return plan


def is_described(trip: Trip, schedule: Schedule) -> bool:
    """Return whether a run stays within the charge and heat that the model describes."""
    return bool(schedule.soc.min() > 0.0 and schedule.soc.max() <= 1.0
                and schedule.temperature_c.max() <= hottest_c(trip.vehicle))
