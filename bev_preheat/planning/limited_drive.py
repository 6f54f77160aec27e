# SPDX-License-Identifier: Apache-2.0
"""
The forward run that keeps the battery's power limits (9i): the Python engine's.

Limits are on P_b; here they are converted to limits on the terminal power P_t, the sum of heater,
drivetrain and friction brake. They are kept at both ends of each step, as in the nonlinear program.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.both_ends import drive_to_end, Driven, warmth_beyond
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.dynamics import step_of_floats
from bev_preheat.planning.heat_run import initial_states
from bev_preheat.planning.heated_limits import drive_within_heated_limits, stand_with_heat_path
from bev_preheat.tunables import HIGHEST_TOLERANCE_K
from bev_preheat.vehicle.model import (
    heat_under_w,
    heat_with_heater_w,
    hottest_c,
    make_runge_kutta_4,
    make_terminal_limits,
    TerminalLimits,
)

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.heated_limits import Powers
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.planning.wanted_heat import WantedHeat, WantedPower

# `drive(step, soc, temperature_c)` -> state of charge, temperature, heater and brake power [W].
StepWithinLimits = Callable[[int, float, float], tuple[float, float, float, float]]

# `drive(step, states)` -> states at its end, powers [W].
AnyDrive = Callable[[int, tuple[float, ...]], Driven]
# `drive(step, states, wanted_w)` -> states at the end, powers; see `make_limited_drive`.
LimitedDrive = Callable[[int, 'States', float], tuple['States', 'Powers']]


class Course(NamedTuple):
    """
    A run within limits: `states` (S, N + 1) and `powers_w` (P, N) [W].

    Charge and temperature, heater and friction brake; with a heat path all four States, and Powers. `stranded`:
    the step in which the charge runs out and its driven share, or None.
    """

    states: FloatArray
    powers_w: FloatArray
    stranded: tuple[int, float] | None


def drive_within_limits(trip: Trip, state: BatteryState, wanted: WantedHeat, take_surplus: bool) -> Course:
    """
    Return the Course of a forward run that keeps the limits; see `limits.run_within_limits`.

    With a heat path, `wanted` is evaluated at the temperature that the battery will have when all heat under way
    has arrived.
    """
    is_direct, steps, most_c = trip.vehicle.heat_path.is_direct, len(trip.route), hottest_c(trip.vehicle)
    rows = 2 if is_direct else 4
    states, powers_w = np.empty((rows, steps + 1)), np.empty((rows, steps))
    states[:, 0] = initial_states(state)[:rows]
    make_drive = _drive_of_two if is_direct else drive_within_heated_limits
    drive = make_drive(trip, wanted.at_temperature(), take_surplus)
    for k in range(steps):
        ends, powers = drive(k, tuple(states[:, k].tolist()))
        powers_w[:, k] = powers
        if ends[0] <= 0.0:
            stand = _stand if is_direct else stand_with_heat_path
            return Course(states, powers_w, (k, stand(trip, k, states, powers_w)))
        states[:, k + 1] = ends[0], min(ends[1], most_c), *ends[2:]
    return Course(states, powers_w, None)


def _drive_of_two(trip: Trip, wanted_w: WantedPower, take_surplus: bool) -> AnyDrive:
    """Return `drive(k, states)` -> states and powers, of two each, at the end of step k."""
    step = _step_within_limits(trip, wanted_w, take_surplus)

    def drive(k: int, states: tuple[float, ...]) -> Driven:
        soc, end_c, heater_w, brake_w = step(k, states[0], states[1])
        return (soc, end_c), (heater_w, brake_w)

    return drive


def _step_within_limits(trip: Trip, wanted_w: WantedPower, take_surplus: bool) -> StepWithinLimits:
    """
    Return `drive(k, soc, temperature_c)`, which drives step k from that state within the limits.

    It returns the state of charge and the temperature at the end of the step, and the powers [W] of
    heater and friction brake. A state of charge of 0 or less means that the charge runs out in the
    step. The arguments are those of `drive_within_limits`.
    """
    vehicle = trip.vehicle
    step = step_of_floats(vehicle, make_runge_kutta_4, saturating=True)
    limits: TerminalLimits[float] = make_terminal_limits(vehicle, FLOATS)
    highest_c, most_c = vehicle.battery.temperature_range_c[1], hottest_c(vehicle)
    joules_per_k = vehicle.battery.heat_capacity_j_per_k / vehicle.hvch.efficiency
    columns = list(zip(*(column.tolist() for column in (
        trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w,
        trip.leakage_w_per_k, trip.heater_limit_w, trip.route.propulsion_power_w))))

    def drive(k: int, soc: float, temperature_c: float) -> tuple[float, float, float, float]:
        duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, cap_w, propulsion_w = columns[k]
        may_overcharge = propulsion_w < 0.0
        if temperature_c >= highest_c:
            asked_w = cap_w = 0.0
        else:
            asked_w = wanted_w(k, temperature_c)

        def end_of(heater_w: float, brake_w: float) -> tuple[float, ...]:
            return step(
                soc, temperature_c, duration_s, power_w + heater_w + brake_w, variance_w2,
                heat_under_w(vehicle, heat_w, heater_w, brake_w), leakage_w_per_k)

        def between(least_w: float, most_w: float) -> Driven:
            heater_w = max(0.0, min(asked_w, most_w - power_w))
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

        (soc_end, end_c), (heater_w, brake_w) = drive_to_end(
            limits, (soc, temperature_c), variance_w2, most_c, power_w, propulsion_w,
            may_overcharge, between)
        return soc_end, end_c, heater_w, brake_w

    return drive


def make_limited_drive(trip: Trip, take_surplus: bool) -> LimitedDrive:
    """
    Return `drive(k, states, wanted_w)` -> states at the end of step k, powers [W].

    States are charge, temperature [deg C], heater power [W] and coolant excess [K]; powers are command, friction
    brake, heater power and heat into the battery. A state of charge of 0 or less: it runs out in the step.
    """
    asked_w, most_c = [0.0], hottest_c(trip.vehicle)
    if not trip.vehicle.heat_path.is_direct:
        drive_heated = drive_within_heated_limits(trip, lambda k, settled_c: asked_w[0], take_surplus)

        def drive_with_heat_path(k: int, states: States, wanted_w: float) -> tuple[States, Powers]:
            asked_w[0] = wanted_w
            (soc, end_c, heater_w, excess_k), powers_w = drive_heated(k, states)
            return (soc, min(end_c, most_c), heater_w, excess_k), powers_w

        return drive_with_heat_path
    step = _step_within_limits(trip, lambda k, temperature_c: asked_w[0], take_surplus)

    def drive(k: int, states: States, wanted_w: float) -> tuple[States, Powers]:
        asked_w[0] = wanted_w
        soc, end_c, heater_w, brake_w = step(k, states[0], states[1])
        return ((soc, min(end_c, most_c), 0.0, 0.0),
                (heater_w, brake_w, heater_w, heat_with_heater_w(trip.vehicle, 0.0, heater_w)))

    return drive


def _stand(trip: Trip, empty: int, states: FloatArray, powers_w: FloatArray) -> float:
    """
    Write the rest of a run whose charge runs out in step `empty`; return the driven share of that step.

    The step is driven until the battery is empty; from then on the vehicle stands. The powers of that
    step are known.
    """
    vehicle = trip.vehicle
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
