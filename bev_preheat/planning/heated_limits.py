# SPDX-License-Identifier: Apache-2.0
"""
The forward run that keeps the battery's limits, for a vehicle with a heat path.

The counterpart of `limited_drive`, which is for heat that arrives at once. The power of a heater with lag cannot
be changed at once: its command is chosen so that the mean of the step keeps the limits at both ends. Heat under
way counts as arrived in comparisons with the battery's highest temperature.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import cast, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.both_ends import drive_to_end, Driven, warmth_beyond
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.heat_run import (
    ends_before_arrival_s,
    heat_to_come_k,
    heated_step_of_floats,
    make_heat_run,
    mean_share_left,
    States,
)
from bev_preheat.planning.schedule import Schedule
from bev_preheat.tunables import HIGHEST_TOLERANCE_K, LAGS_AHEAD, LASTING_LAGS
from bev_preheat.vehicle.model import (
    heat_with_brake_w,
    hottest_c,
    make_runge_kutta_4,
    make_terminal_limits,
    TerminalLimits,
)

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.trip import Trip
    from bev_preheat.planning.wanted_heat import WantedPower


# Command, friction brake, heater power, and heat into the battery, means of a step [W].
Powers = tuple[float, float, float, float]
# `drive(step, states)` -> states at its end, powers.
HeatedDrive = Callable[[int, States], tuple[States, Powers]]


def along_heated_limits(trip: Trip, states: FloatArray, powers_w: FloatArray, start_s: float | None,
                        empty_at_s: float | None, driven_share: FloatArray | None) -> Schedule:
    """Return the Schedule of such a run, heating from `start_s`; see `limits.along_limits`."""
    soc, temperature_c, heater_w, excess_k = states
    command_w, brake_w, drawn_w, arriving_w = powers_w
    return Schedule(
        start_s, command_w, brake_w, soc, temperature_c, make_runge_kutta_4,
        ends_before_arrival_s(trip, command_w), empty_at_s, driven_share,
        heat=make_heat_run(trip.vehicle.heat_path, heater_w, excess_k, drawn_w, arriving_w))


class _Foresight:
    """Looks ahead along one trip, with the limits of the battery's state now."""

    def __init__(self, trip: Trip, limits: TerminalLimits[float]) -> None:
        """Take a trip, and the terminal limits for floats."""
        self._limits, self._lag_s = limits, trip.vehicle.heat_path.heater_lag_s
        self._duration_s: list[float] = trip.route.duration_s.tolist()
        self._idle_power_w: list[float] = trip.idle_power_w.tolist()
        self._variance_w2: list[float] = trip.power_variance_w2.tolist()
        self._decay = [math.exp(-each_s / self._lag_s) for each_s in self._duration_s]
        self._mean_left: list[float] = mean_share_left(
            trip.vehicle.heat_path, trip.route.duration_s).tolist()
        ahead_s, starts_s = LAGS_AHEAD * self._lag_s, trip.time_s[:-1]
        self._before_climbs = frozenset(
            k for k in range(len(trip.route))
            if ((starts_s > trip.time_s[k]) & (starts_s < trip.time_s[k + 1] + ahead_s)).any())

    def _steps_after(self, k: int, duration_s: float) -> range:
        """Return the steps that begin within this duration after the end of step k."""
        last = k
        while last + 1 < len(self._duration_s) and duration_s > 0.0:
            last += 1
            duration_s -= self._duration_s[last]
        return range(k + 1, last + 1)

    def off_in_time_w(self, k: int, states: States) -> float:
        """Return the highest command [W] with which the heater, once switched off, leaves a climb its power."""
        if k not in self._before_climbs:
            return math.inf
        soc, temperature_c, heater_w, _ = states
        allowed_w = math.inf
        for j in reversed(self._steps_after(k, LAGS_AHEAD * self._lag_s)):
            # With a lag that is short compared with the step, nothing is left at its end.
            allowed_w = allowed_w / self._decay[j] if self._decay[j] > 0.0 else math.inf
            _, most_w = self._limits(soc, temperature_c, self._variance_w2[j])
            # A deficit that exists without any heating is not the heater's to fix.
            allowed_w = min(allowed_w, max(
                most_w - self._idle_power_w[j], 0.0) / self._mean_left[j])
        return (allowed_w - self._decay[k] * heater_w) / (1.0 - self._decay[k])

    def lasting_surplus_w(self, k: int, states: States) -> float:
        """Return the part of the surplus [W] that lasts: the heater's power after it is paid for."""
        soc, temperature_c, _, _ = states
        # Counted from the middle of the step: in a step that is long compared with the lag, its own surplus is
        # worth using whatever follows.
        ahead_s = LASTING_LAGS * self._lag_s - 0.5 * self._duration_s[k]
        steps = self._steps_after(k, ahead_s)
        if not steps:
            return math.inf
        if sum(self._duration_s[j] for j in steps) < ahead_s:
            # The rest would be drawn after arrival.
            return 0.0
        return max(0.0, min(self._limits(soc, temperature_c, self._variance_w2[j])[0]
                            - self._idle_power_w[j] for j in steps))


