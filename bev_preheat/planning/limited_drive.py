# SPDX-License-Identifier: Apache-2.0
"""
The forward run that keeps the battery's power limits (9i): the Python engine's.

Limits are on P_b; here they are converted to limits on the terminal power P_t, the sum of heater, drivetrain and
friction brake. They are kept at both ends of each step, as in the nonlinear program: power is constant over a
step, but charge, temperature and with them the limits change. On a climb the discharge limit falls with the
charge, and on a descent a fuller battery accepts less. The limits at the end depend slightly on the power. If
the power allowed at the start exceeds them, the heater gives way, or heater and friction brake take more, until
they hold. The power of a heater with lag cannot be changed at once: its command is chosen so that the mean of
the step keeps the limits. Heat under way counts as arrived in comparisons with the battery's highest
temperature.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import reduce
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import AnyNumber, Arithmetic, FloatArray, FLOATS
from bev_preheat.planning.bracketing import follow_slope, halve, Trial
from bev_preheat.planning.heat_run import (
    heat_to_come_k,
    heated_heat_capacity_j_per_k,
    heated_step_of_floats,
    initial_states,
    mean_share_left,
    States,
)
from bev_preheat.tunables import BELOW_HIGHEST_K, END_TOLERANCE_W, HIGHEST_TOLERANCE_K, LAGS_AHEAD, LASTING_LAGS
from bev_preheat.vehicle.model import heat_with_brake_w, hottest_c, make_terminal_limits, TerminalLimits

if TYPE_CHECKING:
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip

# Command, friction brake, electrical power of the heat sources, and heat into the battery, means of a step [W].
Powers = tuple[float, float, float, float]
# States at the end of a step, and its powers.
Driven = tuple[States, Powers]
# `drive(step, states, wanted_w, below_c)`; see `make_limited_drive`.
LimitedDrive = Callable[..., Driven]
# `drive(least_w, most_w)` -> outcome of the step between two terminal powers [W].
DriveBetween = Callable[[float, float], Driven]


class Course(NamedTuple):
    """
    A run within limits: `states` (S, N + 1) and `powers_w` (P, N) [W].

    Charge and temperature, command and friction brake; with a heat path, or several heat sources, all four States,
    and Powers. `stranded`: the step in which the charge runs out and its driven share, or None.
    """

    states: FloatArray
    powers_w: FloatArray
    stranded: tuple[int, float] | None


def drive_within_limits(trip: Trip, state: BatteryState, wanted_w: FloatArray, take_surplus: bool,
                        below_c: float) -> Course:
    """Return the Course of a forward run that keeps the limits; see `limits.drive_as_planned`."""
    rows, steps = 2 if trip.vehicle.heat_path.is_direct and trip.mix.is_alone else 4, len(trip.route)
    states, powers_w, stranded = np.empty((4, steps + 1)), np.empty((4, steps)), None
    states[:, 0] = here = initial_states(state)
    drive = make_limited_drive(trip, take_surplus)
    for k, power_w in enumerate(wanted_w.tolist()):
        here, powers_w[:, k] = drive(k, here, power_w, below_c)
        if here[0] <= 0.0:
            stranded = k, _stand(trip, k, states, powers_w)
            break
        states[:, k + 1] = here
    return Course(states[:rows], powers_w[:rows], stranded)


def make_limited_drive(trip: Trip, take_surplus: bool) -> LimitedDrive:
    """
    Return `drive(k, states, wanted_w, below_c)`, which drives step k of a Trip within the limits.

    It wants `wanted_w` [W] if the battery is colder than `below_c` [deg C] (default: in any case); arguments are
    otherwise those of `limits.drive_as_planned`. It returns the States at the end, and the Powers. A state of
    charge of 0 or less means that the charge runs out in the step.
    """
    vehicle, path = trip.vehicle, trip.vehicle.heat_path
    step = heated_step_of_floats(vehicle, True)
    limits: TerminalLimits[float] = make_terminal_limits(vehicle, FLOATS)
    highest_c, most_c = vehicle.battery.temperature_range_c[1], hottest_c(vehicle)
    k_per_watt, share_of_excess = heat_to_come_k(vehicle)
    joules_per_k = heated_heat_capacity_j_per_k(vehicle) / vehicle.hvch.efficiency
    columns = list(zip(*(column.tolist() for column in (
        trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w,
        trip.leakage_w_per_k, trip.heater_limit_w, trip.route.propulsion_power_w,
        mean_share_left(path, trip.route.duration_s)))))
    foresight = Foresight(trip, FLOATS) if path.heater_lag_s > 0.0 else None

    def drive(k: int, states: States, wanted_w: float, below_c: float = math.inf) -> Driven:
        duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, cap_w, propulsion_w, left = columns[k]
        may_overcharge = propulsion_w < 0.0
        soc, temperature_c, heater_w, excess_k = states
        merit = trip.mix.at(k, temperature_c)

        def drawn_under_w(command_w: float) -> float:
            drawn_w: float = merit.electric_w(left * heater_w + (1.0 - left) * command_w)
            return drawn_w

        def end_of(command_w: float, brake_w: float) -> tuple[float, ...]:
            other_w = 0.0 if merit.is_alone else drawn_under_w(command_w) - command_w
            ends: tuple[float, ...] = step(
                soc, temperature_c, heater_w, excess_k, duration_s, power_w + brake_w + other_w, variance_w2,
                heat_with_brake_w(vehicle, heat_w, brake_w), leakage_w_per_k, command_w)
            return ends

        settled_c = temperature_c + k_per_watt * heater_w + share_of_excess * excess_k
        warmest_c = max(settled_c, temperature_c + excess_k) if path.is_shell else settled_c
        may_heat = settled_c < below_c and warmest_c < highest_c
        asked_w = merit.capped_w(wanted_w) if may_heat or wanted_w < 0.0 else 0.0
        cap_w = merit.capped_w(cap_w)
        if warmest_c >= highest_c:
            cap_w = 0.0

        def between(least_w: float, most_w: float) -> Driven:
            # The command whose mean over the step is the most power.
            command_w = max(0.0, min(asked_w, (
                merit.heat_w(most_w - power_w) - left * heater_w) / (1.0 - left)))
            if asked_w < 0.0:
                command_w = max(asked_w, merit.cold_w(most_w - power_w))
            paid_w = command_w
            if may_overcharge and take_surplus and asked_w >= 0.0:
                # As a steady command: a command that compensates the lag would swing from step to step.
                surplus_w = merit.heat_w(least_w - power_w)
                if foresight is not None and surplus_w > 0.0:
                    surplus_w = min(surplus_w, foresight.lasting_surplus_w(k, soc, temperature_c))
                free_w = min(cap_w, surplus_w)
                # If that is enough, no heat is paid for, whatever the caller.
                command_w, paid_w = (free_w, 0.0) if command_w <= free_w else (command_w, paid_w)
            if foresight is not None and command_w > 0.0:
                command_w = max(0.0, min(
                    command_w, foresight.off_in_time_w(k, soc, temperature_c, heater_w)))
            while True:
                brake_w = 0.0
                if may_overcharge:
                    brake_w = min(max(0.0, least_w - power_w - drawn_under_w(command_w)), -propulsion_w)
                ends = end_of(command_w, brake_w)
                # Paid heat ends at the highest temperature; surplus goes to the brake from BELOW_HIGHEST_K below.
                least_command_w, end_c = (paid_w, highest_c - BELOW_HIGHEST_K) if command_w > paid_w else (
                    0.0, highest_c)
                warmest_end_c = ends[1] + k_per_watt * ends[2] + share_of_excess * ends[3]
                if path.is_shell:
                    warmest_end_c = max(warmest_end_c, ends[1] + ends[3])
                beyond_k = warmest_end_c - end_c
                if command_w <= 0.0 or beyond_k <= HIGHEST_TOLERANCE_K:
                    break
                command_w = max(least_command_w, command_w - beyond_k * joules_per_k / duration_s)
            if ends[0] > 1.0:
                # The brake takes power that would overfill the battery.
                brake_w = halve(max(0.0, -propulsion_w), brake_w,
                                lambda braked_w: end_of(command_w, braked_w)[0] <= 1.0)
                ends = end_of(command_w, brake_w)
            return ((min(ends[0], 1.0), ends[1], ends[2], ends[3]), (
                command_w, brake_w, ends[6] if merit.is_alone else drawn_under_w(command_w), ends[7]))

        (soc_end, end_c, *under_way), powers_w = _drive_to_end(
            limits, (soc, temperature_c), variance_w2, most_c, power_w, propulsion_w, between)
        return (soc_end, min(end_c, most_c), *under_way), powers_w  # type: ignore[return-value]
    return drive


def _drive_to_end(limits: TerminalLimits[float], state: tuple[float, float], variance_w2: float, most_c: float,
                  idle_w: float, propulsion_w: float, drive: DriveBetween) -> Driven:
    """
    Return the outcome of a step that keeps the limits at both ends, as far as heater and brake can.

    `state` is charge and temperature [deg C] at the start, `variance_w2` the variance of the step's power,
    `idle_w` its terminal power without heater and brake, including the propulsion power `propulsion_w`. If driving
    alone exceeds the discharge limit at the end, the heater gets nothing, as at the start.
    """
    least_w, most_w = limits(*state, variance_w2)

    def spare_at_end_w(driven: Driven) -> tuple[float, float]:
        """Return how far the terminal power lies above the least power at the end, and below the most [W]."""
        (soc, temperature_c, *_), (_, brake_w, drawn_w, _) = driven
        least_end_w, most_end_w = limits(min(soc, 1.0), min(temperature_c, most_c), variance_w2)
        power_w = idle_w + drawn_w + brake_w
        return power_w - least_end_w, most_end_w - power_w

    driven = drive(least_w, most_w)
    if driven[0][0] <= 0.0:
        # The charge runs out in this step.
        return driven
    command_w, brake_w, drawn_w, _ = driven[1]
    above_least_w, below_most_w = spare_at_end_w(driven)
    is_too_much = below_most_w < 0.0 and command_w != 0.0
    if not is_too_much and not (propulsion_w < 0.0 and above_least_w < 0.0 and brake_w < -propulsion_w):
        return driven
    # The terminal power is moved until the limit holds: towards no heat, or towards braking alone.
    utmost_w, slope = (idle_w, -1.0) if is_too_much else (idle_w - propulsion_w, 1.0)

    def moved_to(power_w: float, driven: Driven) -> Trial[Driven]:
        above_least_w, below_most_w = spare_at_end_w(driven)
        spare_w = below_most_w if is_too_much else above_least_w
        return Trial(power_w, spare_w - 0.5 * END_TOLERANCE_W, driven)

    def attempt(power_w: float) -> Trial[Driven]:
        return moved_to(power_w, drive(least_w, power_w) if is_too_much else drive(power_w, most_w))

    first = moved_to(idle_w + drawn_w + brake_w, driven)
    trial = follow_slope(utmost_w, first.value, first, slope, attempt, 0.5 * END_TOLERANCE_W)
    if trial.excess < -0.5 * END_TOLERANCE_W and trial.value != utmost_w:
        # In a long step less heat may lower the limit by more than it saves: then nothing keeps the limit.
        trial = attempt(utmost_w)
    return trial.outcome


class Foresight:
    """Looks ahead along a trip whose heater has a lag, with the limits of the battery's state now."""

    def __init__(self, trip: Trip, arithmetic: Arithmetic[AnyNumber]) -> None:
        """Take a trip, and the kind of number of the states: floats or arrays."""
        self._limits = make_terminal_limits(trip.vehicle, arithmetic)
        self._minimum, self._maximum = arithmetic.minimum, arithmetic.maximum
        self._lag_s = trip.vehicle.heat_path.heater_lag_s
        self._duration_s: list[float] = trip.route.duration_s.tolist()
        self._idle_power_w: list[float] = trip.idle_power_w.tolist()
        self._variance_w2: list[float] = trip.power_variance_w2.tolist()
        self._decay = [math.exp(-each_s / self._lag_s) for each_s in self._duration_s]
        self._mean_left: list[float] = mean_share_left(
            trip.vehicle.heat_path, trip.route.duration_s).tolist()

    def _steps_after(self, k: int, duration_s: float) -> range:
        """Return the steps that begin within this duration after the end of step k."""
        last = k
        while last + 1 < len(self._duration_s) and duration_s > 0.0:
            last += 1
            duration_s -= self._duration_s[last]
        return range(k + 1, last + 1)

    def off_in_time_w(self, k: int, soc: AnyNumber, temperature_c: AnyNumber, heater_w: float) -> AnyNumber:
        """Return the highest command [W] with which the heater, once switched off, leaves a climb its power."""
        allowed_w: AnyNumber = math.inf
        for j in reversed(self._steps_after(k, LAGS_AHEAD * self._lag_s)):
            # With a lag that is short compared with the step, nothing is left at its end.
            allowed_w = allowed_w / self._decay[j] if self._decay[j] > 0.0 else math.inf
            _, most_w = self._limits(soc, temperature_c, self._variance_w2[j])
            # A deficit that exists without any heating is not the heater's to fix.
            allowed_w = self._minimum(
                allowed_w, self._maximum(most_w - self._idle_power_w[j], 0.0) / self._mean_left[j])
        return (allowed_w - self._decay[k] * heater_w) / (1.0 - self._decay[k])

    def lasting_surplus_w(self, k: int, soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
        """Return the part of the surplus [W] that lasts: the heater's power after it is paid for."""
        # Counted from the middle of the step: in a step that is long compared with the lag, its own surplus is
        # worth using whatever follows.
        ahead_s = LASTING_LAGS * self._lag_s - 0.5 * self._duration_s[k]
        steps = self._steps_after(k, ahead_s)
        if not steps:
            return math.inf
        if sum(self._duration_s[j] for j in steps) < ahead_s:
            # The rest would be drawn after arrival.
            return 0.0
        least_w = reduce(self._minimum, (
            self._limits(soc, temperature_c, self._variance_w2[j])[0] - self._idle_power_w[j] for j in steps))
        return self._maximum(least_w, 0.0)


def _stand(trip: Trip, empty: int, states: FloatArray, powers_w: FloatArray) -> float:
    """Write the rest of a run that stands without charge from within step `empty` on; return its driven share."""
    step = heated_step_of_floats(trip.vehicle, True)
    driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)
    command_w, brake_w, drawn_w, _ = powers_w[:, empty].tolist()
    # Of heat sources that draw another power than the HVCH for the same heat.
    other_w = 0.0 if trip.mix.is_alone else drawn_w - command_w

    def drive_step(driven: Trip, k: int, start: States) -> tuple[float, ...]:
        soc, temperature_c, heater_w, excess_k = start
        share = float(driven_share[k])
        ends: tuple[float, ...] = step(
            soc, temperature_c, share * heater_w, excess_k, float(trip.route.duration_s[k]),
            float(driven.idle_power_w[k]) + share * (brake_w + other_w), float(driven.power_variance_w2[k]),
            heat_with_brake_w(trip.vehicle, float(driven.idle_heat_w[k]), share * brake_w),
            float(trip.leakage_w_per_k[k]), share * command_w)
        return ends
    here: States = tuple(states[:, empty].tolist())

    def carries(share: float) -> bool:
        driven_share[empty] = share
        return drive_step(trip.driven(driven_share), empty, here)[0] > 0.0
    driven_share[empty] = halve(0.0, 1.0, carries)
    driven = trip.driven(driven_share)
    for k in range(empty, len(trip.route)):
        ends = drive_step(driven, k, here)
        here = 0.0, min(ends[1], hottest_c(trip.vehicle)), 0.0, ends[3]
        states[:, k + 1] = here
        powers_w[:, k] = driven_share[k] * command_w, driven_share[k] * brake_w, ends[6] + driven_share[
            k] * other_w, ends[7]
    return float(driven_share[empty])
