# SPDX-License-Identifier: Apache-2.0
"""
Forward runs that heat below thresholds, moved so that they meet what must be met exactly.

The value curve is worked out on a coarser model than the forward run, so its thresholds are right to
a tenth of a kelvin or so. What costs energy hardly notices; the target, and the power of a climb
that a cold battery only just delivers, do. Between one such requirement and the next the thresholds
are moved together, by the little that is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import searches as native_searches
from bev_preheat.native.runs import Heating
from bev_preheat.native.structs import SettlingStruct
from bev_preheat.planning.bracketing import ARRIVAL_TOLERANCE_K, close_in, Trial
from bev_preheat.planning.dynamics import limits_along, limits_of_steps_w, native_vehicle
from bev_preheat.planning.heat_run import initial_states, mean_share_left
from bev_preheat.planning.limits import along_limits, colder, LimitedSteps, run_within_limits, WantedHeat
from bev_preheat.planning.schedule import Schedule

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.thresholds import Thresholds
    from bev_preheat.planning.trip import Trip

# Thresholds are moved by a little first, then by as much as they may be wrong, then out of the way
# [K]: what is lacking then cannot be met by heating.
SMALL_SHIFT_K = 1.0
LARGE_SHIFT_K = 4.0
LARGEST_SHIFT_K = 40.0
# Thresholds moved by this are below every battery: only what is free is heated with.
UNHEATED_SHIFT_K = -1e3
# How much too warm the thresholds may be: before arrival they are sharp, before a climb less so.
ARRIVAL_OVERSHOOT_K = 1.0
CLIMB_OVERSHOOT_K = LARGE_SHIFT_K
MOST_RUNS = 12
# A climb is met when the battery delivers this share of its power more than is asked.
POWER_SURPLUS = 1e-5
MOST_CLIMBS = 6

# By how much a run is above what is required of it.
Excess = Callable[[Schedule], float]


def find_climbs(trip: Trip, run: Schedule) -> list[tuple[int, int]]:
    """(first, last + 1) of the stretches that a battery a little colder could not deliver."""
    _, most_w = limits_of_steps_w(
        trip.vehicle, run.soc, colder(trip.vehicle, run.temperature_c), trip.power_variance_w2)
    demanding = trip.idle_power_w > most_w
    edges = np.flatnonzero(np.diff(np.concatenate(([False], demanding, [False]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist()))[:MOST_CLIMBS]


class ThresholdSearch:
    """Forward runs of one trip under one set of thresholds."""

    def __init__(self, trip: Trip, state: BatteryState, watch: LimitedSteps,
                 thresholds: Thresholds, paid_w: FloatArray) -> None:
        """
        Take the trip, the state at its start, its Watch and its Thresholds.

        `paid_w` is the most heater power [W] that each step (N,) is to be paid for.
        """
        self._trip, self._state, self._watch = trip, state, watch
        self._cap_w = paid_w
        self._thresholds = thresholds
        self._shift_k = np.zeros(len(trip.route))
        # The step in which most of the heat of each step arrives.
        self._arrives_in_step = np.minimum(np.searchsorted(
            trip.time_s[:-1], trip.time_s[:-1] + trip.vehicle.heat_path.heat_lag_s,
            side='right') - 1, len(trip.route) - 1)
        # The run so far: what lies before a requirement that is met does not change any more.
        self._kept: Schedule | None = None

    def settle(self, target_c: float, serves_climbs: bool = True) -> Schedule:
        """
        Return the Schedule that delivers every climb it can, and arrives at the target.

        Without `serves_climbs` only the target is seen to.
        """
        trip = self._trip
        vehicle = native_vehicle(trip.vehicle)
        settled = None if vehicle is None else native_searches.settle(
            vehicle, trip.native, self._heating(), SettlingStruct(serves_climbs, target_c),
            self._start())
        if settled is not None:
            return along_limits(trip, self._watch, *settled)
        return self._settled(target_c, serves_climbs)

    def _settled(self, target_c: float, serves_climbs: bool) -> Schedule:
        self._kept = schedule = self._run()
        # What comes before `start` is settled for climbs; `free` is where a climb settles nothing.
        start = free = 0
        for first, last in find_climbs(self._trip, schedule) if serves_climbs else ():
            if first > start:
                def spare_w(run: Schedule, climb: slice = slice(first, last)) -> float:
                    return float(self._spare_power_w(run)[climb].min())

                tolerance_w = POWER_SURPLUS * float(self._trip.idle_power_w[first:last].max())
                if (spare_w(schedule) > tolerance_w
                        and spare_w(self._run(start, first, -CLIMB_OVERSHOOT_K)) > 0.0):
                    # Delivered whatever is heated for it.
                    start = last
                    continue
                schedule = self._move(start, first, schedule, spare_w, tolerance_w)
                if spare_w(schedule) < 0.0:
                    # Heating takes charge too, and where that is what lacks it makes things worse.
                    schedule = self._better_unheated(start, first, schedule, spare_w)
                start = free = last
        end = len(self._trip.route)

        def above_target_k(run: Schedule) -> float:
            return float(run.temperature_c[-1]) - target_c

        if free < start:
            schedule = self._without_more_deficit(
                free, schedule, lambda: self._meet_target(free, schedule, above_target_k))
        if start < end:
            schedule = self._meet_target(start, schedule, above_target_k)
        if start > 0 and above_target_k(schedule) < 0.0:
            # What comes after the last climb is not enough.
            schedule = self._move(0, end, schedule, above_target_k, ARRIVAL_TOLERANCE_K)
        return schedule

    def _heating(self) -> Heating:
        """Return what the core is to heat with: below thresholds that are not moved yet."""
        bands = self._thresholds.floor_c, self._thresholds.low_c, self._thresholds.high_c
        return Heating(self._cap_w, bands, self._watch.charge, self._watch.discharge, takes_surplus=True)

    def _start(self) -> States | tuple[float, float]:
        """Return the states at the start, with heater and coolant where there is a heat path."""
        states = initial_states(self._state)
        return states[:2] if self._trip.vehicle.heat_path.is_direct else states

    def _better_unheated(self, first: int, last: int, schedule: Schedule,
                         excess_of: Excess) -> Schedule:
        """Schedule, or the one without paid heating in steps first ... last - 1 if that has more."""
        shift_k = self._shift_k.copy()
        self._shift_k[first:last] = 0.0
        unheated = self._try(first, last, UNHEATED_SHIFT_K, excess_of)
        if unheated.excess < excess_of(schedule):
            self._shift_k = shift_k
            return schedule
        return self._keep(first, last, unheated)

    def _without_more_deficit(self, first: int, schedule: Schedule,
                              change: Callable[[], Schedule]) -> Schedule:
        """Schedule that `change()` returns, or this one if less can be delivered from `first` on."""
        shift_k = self._shift_k.copy()
        changed = change()
        deficit_w, more_deficit_w = (
            max(0.0, -float(self._spare_power_w(run)[first:].min())) for run in (schedule, changed))
        if more_deficit_w <= deficit_w:
            return changed
        self._shift_k, self._kept = shift_k, schedule
        return schedule

    def _meet_target(self, first: int, schedule: Schedule, above_target_k: Excess) -> Schedule:
        """Schedule moved from step `first` on so that it meets the target, and no more."""
        end = len(self._trip.route)
        if above_target_k(schedule) > ARRIVAL_TOLERANCE_K:
            # Either the thresholds are a little too warm, or heating that pays for itself, and what
            # is free, lead beyond what is required; then this shift does not bring it down.
            if above_target_k(self._run(first, end, -ARRIVAL_OVERSHOOT_K)) > 0.0:
                return schedule
        return self._move(first, end, schedule, above_target_k, ARRIVAL_TOLERANCE_K)

    def _move(self, first: int, last: int, schedule: Schedule, excess_of: Excess,
              tolerance: float) -> Schedule:
        """
        Schedule whose thresholds in steps first ... last - 1 are moved until the excess is about 0.

        It ends within the tolerance above 0, or as close to it as shifts get.
        """
        best = here = Trial(0.0, excess_of(schedule), schedule)
        if 0.0 <= here.excess <= tolerance:
            return schedule
        direction = 1.0 if here.excess < 0.0 else -1.0
        for shift_k in (SMALL_SHIFT_K, LARGE_SHIFT_K, LARGEST_SHIFT_K):
            there = self._try(first, last, direction * shift_k, excess_of)
            if there.excess * here.excess <= 0.0:
                break
            here = there
            # Heating takes charge too, and an emptier battery delivers less: more is not better.
            best = min(best, there, key=lambda trial: abs(trial.excess))
        else:
            return self._keep(first, last, best)
        # Aim at the middle of what is tolerated: either side of it ends the search.
        return self._keep(first, last, close_in(
            *((there, here) if here.excess < 0.0 else (here, there)),
            lambda shift_k: self._try(first, last, shift_k, excess_of),
            lambda enough, _: enough.excess <= tolerance, MOST_RUNS, aim=0.5 * tolerance))

    def _keep(self, first: int, last: int, trial: Trial[Schedule]) -> Schedule:
        self._shift_k = self._shifts_k(first, last, trial.value)
        self._kept = trial.outcome
        return trial.outcome

    def _shifts_k(self, first: int, last: int, shift_k: float) -> FloatArray:
        shifts_k = self._shift_k.copy()
        # A step that is moved for the second time never gets colder.
        moved = shifts_k[first:last]
        shifts_k[first:last] = np.where(moved == 0.0, shift_k, np.maximum(moved, shift_k))
        return shifts_k

    def _try(self, first: int, last: int, shift_k: float, excess_of: Excess) -> Trial[Schedule]:
        schedule = self._run(first, last, shift_k)
        return Trial(shift_k, excess_of(schedule), schedule)

    def _run(self, first: int = 0, last: int = 0, shift_k: float = 0.0) -> Schedule:
        shifts_k = self._shifts_k(first, last, shift_k)
        moved_k = shifts_k[:, np.newaxis]
        bands = (self._thresholds.floor_c, self._thresholds.low_c + moved_k,
                 self._thresholds.high_c + moved_k)
        if not self._trip.vehicle.heat_path.is_direct:
            # What is heated now arrives then.
            floor_c, low_c, high_c = (band.take(self._arrives_in_step, axis=0) for band in bands)
            bands = floor_c, low_c, high_c
        return run_within_limits(
            self._trip, self._state, self._watch, WantedHeat(self._cap_w, bands), take_surplus=True,
            first=first, before=self._kept)

    def _spare_power_w(self, schedule: Schedule) -> FloatArray:
        """Return what the battery can give beyond what each step asks without heating [W], shape (N,)."""
        _, most_w = limits_along(self._trip, schedule)
        spare_w = most_w - self._trip.idle_power_w
        if schedule.heat is not None:
            # A heater that lags goes on taking power after it was switched off.
            spare_w = spare_w - schedule.heat.heater_power_w[:-1] * mean_share_left(
                self._trip.vehicle.heat_path, self._trip.route.duration_s)
        return spare_w
