# SPDX-License-Identifier: Apache-2.0
"""
The battery's power limits (9i), and the forward run that keeps them.

Limits are on P_b; here they are converted to limits on the terminal power P_t, the sum of heater,
drivetrain and friction brake. They are kept at both ends of each step, as in the nonlinear program.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import runs as native_runs
from bev_preheat.native import searches as native_searches
from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.both_ends import drive_to_end, Driven, HIGHEST_TOLERANCE_K, warmth_beyond
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.dynamics import (
    hottest_c,
    limits_along,
    limits_of_steps_w,
    native_vehicle,
    step_of_floats,
)
from bev_preheat.planning.heat_run import States
from bev_preheat.planning.heated_limits import (
    along_heated_limits,
    drive_within_heated_limits,
    Powers,
    run_heated_within_limits,
)
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.planning.wanted_heat import LimitedSteps, WantedHeat, WantedPower
from bev_preheat.vehicle.heat_balance import heat_under_w, heat_with_heater_w
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.terminal_limits import make_terminal_limits, TerminalLimits

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.description import Vehicle

# A step is watched if a limit is this near: the run used for the choice may be warmer than the final run, by the
# drivetrain heat that the friction brake takes away.
COLDER_BY_K = 5.0

# `drive(step, soc, temperature_c)` -> state of charge, temperature, heater and brake power [W].
StepWithinLimits = Callable[[int, float, float], tuple[float, float, float, float]]
# `drive(step, states, wanted_w)` -> states at the end, powers; see `make_limited_drive`.
LimitedDrive = Callable[[int, States, float], tuple[States, Powers]]


def colder(vehicle: Vehicle, temperature_c: FloatArray) -> FloatArray:
    """Return temperatures COLDER_BY_K below these [deg C], but not below the vehicle's range."""
    return np.maximum(temperature_c - COLDER_BY_K, vehicle.battery.temperature_range_c[0])


def watch_limits(trip: Trip, soc: FloatArray, temperature_c: FloatArray) -> LimitedSteps:
    """Return the LimitedSteps of a trip, from a run (N + 1 values) not much warmer than any other."""
    least_w, most_w = limits_of_steps_w(
        trip.vehicle, soc, colder(trip.vehicle, temperature_c), trip.power_variance_w2)
    return LimitedSteps(
        charge=(trip.route.propulsion_power_w < 0.0) & (trip.idle_power_w < least_w),
        discharge=trip.idle_power_w + trip.heater_limit_w > most_w)


def limits_hold(trip: Trip, schedule: Schedule, before: int | None = None) -> bool:
    """
    Return whether a schedule made without regard to limits keeps them all.

    With `before`, only the steps before that one are checked; there must be at least one.
    """
    battery = trip.vehicle.battery
    lowest_c, highest_c = battery.temperature_range_c
    steps = len(trip.route) if before is None else before
    temperature_c, soc = schedule.temperature_c[:steps + 1], schedule.soc[:steps + 1]
    if (temperature_c.max() > highest_c or temperature_c.min() < lowest_c
            or soc.min() <= 0.0 or soc.max() > 1.0):
        return False
    terminal_w = (trip.idle_power_w + schedule.drawn_power_w)[:steps]
    least_w, most_w = (limits_w[:steps] for limits_w in limits_along(trip, schedule))
    return bool(((terminal_w >= least_w) & (terminal_w <= most_w)).all())