def drive_within_heated_limits(trip: Trip, wanted_w: WantedPower, take_surplus: bool) -> HeatedDrive:
    """Return `drive(k, states)`, which drives step k within the limits; see `limits`."""
    vehicle, path = trip.vehicle, trip.vehicle.heat_path
    step = heated_step_of_floats(vehicle, True)
    limits: TerminalLimits[float] = make_terminal_limits(vehicle, FLOATS)
    highest_c, most_c = vehicle.battery.temperature_range_c[1], hottest_c(vehicle)
    k_per_watt, share_of_excess = heat_to_come_k(vehicle)
    joules_per_k = (vehicle.battery.heat_capacity_j_per_k
                    + vehicle.heat_path.coolant_heat_capacity_j_per_k) / vehicle.hvch.efficiency
    columns = list(zip(*(column.tolist() for column in (
        trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w,
        trip.leakage_w_per_k, trip.heater_limit_w, trip.route.propulsion_power_w,
        mean_share_left(vehicle.heat_path, trip.route.duration_s)))))

    foresight = _Foresight(trip, limits) if path.heater_lag_s > 0.0 else None

    def drive(k: int, states: States) -> tuple[States, Powers]:
        (duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, cap_w, propulsion_w,
         left) = columns[k]
        may_overcharge = propulsion_w < 0.0
        soc, temperature_c, heater_w, excess_k = states

        def end_of(command_w: float, brake_w: float) -> tuple[float, ...]:
            ends: tuple[float, ...] = step(
                soc, temperature_c, heater_w, excess_k, duration_s, power_w + brake_w, variance_w2,
                heat_with_brake_w(vehicle, heat_w, brake_w), leakage_w_per_k, command_w)
            return ends

        def command_for(drawn_w: float) -> float:
            """Return the command for this mean power of the heater."""
            command_w: float = (drawn_w - left * heater_w) / (1.0 - left)
            return command_w

        settled_c = temperature_c + k_per_watt * heater_w + share_of_excess * excess_k
        if settled_c >= highest_c:
            asked_w = cap_w = 0.0
        else:
            asked_w = wanted_w(k, settled_c)

        def between(least_w: float, most_w: float) -> Driven:
            command_w = max(0.0, min(asked_w, command_for(most_w - power_w)))
            paid_w = command_w
            if may_overcharge and take_surplus:
                # As a steady command: a command that compensates the lag would swing from step to step.
                surplus_w = least_w - power_w
                if foresight is not None and surplus_w > 0.0:
                    surplus_w = min(surplus_w, foresight.lasting_surplus_w(k, states))
                free_w = min(cap_w, surplus_w)
                # If that is enough, no heat is paid for, whatever the caller.
                command_w, paid_w = (free_w, 0.0) if command_w <= free_w else (command_w, paid_w)
            if foresight is not None and command_w > 0.0:
                command_w = max(0.0, min(command_w, foresight.off_in_time_w(k, states)))
            while True:
                brake_w = 0.0
                if may_overcharge:
                    drawn_w = left * heater_w + (1.0 - left) * command_w
                    brake_w = min(max(0.0, least_w - power_w - drawn_w), -propulsion_w)
                ends = end_of(command_w, brake_w)
                settled_end_c = ends[1] + k_per_watt * ends[2] + share_of_excess * ends[3]
                least_command_w, beyond_k = warmth_beyond(
                    command_w, paid_w, settled_end_c, highest_c)
                if command_w <= 0.0 or beyond_k <= HIGHEST_TOLERANCE_K:
                    break
                command_w = max(least_command_w, command_w - beyond_k * joules_per_k / duration_s)
            if ends[0] > 1.0:
                # The brake takes power that would overfill the battery.
                brake_w = halve(max(0.0, -propulsion_w), brake_w,
                                lambda braked_w: end_of(command_w, braked_w)[0] <= 1.0)
                ends = end_of(command_w, brake_w)
            soc_end, end_c, heater_end_w, excess_end_k, _, _, drawn_w, arriving_w = ends
            return ((min(soc_end, 1.0), end_c, heater_end_w, excess_end_k),
                    (command_w, brake_w, drawn_w, arriving_w))

        ends, powers_w = drive_to_end(
            limits, (soc, temperature_c), variance_w2, most_c, power_w, propulsion_w,
            may_overcharge, between)
        return cast('States', ends), cast('Powers', powers_w)

    return drive


def stand_with_heat_path(trip: Trip, empty: int, states: FloatArray, powers_w: FloatArray) -> float:
    """
    Write the rest of a run whose charge runs out in step `empty`; return the driven share of that step.

    The step is driven until the battery is empty; from then on the vehicle stands, its heater is off,
    and its coolant goes on heating the battery. `powers_w` of that step are known.
    """
    step = heated_step_of_floats(trip.vehicle, True)
    heat_share = trip.vehicle.drivetrain.heat_share
    driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)
    command_w, brake_w, _, _ = powers_w[:, empty].tolist()

    def drive_step(k: int, start: States, share: float) -> tuple[float, ...]:
        driven = trip.driven(driven_share)
        soc, temperature_c, heater_w, excess_k = start
        ends: tuple[float, ...] = step(
            soc, temperature_c, share * heater_w, excess_k, float(trip.route.duration_s[k]),
            float(driven.idle_power_w[k]) + share * brake_w,
            float(driven.power_variance_w2[k]),
            float(driven.idle_heat_w[k]) - share * heat_share * brake_w,
            float(trip.leakage_w_per_k[k]), share * command_w)
        return ends

    here: States = tuple(states[:, empty].tolist())

    def carries(share: float) -> bool:
        driven_share[empty] = share
        return drive_step(empty, here, share)[0] > 0.0

    driven_share[empty] = halve(0.0, 1.0, carries)
    for k in range(empty, len(trip.route)):
        share = float(driven_share[k])
        ends = drive_step(k, here, share)
        here = 0.0, min(ends[1], hottest_c(trip.vehicle)), 0.0, ends[3]
        states[:, k + 1] = here
        powers_w[:, k] = share * command_w, share * brake_w, ends[6], ends[7]
    return float(driven_share[empty])
