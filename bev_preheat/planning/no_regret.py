# SPDX-License-Identifier: Apache-2.0
"""
Make sure that no plan is worse than not heating: compare each proposal with the unheated trip.

Paid heating costs charge. If the charge is not enough for the trip, nothing is heated. If heating would use
charge from the reserve, the target is lowered until the reserve is met. If the battery cannot deliver the power
for the drive, plans that increase the deficit are rejected: heat helps a cold battery, but a nearly empty one
only gets emptier.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.native import searches as native_searches
from bev_preheat.native.structs import SafeGoalStruct
from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.bracketing import close_in, Trial
from bev_preheat.planning.dynamics import hottest_c, native_vehicle
from bev_preheat.planning.heat_run import initial_states
from bev_preheat.planning.limits import drive_as_planned, limits_hold, run_unheated
from bev_preheat.planning.outcome import find_stranding, power_deficit
from bev_preheat.planning.rows import schedule_of, states_of
from bev_preheat.planning.schedule import HeldBack, Method, Schedule
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc

if TYPE_CHECKING:
    from bev_preheat.planning.trip import Trip
    from bev_preheat.planning.uncertainty_margin import UncertaintyMargin

# If the unheated trip has a power deficit too, a plan may increase it by this many watts.
NO_WORSE_W = 10.0
# The search for the warmest allowed target ends when no more charge than this is left to spare, or when the
# target is known to this (less exactly if power decides). It makes at most this many trials, and then halves the
# bracket at most this often, because the spare power jumps where a deficit begins.
SOC_TOLERANCE = 1e-5
# Spare charge to aim at if the goal's target misses by less than this: otherwise the search would not move off it.
SOC_AIM = 1e-6
TARGET_TOLERANCE_K = 5e-6
TARGET_TOLERANCE_OF_POWER_K = 0.1
MOST_TARGETS = 8
MOST_HALVINGS = 8
# This power deficit weighs as much as the whole charge.
POWER_WEIGHT_W = 1e6
# A target this far below the unheated run asks for no heating.
BELOW_UNHEATED_K = 1.0

# In the order of `bev_held_back` in core.h.
HELD_BACK = None, HeldBack.RESERVE, HeldBack.POWER

# Returns the Schedule for a target [deg C].
Proposal = Callable[[float], Schedule]


def unheated_within_limits(trip: Trip, state: BatteryState, unheated: Schedule) -> Schedule:
    """Return the unheated Schedule if it keeps the limits, else a Schedule heated with free surplus only."""
    return unheated if limits_hold(trip, unheated) else run_unheated(trip, state)


def checked_by_core(trip: Trip, state: BatteryState, goal: Goal, uncertainty_margin: UncertaintyMargin | None,
                    unheated: Schedule) -> Schedule | None:
    """
    Return `NoRegretCheck.serve` for the proposals of `merit_order`, in one call of the native core.

    None if the core does not answer. `unheated` is the Schedule without any heating, ignoring limits.
    """
    vehicle = native_vehicle(trip.vehicle)
    if vehicle is None:
        return None
    margin_k, asked = (0.0, None) if uncertainty_margin is None else (
        uncertainty_margin.margin_k, uncertainty_margin.native)
    found = native_searches.plan_no_regret(
        vehicle, trip.native, SafeGoalStruct(
            goal.target_temperature_c, margin_k, reserve_soc(trip.vehicle, goal),
            trip.vehicle.battery.soc_range[0]), asked, states_of(unheated))
    if found is None:
        return None
    plan, held_back = found
    schedule = (unheated_within_limits(trip, state, unheated) if plan is None
                else schedule_of(trip, plan))
    return replace(schedule, held_back=HELD_BACK[held_back]) if held_back else schedule


class NoRegretCheck:
    """Checks proposals for one trip, state and goal against the trip without paid heating."""

    def __init__(self, trip: Trip, state: BatteryState, goal: Goal, unheated: Schedule) -> None:
        """`unheated` is the Schedule without any heating, ignoring limits."""
        self._trip, self._state, self._goal = trip, state, goal
        self._unlimited = unheated
        self._reserve = reserve_soc(trip.vehicle, goal)
        self._lowest_soc = trip.vehicle.battery.soc_range[0]
        deficit_w, self._is_stranded = self._lacks()
        self._allowed_w = deficit_w + NO_WORSE_W if deficit_w > 0.0 else 0.0

    @cached_property
    def unheated(self) -> Schedule:
        """The Schedule without paid heating; it uses free surplus that the brake would waste."""
        return unheated_within_limits(self._trip, self._state, self._unlimited)

    def _lacks(self) -> tuple[float, bool]:
        """Return the power deficit [W] of the trip without paid heating, and whether its charge runs out."""
        vehicle = native_vehicle(self._trip.vehicle)
        start = initial_states(self._state)[:2 if self._trip.vehicle.heat_path.is_direct else 4]
        found = None if vehicle is None else native_searches.unheated_deficit(
            vehicle, self._trip.native, start)
        if found is not None:
            return found[0], found[1] is not None
        return (power_deficit(self._trip, self.unheated).worst_w,
                self.unheated.empty_at_s is not None)

    def serve(self, proposals: Sequence[Proposal]) -> Schedule:
        """
        Return the Schedule of the first allowed proposal, or the unheated one.

        A proposal is a function of a target [deg C] that returns a Schedule; the most demanding comes
        first. Each is tried with the goal's target, then with the warmest allowed target.
        """
        if self._is_stranded:
            return self.unheated
        held_back = None
        for proposal in proposals:
            wanted = proposal(self._goal.target_temperature_c)
            if self.allows(wanted):
                return wanted
            held_back = (HeldBack.RESERVE if self._spare_soc(wanted) < 0.0
                         else HeldBack.POWER)
            found = self._warmest(proposal, wanted)
            if found is not None:
                return replace(found, held_back=held_back)
        return replace(self.unheated, held_back=held_back)

    def allows(self, schedule: Schedule) -> bool:
        """Return whether a Schedule keeps the reserve and stays within the allowed power deficit."""
        return self._spare_soc(schedule) >= 0.0 and self._spare_power_w(schedule) >= 0.0

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

    def _spare_power_w(self, schedule: Schedule) -> float:
        """By how much the power deficit may grow [W] before a schedule is worse than not heating."""
        return self._allowed_w - power_deficit(self._trip, schedule).worst_w

    def _warmest(self, proposal: Proposal, wanted: Schedule) -> Schedule | None:
        """Return the proposal's warmest allowed Schedule; None without one."""
        # Driving alone meets this target, so only heating that pays for itself remains.
        lowest_c = self._trip.vehicle.battery.temperature_range_c[0]
        cold_c = max(float(self.unheated.temperature_c.min()) - BELOW_UNHEATED_K, lowest_c)
        found = proposal(cold_c)
        if self._spare_power_w(found) < 0.0:
            return None
        if self._spare_soc(found) <= 0.0:
            pays = self._spare_soc(found) >= min(self._spare_soc(self.unheated), 0.0)
            return found if pays else None
        allowed = self._trial(max(cold_c, float(found.temperature_c[-1])), found)
        forbidden = self._trial(self._goal.target_temperature_c, wanted)
        arrival_c = float(wanted.temperature_c[-1])
        if arrival_c < forbidden.value - TARGET_TOLERANCE_OF_POWER_K:
            # A target out of reach gives no other information. Asking for the temperature it reaches heats less
            # where the heater gives way to the drive.
            reached = self._trial(arrival_c, proposal(arrival_c))
            allowed, forbidden = (reached, forbidden) if reached.excess >= 0.0 else (allowed, reached)
        warmest = close_in(
            allowed, forbidden, lambda target_c: self._trial(target_c, proposal(target_c)), _is_close,
            MOST_TARGETS, SOC_AIM if forbidden.excess > -SOC_AIM else 0.0, MOST_HALVINGS)
        return warmest.outcome.schedule

    def _trial(self, target_c: float, schedule: Schedule) -> Trial[_Proposed]:
        """Return the Trial of a target; its excess is the spare charge [share of the charge]."""
        spare_soc, spare_w = self._spare_soc(schedule), self._spare_power_w(schedule)
        # Spare power does not make heat affordable; a power deficit forbids it.
        excess = spare_soc if spare_w >= 0.0 else min(spare_soc, spare_w / POWER_WEIGHT_W)
        return Trial(target_c, excess, _Proposed(schedule, spare_w < 0.0))


class _Proposed(NamedTuple):
    """A proposal for a target; `lacks_power`: its power deficit is larger than allowed."""

    schedule: Schedule
    lacks_power: bool


def _is_close(allowed: Trial[_Proposed], forbidden: Trial[_Proposed]) -> bool:
    width_k = TARGET_TOLERANCE_OF_POWER_K if forbidden.outcome.lacks_power else TARGET_TOLERANCE_K
    return allowed.excess <= SOC_TOLERANCE or forbidden.value - allowed.value <= width_k


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