def run_within_limits(trip: Trip, state: BatteryState, watch: LimitedSteps,
                      wanted: WantedHeat, take_surplus: bool) -> Schedule:
    """
    Return the Schedule of a forward run that keeps the limits.

    `wanted` is the WantedHeat, cut if the battery cannot deliver it or would exceed its highest temperature. With
    `take_surplus`, regeneration that the battery cannot accept goes to the heater first, up to BELOW_HIGHEST_K
    below that temperature; the friction brake takes the rest.

    The state of charge stays within 0 ... 1: the friction brake takes power that would overfill the battery, and
    when the charge runs out the vehicle stands for the rest of the trip.
    """
    if not trip.vehicle.heat_path.is_direct:
        return along_limits(trip, watch, *run_heated_within_limits(trip, state, watch, wanted, take_surplus))
    steps = len(trip.route)
    states, powers_w = np.empty((2, steps + 1)), np.empty((2, steps))
    states[:, 0] = state.soc, state.temperature_c
    empty = _drive(trip, watch, wanted, take_surplus, states, powers_w)
    stranded = None if empty is None else (empty, _strand(trip, empty, states, powers_w))
    return along_limits(trip, watch, states, powers_w, stranded)


def along_limits(trip: Trip, watch: LimitedSteps, states: FloatArray, powers_w: FloatArray,
                 stranded: tuple[int, float] | None) -> Schedule:
    """
    Return the Schedule of a run that has kept the limits in its LimitedSteps.

    `states` (2, N + 1) are charge and temperature, `powers_w` (2, N) heater and friction brake; with a heat
    path they are those of `heated_limits`. `stranded` is the step in which the charge runs out and the
    share that is driven, or None.
    """
    empty_at_s, driven_share = where_stranded(trip, stranded)
    start_s = switched_on_s(trip, powers_w[0])
    if start_s is not None:
        # A step that is heated in part because of a limit is heated evenly, from its beginning.
        on = int(np.searchsorted(trip.time_s, start_s, side='right')) - 1
        if watch.charge[on] or watch.discharge[on]:
            start_s = float(trip.time_s[on])
    if not trip.vehicle.heat_path.is_direct:
        return along_heated_limits(trip, states, powers_w, start_s, empty_at_s, driven_share)
    (soc, temperature_c), (heater_power_w, brake_power_w) = states, powers_w
    return Schedule(start_s, heater_power_w, brake_power_w, soc, temperature_c, make_runge_kutta_4,
                    empty_at_s=empty_at_s, driven_share=driven_share)


def where_stranded(trip: Trip,
                   stranded: tuple[int, float] | None) -> tuple[float | None, FloatArray | None]:
    """Return `empty_at_s` and `driven_share` of a Schedule; `stranded` as in `along_limits`."""
    if stranded is None:
        return None, None
    empty, share = stranded
    driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)
    driven_share[empty] = share
    return float(trip.time_s[empty] + share * trip.route.duration_s[empty]), driven_share


def _drive(trip: Trip, watch: LimitedSteps, wanted: WantedHeat, take_surplus: bool, states: FloatArray,
           powers_w: FloatArray) -> int | None:
    """
    Drive within the limits; return the step in which the charge runs out, or None.

    Writes the states (2, N + 1) after the start, and the powers of heater and brake (2, N), until the charge runs
    out.
    """
    vehicle = native_vehicle(trip.vehicle)
    driven = None if vehicle is None else native_runs.run_within_limits(
        vehicle, trip.native, native_runs.Heating(
            wanted.power_w, wanted.below_c, watch.charge, watch.discharge, take_surplus),
        0, states, powers_w)
    if driven is not None:
        return driven[0]
    drive = _step_within_limits(trip, watch, wanted.at_temperature(), take_surplus)
    most_c = hottest_c(trip.vehicle)
    soc, temperature_c = states[:, 0].tolist()
    for k in range(len(trip.route)):
        soc, end_c, powers_w[0, k], powers_w[1, k] = drive(k, soc, temperature_c)
        if soc <= 0.0:
            return k
        temperature_c = min(end_c, most_c)
        states[:, k + 1] = soc, temperature_c
    return None


