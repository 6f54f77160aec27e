# SPDX-License-Identifier: Apache-2.0
"""
One heating interval for a vehicle with a heat path: switched on, and off before arrival.

Heat produced just before arrival is still in heater and coolant on arrival. So the cheapest schedule without
limits has two switching instants (docs/explanation/planning.md). For each switch-off instant there is one
switch-on instant with which the battery arrives at the target. The search finds the pair that takes the least
energy from the battery.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import FloatArray, JOULES_PER_WH
from bev_preheat.planning.bracketing import follow_slope, least_of, Trial
from bev_preheat.planning.dynamics import keep_accounts
from bev_preheat.planning.heat_run import along_states, heated_heat_capacity_j_per_k, roll_heated
from bev_preheat.tunables import (
    ARRIVAL_TOLERANCE_K,
    COMPARED_TOLERANCE_K,
    DEFICIT_WH_PER_K,
    MOST_LAGS,
    OFF_RESOLUTION_S,
    SURE_SHARE,
)

if TYPE_CHECKING:
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip


def maximum_between(trip: Trip, on_s: float, off_s: float) -> FloatArray:
    """Return the mean heater power [W] of each step (N,) at full power between two instants [s]."""
    share_on = np.minimum(trip.time_s[1:], off_s) - np.maximum(trip.time_s[:-1], on_s)
    return np.clip(share_on / trip.route.duration_s, 0.0, 1.0) * trip.heater_limit_w


def find_two_switches(trip: Trip, target_c: float, unheated: Schedule) -> Schedule:
    """Return the Schedule with one interval of full power that arrives at the target [deg C], or all the way."""
    if unheated.temperature_c[-1] >= target_c:
        return unheated
    search = _Search(trip, unheated, target_c)
    arrival_s = float(trip.time_s[-1])
    throughout = search.schedule(0.0, arrival_s)
    if throughout.temperature_c[-1] <= target_c:
        return throughout
    earliest_s = max(0.0, arrival_s - MOST_LAGS * trip.vehicle.heat_path.heat_lag_s)
    best = least_of(earliest_s, arrival_s, search.until, OFF_RESOLUTION_S)
    found = search.switched_on(best.value, best.outcome, ARRIVAL_TOLERANCE_K)
    return search.along(found.value, best.value, found.outcome)


def switched_off(trip: Trip, run: Schedule, on_s: float, off_s: float) -> Schedule:
    """Return the Schedule of a run that is heated between two instants [s]."""
    is_heated = bool(run.heater_power_w.any())
    ends_early = is_heated and off_s < float(trip.time_s[-1])
    return replace(run, heating_start_s=on_s if is_heated else None, heating_end_s=off_s if ends_early else None)


class _Search:
    """Schedules that heat from one instant to another, arriving at a target."""

    def __init__(self, trip: Trip, unheated: Schedule, target_c: float) -> None:
        assert unheated.heat is not None
        self._trip, self._unheated, self._target_c = trip, unheated, target_c
        # The States at each instant (4, N + 1) of the unheated run.
        self._idle = np.array((unheated.soc, unheated.temperature_c, unheated.heat.heater_power_w,
                               unheated.heat.coolant_excess_k))
        self._arrival_s = float(trip.time_s[-1])
        self._capacity_j_per_k = heated_heat_capacity_j_per_k(trip.vehicle)
        # Pairs of instants found so far, off and on: they give the start of the next search.
        self._found: list[tuple[float, float]] = []

    def schedule(self, on_s: float, off_s: float) -> Schedule:
        """Return the Schedule that heats between two instants [s]."""
        return self.along(on_s, off_s, self._roll(on_s, off_s))

    def until(self, off_s: float) -> Trial[float]:
        """Return the Trial of a switch-off instant [s]: energy [Wh], and the switch-on instant [s]."""
        found = self.switched_on(off_s, self._guess_s(off_s), COMPARED_TOLERANCE_K)
        on_s, above_k = found.value, found.excess
        self._found.append((off_s, on_s))
        schedule = self.along(on_s, off_s, found.outcome)
        taken_wh = keep_accounts(self._trip, schedule, deliverable=True).energy_wh.battery_total
        # A deficit would have to be made up for by heat from the first instant on; some of that heat leaks, or
        # stays in the coolant.
        allowed_k = min(COMPARED_TOLERANCE_K, ARRIVAL_TOLERANCE_K + SURE_SHARE * self._before_k(on_s))
        if above_k < -allowed_k:
            taken_wh -= DEFICIT_WH_PER_K * above_k
        elif (slope := self._slope_k_per_s(on_s)) < 0.0:
            heater_w = float(self._trip.heater_limit_w[self._trip.step_at(on_s)])
            taken_wh += above_k * heater_w / JOULES_PER_WH / slope
        return Trial(off_s, taken_wh, on_s)

    def switched_on(self, off_s: float, guess_s: float, tolerance_k: float) -> Trial[FloatArray]:
        """Return the Trial of the switch-on instant [s] with which the battery arrives at the target."""
        def switched_on_at(on_s: float) -> Trial[FloatArray]:
            states = self._roll(on_s, off_s)
            return Trial(on_s, float(states[1, -1]) - self._target_c, states)

        first = switched_on_at(min(max(guess_s, 0.0), off_s))
        return follow_slope(0.0, off_s, first, self._slope_k_per_s(first.value), switched_on_at,
                            tolerance_k)

    def _guess_s(self, off_s: float) -> float:
        """Return the approximate switch-on instant [s], on a line through the nearest pairs."""
        if len(self._found) < 2:
            deficit_k = self._target_c - float(self._unheated.temperature_c[-1])
            # Added up in order, as in the native core.
            mean_w = float((self._trip.heater_limit_w * self._trip.route.duration_s).cumsum()[-1]
                           ) / self._arrival_s
            return off_s - deficit_k * self._capacity_j_per_k / max(
                self._trip.vehicle.hvch.efficiency * mean_w, 1.0)
        (off_a_s, on_a_s), (off_b_s, on_b_s) = sorted(
            self._found, key=lambda pair: abs(pair[0] - off_s))[:2]
        return on_a_s + (on_b_s - on_a_s) * (off_s - off_a_s) / (off_b_s - off_a_s)

    def _roll(self, on_s: float, off_s: float) -> FloatArray:
        """Return the States from the step on in which the heater is switched on."""
        first = self._trip.step_at(on_s)
        return roll_heated(self._trip, tuple(self._idle[:, first].tolist()),
                           maximum_between(self._trip, on_s, off_s), first)

    def along(self, on_s: float, off_s: float, states: FloatArray) -> Schedule:
        """Return the Schedule of such States; before them the run is the unheated one."""
        whole = np.concatenate((self._idle[:, :self._trip.step_at(on_s)], states), axis=1)
        run = along_states(self._trip, whole, maximum_between(self._trip, on_s, off_s),
                           self._unheated.brake_power_w, None)
        return switched_off(self._trip, run, on_s, off_s)

    def _before_k(self, on_s: float) -> float:
        """Return how far full heating until an instant [s] warms battery and coolant [K] without leakage."""
        heat_j = self._trip.vehicle.hvch.efficiency * float(
            maximum_between(self._trip, 0.0, on_s) @ self._trip.route.duration_s)
        return heat_j / self._capacity_j_per_k

    def _slope_k_per_s(self, on_s: float) -> float:
        """Return the estimated change of the arrival temperature with the switch-on instant [K/s]."""
        trip, step = self._trip, self._trip.step_at(on_s)
        leaks_per_s = float(trip.leakage_w_per_k[step]) / self._capacity_j_per_k
        return (-trip.vehicle.hvch.efficiency * float(trip.heater_limit_w[step])
                / self._capacity_j_per_k * math.exp(-leaks_per_s * (self._arrival_s - on_s)))
