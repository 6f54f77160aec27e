# SPDX-License-Identifier: Apache-2.0
"""
Forward runs that heat below thresholds, shifted so that the run meets its requirements exactly.

The value curve is computed on a coarser model than the forward run, so its thresholds are accurate to about a
tenth of a kelvin. That hardly affects the energy, but it does affect the target, and the power of a climb that a
cold battery only just delivers. Between two such requirements the thresholds are shifted together, as little as
necessary.
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
from bev_preheat.planning.limits import along_limits, colder, run_within_limits
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.wanted_heat import LimitedSteps, WantedHeat

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.thresholds import Thresholds
    from bev_preheat.planning.trip import Trip

# Thresholds are shifted a little first, then by their possible error, then out of the way [K]: a deficit that
# remains cannot be met by heating.
SMALL_SHIFT_K = 1.0
LARGE_SHIFT_K = 4.0
LARGEST_SHIFT_K = 40.0
# Thresholds with this shift are below every battery temperature: only free surplus is used.
UNHEATED_SHIFT_K = -1e3
# Possible excess of the thresholds: they are sharp before arrival, less so before a climb.
ARRIVAL_OVERSHOOT_K = 1.0
CLIMB_OVERSHOOT_K = LARGE_SHIFT_K
MOST_RUNS = 12
# A climb is met when the battery can deliver this share more than its power.
POWER_SURPLUS = 1e-5
MOST_CLIMBS = 6

# Excess of a run over its requirement.
Excess = Callable[[Schedule], float]


def find_climbs(trip: Trip, run: Schedule) -> list[tuple[int, int]]:
    """Return the climbs (first, last + 1) that a slightly colder battery could not deliver."""
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
        Take the trip, the state at its start, its LimitedSteps and its Thresholds.

        `paid_w` is the highest heater power [W] worth paying for in each step (N,).
        """
        self._trip, self._state, self._watch = trip, state, watch
        self._cap_w = paid_w
        self._thresholds = thresholds
        self._shift_k = np.zeros(len(trip.route))
        # The step in which most of the heat of each step arrives.
        self._arrives_in_step = np.minimum(np.searchsorted(
            trip.time_s[:-1], trip.time_s[:-1] + trip.vehicle.heat_path.heat_lag_s,
            side='right') - 1, len(trip.route) - 1)
        # The run so far: the part before a requirement that is met no longer changes.
        self._kept: Schedule | None = None

    def settle(self, target_c: float, serves_climbs: bool = True) -> Schedule:
        """
        Return the Schedule that delivers every climb it can, and arrives at the target.

        Without `serves_climbs` only the target counts.
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
        # Steps before `start` are settled for climbs; from `free` on, no climb has settled anything.
        start = free = 0
        for first, last in find_climbs(self._trip, schedule) if serves_climbs else ():
            if first > start:
                def spare_w(run: Schedule, climb: slice = slice(first, last)) -> float:
                    return float(self._spare_power_w(run)[climb].min())

                tolerance_w = POWER_SURPLUS * float(self._trip.idle_power_w[first:last].max())
                if (spare_w(schedule) > tolerance_w
                        and spare_w(self._run(start, first, -CLIMB_OVERSHOOT_K)) > 0.0):
                    # Delivered however the battery is heated before.
                    start = last
                    continue
                schedule = self._move(start, first, schedule, spare_w, tolerance_w)
                if spare_w(schedule) < 0.0:
                    # Heating also takes charge; if charge is the bottleneck, heating makes things worse.
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
            # The heating after the last climb is not enough.
            schedule = self._move(0, end, schedule, above_target_k, ARRIVAL_TOLERANCE_K)
        return schedule

    def _heating(self) -> Heating:
        """Return the core's input for heating below the unshifted thresholds."""
        bands = self._thresholds.floor_c, self._thresholds.low_c, self._thresholds.high_c
        return Heating(self._cap_w, bands, self._watch.charge, self._watch.discharge, takes_surplus=True)

    def _start(self) -> States | tuple[float, float]:
        """Return the states at the start, including heater and coolant if there is a heat path."""
        states = initial_states(self._state)
        return states[:2] if self._trip.vehicle.heat_path.is_direct else states

    def _better_unheated(self, first: int, last: int, schedule: Schedule,
                         excess_of: Excess) -> Schedule:
        """Return the schedule, or the unheated one in steps first ... last - 1 if its excess is larger."""
        shift_k = self._shift_k.copy()
        self._shift_k[first:last] = 0.0
        unheated = self._try(first, last, UNHEATED_SHIFT_K, excess_of)
        if unheated.excess < excess_of(schedule):
            self._shift_k = shift_k
            return schedule
        return self._keep(first, last, unheated)

    def _without_more_deficit(self, first: int, schedule: Schedule,
                              change: Callable[[], Schedule]) -> Schedule:
        """Return the Schedule of `change()`, or this one if the change increases the deficit from `first` on."""
        shift_k = self._shift_k.copy()
        changed = change()
        deficit_w, more_deficit_w = (
            max(0.0, -float(self._spare_power_w(run)[first:].min())) for run in (schedule, changed))
        if more_deficit_w <= deficit_w:
            return changed
        self._shift_k, self._kept = shift_k, schedule
        return schedule

    def _meet_target(self, first: int, schedule: Schedule, above_target_k: Excess) -> Schedule:
        """Return the Schedule shifted from step `first` on so that it just meets the target."""
        end = len(self._trip.route)
        if above_target_k(schedule) > ARRIVAL_TOLERANCE_K:
            # Either the thresholds are a little too warm, or free heat and heating that pays for itself exceed the
            # requirement; then this shift does not bring the temperature down.
            if above_target_k(self._run(first, end, -ARRIVAL_OVERSHOOT_K)) > 0.0:
                return schedule
        return self._move(first, end, schedule, above_target_k, ARRIVAL_TOLERANCE_K)

    def _move(self, first: int, last: int, schedule: Schedule, excess_of: Excess,
              tolerance: float) -> Schedule:
        """
        Return the Schedule with the thresholds in steps first ... last - 1 shifted until the excess is about 0.

        The excess ends within the tolerance above 0, or as close to it as shifts allow.
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
            # Heating also takes charge, and an emptier battery delivers less: more heat is not always better.
            best = min(best, there, key=lambda trial: abs(trial.excess))
        else:
            return self._keep(first, last, best)
        # Aim at the middle of the tolerance: trials on either side end the search.
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
        # A step that is shifted a second time never gets colder.
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
            # Heat of this step arrives in that step.
            floor_c, low_c, high_c = (band.take(self._arrives_in_step, axis=0) for band in bands)
            bands = floor_c, low_c, high_c
        return run_within_limits(
            self._trip, self._state, self._watch, WantedHeat(self._cap_w, bands), take_surplus=True,
            first=first, before=self._kept)

    def _spare_power_w(self, schedule: Schedule) -> FloatArray:
        """Return the spare power of the battery in each step, without heating [W], shape (N,)."""
        _, most_w = limits_along(self._trip, schedule)
        spare_w = most_w - self._trip.idle_power_w
        if schedule.heat is not None:
            # A heater with lag goes on drawing power after it is switched off.
            spare_w = spare_w - schedule.heat.heater_power_w[:-1] * mean_share_left(
                self._trip.vehicle.heat_path, self._trip.route.duration_s)
        return spare_w