def _step_within_limits(trip: Trip, watch: LimitedSteps, wanted_w: WantedPower,
                        take_surplus: bool) -> StepWithinLimits:
    """
    Return `drive(k, soc, temperature_c)`, which drives step k from that state within the limits.

    It returns the state of charge and the temperature at the end of the step, and the powers [W] of
    heater and friction brake. A state of charge of 0 or less means that the charge runs out in the
    step. The arguments are those of `run_within_limits`.
    """
    vehicle = trip.vehicle
    step = step_of_floats(vehicle, make_runge_kutta_4, saturating=True)
    limits: TerminalLimits[float] = make_terminal_limits(vehicle, FLOATS)
    highest_c, most_c = vehicle.battery.temperature_range_c[1], hottest_c(vehicle)
    joules_per_k = vehicle.battery.heat_capacity_j_per_k / vehicle.hvch.efficiency
    columns = list(zip(*(column.tolist() for column in (
        trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w,
        trip.leakage_w_per_k, trip.heater_limit_w, trip.route.propulsion_power_w, watch.charge,
        watch.discharge))))

    def drive(k: int, soc: float, temperature_c: float) -> tuple[float, float, float, float]:
        (duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, cap_w, propulsion_w,
         may_overcharge, may_overdraw) = columns[k]
        is_watched = may_overcharge or may_overdraw
        if temperature_c >= highest_c:
            asked_w = cap_w = 0.0
        else:
            asked_w = wanted_w(k, temperature_c)

        def end_of(heater_w: float, brake_w: float) -> tuple[float, ...]:
            return step(
                soc, temperature_c, duration_s, power_w + heater_w + brake_w, variance_w2,
                heat_under_w(vehicle, heat_w, heater_w, brake_w), leakage_w_per_k)

        def between(least_w: float, most_w: float) -> Driven:
            heater_w = asked_w
            if is_watched:
                heater_w = max(0.0, min(heater_w, most_w - power_w))
            paid_w = heater_w
            if may_overcharge and take_surplus:
                free_w = min(cap_w, least_w - power_w)
                if heater_w <= free_w:
                    # Surplus covers the demand: no heat is paid for, whatever the caller.
                    heater_w, paid_w = free_w, 0.0
            while True:
                brake_w = 0.0
                if may_overcharge:
                    brake_w = min(max(0.0, least_w - power_w - heater_w), -propulsion_w)
                soc_end, end_c, _, _ = end_of(heater_w, brake_w)
                least_heat_w, beyond_k = warmth_beyond(heater_w, paid_w, end_c, highest_c)
                if heater_w <= 0.0 or beyond_k <= HIGHEST_TOLERANCE_K:
                    break
                heater_w = max(least_heat_w, heater_w - beyond_k * joules_per_k / duration_s)
            if soc_end > 1.0:
                # The brake takes power that would overfill the battery.
                brake_w = halve(max(0.0, -propulsion_w), brake_w,
                                lambda braked_w: end_of(heater_w, braked_w)[0] <= 1.0)
                soc_end, end_c, _, _ = end_of(heater_w, brake_w)
                soc_end = min(soc_end, 1.0)
            return (soc_end, end_c), (heater_w, brake_w)

        if is_watched:
            (soc_end, end_c), (heater_w, brake_w) = drive_to_end(
                limits, (soc, temperature_c), variance_w2, most_c, power_w, propulsion_w,
                may_overcharge, between)
        else:
            (soc_end, end_c), (heater_w, brake_w) = between(-math.inf, math.inf)
        return soc_end, end_c, heater_w, brake_w

    return drive


