# SPDX-License-Identifier: Apache-2.0
"""
One stretch of heating for a vehicle with a heat path: switched on, and off before arrival.

Heat that is made just before arrival is still in heater and coolant when the vehicle is there. So the
cheapest schedule without limits has two switching instants (docs/explanation/planning.md). For each
instant of switching off there is one of switching on with which the battery arrives at the target;
of these pairs the one that takes the least from the battery is searched for.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.bracketing import follow_slope, least_of, Trial
from bev_preheat.planning.dynamics import keep_accounts
from bev_preheat.planning.heat_run import initial_states, roll_heated, run_heated, states_at
from bev_preheat.planning.schedule import Schedule

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip

# The target is met when the forward run arrives this close [K], as with one switch.
ARRIVAL_TOLERANCE_K = 5e-6
# So many lags before arrival all heat but a few parts in a million has arrived.
MOST_LAGS = 12.0
# Around the best instant of switching off the energy hardly changes.
OFF_RESOLUTION_S = 0.5
MOST_RUNS = 60
# A kelvin that is lacking counts more than any energy.
LACKING_WH_PER_K = 1e9


def maximum_between(trip: Trip, on_s: float, off_s: float) -> FloatArray:
    """Return the mean heater power [W] of each step (N,) at full power between two instants [s]."""
    share_on = np.minimum(trip.time_s[1:], off_s) - np.maximum(trip.time_s[:-1], on_s)
    return np.clip(share_on / trip.route.duration_s, 0.0, 1.0) * trip.heater_limit_w


def plan_two_switches(trip: Trip, state: BatteryState, goal: Goal,
                      unheated: Schedule | None = None) -> Schedule:
    """
    Return the Schedule with one stretch of full heating that arrives at the target.

    `unheated` is the Schedule without any heating, limits left aside, where it is known already.
    Where heating until arrival is not enough, the schedule heats all the way.
    """
    if unheated is None:
        unheated = run_heated(trip, initial_states(state), np.zeros(len(trip.route)))
    if unheated.temperature_c[-1] >= goal.target_temperature_c:
        return unheated
    search = _Search(trip, unheated, goal.target_temperature_c)
    arrival_s = float(trip.time_s[-1])
    throughout = search.schedule(0.0, arrival_s)
    if throughout.temperature_c[-1] <= goal.target_temperature_c:
        return throughout
    earliest_s = max(0.0, arrival_s - MOST_LAGS * trip.vehicle.heat_path.heat_lag_s)
    return least_of(earliest_s, arrival_s, search.until, OFF_RESOLUTION_S).outcome


class _Search:
    """Schedules that heat from one instant to another, arriving at a target."""

    def __init__(self, trip: Trip, unheated: Schedule, target_c: float) -> None:
        self._trip, self._unheated, self._target_c = trip, unheated, target_c
        vehicle = trip.vehicle
        self._capacity_j_per_k = (vehicle.battery.heat_capacity_j_per_k
                                  + vehicle.heat_path.coolant_heat_capacity_j_per_k)
        mean_w = vehicle.hvch.efficiency * float(
            trip.heater_limit_w @ trip.route.duration_s) / float(trip.time_s[-1])
        lacking_k = target_c - float(unheated.temperature_c[-1])
        # For how long about to heat: where the search for the next switching-on begins.
        self._heated_s = lacking_k * self._capacity_j_per_k / max(mean_w, 1.0)

    def schedule(self, on_s: float, off_s: float) -> Schedule:
        """Return the Schedule that heats between two instants [s]."""
        command_w = maximum_between(self._trip, on_s, off_s)
        first = self._first_step(on_s)
        run = run_heated(self._trip, states_at(self._unheated, first), command_w, first=first,
                         before=self._unheated)
        return Schedule(
            on_s if command_w.any() else None, command_w, run.brake_power_w, run.soc,
            run.temperature_c, run.make_integrator,
            off_s if command_w.any() and off_s < self._trip.time_s[-1] else None, heat=run.heat)

    def until(self, off_s: float) -> Trial[Schedule]:
        """Return the Schedule that is switched off at an instant [s], with the energy it takes [Wh]."""
        on_s = self._switched_on_s(off_s)
        self._heated_s = off_s - on_s
        schedule = self.schedule(on_s, off_s)
        lacking_k = self._target_c - float(schedule.temperature_c[-1])
        taken_wh = keep_accounts(self._trip, schedule, deliverable=True).energy_wh.battery_total
        if lacking_k > ARRIVAL_TOLERANCE_K:
            taken_wh += LACKING_WH_PER_K * lacking_k
        return Trial(off_s, taken_wh, schedule)

    def _switched_on_s(self, off_s: float) -> float:
        """Return the instant [s] of switching on with which the battery arrives at the target."""
        def switched_on_at(on_s: float) -> Trial[None]:
            first = self._first_step(on_s)
            _, temperature_c, _, _ = roll_heated(
                self._trip, states_at(self._unheated, first),
                maximum_between(self._trip, on_s, off_s), first)
            return Trial(on_s, temperature_c[-1] - self._target_c, None)

        if off_s == 0.0:
            return 0.0
        first = switched_on_at(min(max(off_s - self._heated_s, 0.0), off_s))
        return follow_slope(0.0, off_s, first, self._slope_k_per_s(first.value), switched_on_at,
                            ARRIVAL_TOLERANCE_K, most_trials=MOST_RUNS).value

    def _slope_k_per_s(self, on_s: float) -> float:
        """Change of the arrival temperature with the instant of switching on [K/s], an estimate."""
        trip, step = self._trip, self._first_step(on_s)
        leaks_per_s = float(trip.leakage_w_per_k[step]) / self._capacity_j_per_k
        return (-trip.vehicle.hvch.efficiency * float(trip.heater_limit_w[step])
                / self._capacity_j_per_k * math.exp(-leaks_per_s * (float(trip.time_s[-1]) - on_s)))

    def _first_step(self, instant_s: float) -> int:
        return min(int(np.searchsorted(self._trip.time_s, instant_s, side='right')),
                   len(self._trip.route)) - 1


def paid_until(trip: Trip, off_s: float | None) -> FloatArray:
    """Return the most heater power [W] of each step (N,) that is worth paying for: until `off_s` [s]."""
    return maximum_between(trip, 0.0, float(trip.time_s[-1]) if off_s is None else off_s)