def make_limited_drive(trip: Trip, take_surplus: bool) -> LimitedDrive:
    """
    Return `drive(k, states, wanted_w)` -> states at the end of step k, powers [W].

    States are charge, temperature [deg C], heater power [W] and coolant excess [K]; powers are command, friction
    brake, heater power and heat into the battery. A state of charge of 0 or less: it runs out in the step.
    """
    asked_w, watch, most_c = [0.0], watch_everywhere(trip), hottest_c(trip.vehicle)
    if not trip.vehicle.heat_path.is_direct:
        drive_heated = drive_within_heated_limits(trip, watch, lambda k, settled_c: asked_w[0], take_surplus)

        def drive_with_heat_path(k: int, states: States, wanted_w: float) -> tuple[States, Powers]:
            asked_w[0] = wanted_w
            (soc, end_c, heater_w, excess_k), powers_w = drive_heated(k, states)
            return (soc, min(end_c, most_c), heater_w, excess_k), powers_w

        return drive_with_heat_path
    step = _step_within_limits(trip, watch, lambda k, temperature_c: asked_w[0], take_surplus)

    def drive(k: int, states: States, wanted_w: float) -> tuple[States, Powers]:
        asked_w[0] = wanted_w
        soc, end_c, heater_w, brake_w = step(k, states[0], states[1])
        return ((soc, min(end_c, most_c), 0.0, 0.0),
                (heater_w, brake_w, heater_w, heat_with_heater_w(trip.vehicle, 0.0, heater_w)))

    return drive


def _strand(trip: Trip, empty: int, states: FloatArray, powers_w: FloatArray) -> float:
    """
    Write the rest of a run whose charge runs out in step `empty`; return the driven share of that step.

    The step is driven until the battery is empty; from then on the vehicle stands. The powers of that
    step are known.
    """
    vehicle, native = trip.vehicle, native_vehicle(trip.vehicle)
    share = None if native is None else native_searches.stand(
        native, trip.native, empty, states, powers_w)
    if share is not None:
        return share
    start: tuple[float, float] = tuple(states[:, empty].tolist())
    heater_w, brake_w = powers_w[:, empty].tolist()
    step = step_of_floats(vehicle, make_runge_kutta_4, saturating=True)
    temperatures_c: list[float] = []
    driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)

    def drive_step(driven: Trip, k: int, state: tuple[float, float]) -> tuple[float, ...]:
        share = driven_share[k]
        return step(
            *state, float(trip.route.duration_s[k]),
            float(driven.idle_power_w[k]) + share * (heater_w + brake_w),
            float(driven.power_variance_w2[k]),
            float(driven.idle_heat_w[k]) + share * heat_under_w(vehicle, 0.0, heater_w, brake_w),
            float(trip.leakage_w_per_k[k]))

    def carries(share: float) -> bool:
        driven_share[empty] = share
        return drive_step(trip.driven(driven_share), empty, start)[0] > 0.0

    driven_share[empty] = halve(0.0, 1.0, carries)
    state, driven = start, trip.driven(driven_share)
    for k in range(empty, len(trip.route)):
        end_c = drive_step(driven, k, state)[1]
        state = 0.0, min(end_c, hottest_c(vehicle))
        temperatures_c.append(state[1])
    states[:, empty + 1:] = np.zeros(len(temperatures_c)), temperatures_c
    powers_w[:, empty:] = heater_w * driven_share[empty:], brake_w * driven_share[empty:]
    return float(driven_share[empty])


def run_unheated(trip: Trip, state: BatteryState) -> Schedule:
    """Return the Schedule of a forward run that keeps the limits, heated with free surplus only."""
    return run_within_limits(trip, state, watch_everywhere(trip),
                             WantedHeat(np.zeros(len(trip.route))), take_surplus=True)


def drive_as_planned(trip: Trip, state: BatteryState, heater_power_w: FloatArray,
                     take_surplus: bool = False) -> Schedule:
    """Return the Schedule of a forward run that keeps the limits under heater powers [W] (N,)."""
    return run_within_limits(trip, state, watch_everywhere(trip), WantedHeat(heater_power_w), take_surplus)


def watch_everywhere(trip: Trip) -> LimitedSteps:
    """Return the LimitedSteps under which a limit may matter in each step of a trip."""
    return LimitedSteps(trip.route.propulsion_power_w < 0.0, np.ones(len(trip.route), dtype=bool))
