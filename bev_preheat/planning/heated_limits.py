# SPDX-License-Identifier: Apache-2.0
"""
The forward run that keeps the battery's limits, of a vehicle with a heat path.

What `limits` does for a heater whose heat arrives at once. A heater that lags takes what it takes: its
command is chosen so that the mean of the step keeps the limit. Heat that is under way counts as
arrived where the battery's highest temperature, or a threshold of heating, is meant.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.dynamics import hottest_c
from bev_preheat.planning.foresight import Foresight
from bev_preheat.planning.heat_run import (
    ends_before_arrival_s,
    heat_to_come_k,
    heated_step_of_floats,
    initial_states,
    make_heat_run,
    mean_share_left,
    States,
    states_at,
)
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.limits import WantedPower, Watch
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.terminal_limits import TerminalLimits

# The highest temperature is kept to this by heating.
HIGHEST_TOLERANCE_K = 1e-6
# Command, friction brake, what the heater takes, and heat into the battery, means of a step [W].
Powers = tuple[float, float, float, float]
# `drive(step, states)` -> states at its end, powers.
HeatedDrive = Callable[[int, States], tuple[States, Powers]]


def run_heated_within_limits(
        trip: Trip, state: BatteryState, watch: Watch, limits: TerminalLimits[float],
        wanted_w: WantedPower, take_surplus: bool, first: int = 0,
        before: Schedule | None = None) -> Schedule:
    """
    Return the Schedule of a forward run that keeps the limits; see `limits.run_within_limits`.

    `limits` are those of `vehicle.terminal_limits` for floats. `wanted_w(step,
    temperature_c)` is asked with the temperature that the battery will have when all heat that is
    under way has arrived.
    """
    drive = _drive_within_limits(trip, watch, limits, wanted_w, take_surplus)
    if before is None or before.heat is None or before.empty_at_s is not None:
        run = _Run([initial_states(state)], [])
    else:
        heat = before.heat
        run = _Run([states_at(before, k) for k in range(first + 1)], list(zip(*(
            values[:first].tolist() for values in (
                before.heater_power_w, before.brake_power_w, heat.drawn_power_w,
                heat.arriving_heat_w)))))
    most_c = hottest_c(trip.vehicle)
    driven_share = empty_at_s = None
    for k in range(len(run.powers_w), len(trip.route)):
        (soc, end_c, heater_w, excess_k), powers_w = drive(k, run.states[-1])
        if soc <= 0.0:
            driven_share = run.strand(trip, k, powers_w)
            empty_at_s = float(trip.time_s[k] + driven_share[k] * trip.route.duration_s[k])
            break
        run.states.append((soc, min(end_c, most_c), heater_w, excess_k))
        run.powers_w.append(powers_w)
    soc_run, temperature_c, heater_run_w, excess_run_k = np.array(run.states).T.copy()
    command_w, brake_w, drawn_w, arriving_w = np.array(run.powers_w).T.copy()
    start_s = switched_on_s(trip, command_w)
    if start_s is not None:
        # A step that is heated in part is heated evenly, from its beginning.
        on = int(np.searchsorted(trip.time_s, start_s, side='right')) - 1
        if watch.charge[on] or watch.discharge[on]:
            start_s = float(trip.time_s[on])
    return Schedule(
        start_s, command_w, brake_w, soc_run, temperature_c, make_runge_kutta_4,
        ends_before_arrival_s(trip, command_w), empty_at_s, driven_share,
        heat=make_heat_run(trip.vehicle.heat_path, heater_run_w, excess_run_k, drawn_w,
                           arriving_w))


def _drive_within_limits(trip: Trip, watch: Watch, limits: TerminalLimits[float],
                         wanted_w: WantedPower, take_surplus: bool) -> HeatedDrive:
    """Return `drive(k, states)`, which drives step k within the limits; see `limits`."""
    vehicle, path = trip.vehicle, trip.vehicle.heat_path
    step = heated_step_of_floats(vehicle, True)
    highest_c = vehicle.battery.temperature_range_c[1]
    heat_share = vehicle.drivetrain.heat_share
    k_per_watt, share_of_excess = heat_to_come_k(vehicle)
    joules_per_k = (vehicle.battery.heat_capacity_j_per_k
                    + vehicle.heat_path.coolant_heat_capacity_j_per_k) / vehicle.hvch.efficiency
    columns = list(zip(*(column.tolist() for column in (
        trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w,
        trip.leakage_w_per_k, trip.heater_limit_w, trip.route.propulsion_power_w, watch.charge,
        watch.discharge, mean_share_left(vehicle.heat_path, trip.route.duration_s)))))

    foresight = Foresight(trip, watch, limits) if path.heater_lag_s > 0.0 else None

    def drive(k: int, states: States) -> tuple[States, Powers]:
        (duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, cap_w, propulsion_w,
         may_overcharge, may_overdraw, left) = columns[k]
        soc, temperature_c, heater_w, excess_k = states

        def end_of(command_w: float, brake_w: float) -> tuple[float, ...]:
            ends: tuple[float, ...] = step(
                soc, temperature_c, heater_w, excess_k, duration_s, power_w + brake_w, variance_w2,
                heat_w - heat_share * brake_w, leakage_w_per_k, command_w)
            return ends

        def command_for(drawn_w: float) -> float:
            """Return the command with which the heater takes so much on average."""
            command_w: float = (drawn_w - left * heater_w) / (1.0 - left)
            return command_w

        settled_c = temperature_c + k_per_watt * heater_w + share_of_excess * excess_k
        if settled_c >= highest_c:
            command_w = cap_w = 0.0
        else:
            command_w = wanted_w(k, settled_c)
        if may_overcharge or may_overdraw:
            least_w, most_w = limits(soc, temperature_c, variance_w2)
            command_w = max(0.0, min(command_w, command_for(most_w - power_w)))
            if may_overcharge and take_surplus:
                # As a steady command: one that made up for the lag would swing from step to step.
                surplus_w = least_w - power_w
                if foresight is not None and surplus_w > 0.0:
                    surplus_w = min(surplus_w, foresight.lasting_surplus_w(k, states))
                command_w = max(command_w, min(cap_w, surplus_w))
        if foresight is not None and command_w > 0.0:
            command_w = max(0.0, min(command_w, foresight.off_in_time_w(k, states)))
        while True:
            brake_w = 0.0
            if may_overcharge:
                drawn_w = left * heater_w + (1.0 - left) * command_w
                brake_w = min(max(0.0, least_w - power_w - drawn_w), -propulsion_w)
            ends = end_of(command_w, brake_w)
            beyond_k = ends[1] + k_per_watt * ends[2] + share_of_excess * ends[3] - highest_c
            if command_w <= 0.0 or beyond_k <= HIGHEST_TOLERANCE_K:
                break
            command_w = max(0.0, command_w - beyond_k * joules_per_k / duration_s)
        if ends[0] > 1.0:
            # The brake takes what would overfill the battery.
            brake_w = halve(max(0.0, -propulsion_w), brake_w,
                            lambda braked_w: end_of(command_w, braked_w)[0] <= 1.0)
            ends = end_of(command_w, brake_w)
        soc_end, end_c, heater_end_w, excess_end_k, _, _, drawn_w, arriving_w = ends
        return ((min(soc_end, 1.0), end_c, heater_end_w, excess_end_k),
                (command_w, brake_w, drawn_w, arriving_w))

    return drive


class _Run:
    """A run on its way: the states at each instant, the powers of each step."""

    def __init__(self, states: list[States], powers_w: list[Powers]) -> None:
        self.states, self.powers_w = states, powers_w

    def strand(self, trip: Trip, empty: int, powers_w: Powers) -> FloatArray:
        """
        Add how the run ends whose charge runs out in step `empty`; return the driven share (N,).

        The step is driven until the battery is empty; from then on the vehicle stands, its heater
        takes nothing, and its coolant goes on to give its heat to the battery.
        """
        step = heated_step_of_floats(trip.vehicle, True)
        heat_share = trip.vehicle.drivetrain.heat_share
        driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)
        command_w, brake_w, _, _ = powers_w

        def drive_step(k: int, states: States, share: float) -> tuple[float, ...]:
            driven = trip.driven(driven_share)
            soc, temperature_c, heater_w, excess_k = states
            ends: tuple[float, ...] = step(
                soc, temperature_c, share * heater_w, excess_k, float(trip.route.duration_s[k]),
                float(driven.idle_power_w[k]) + share * brake_w,
                float(driven.power_variance_w2[k]),
                float(driven.idle_heat_w[k]) - share * heat_share * brake_w,
                float(trip.leakage_w_per_k[k]), share * command_w)
            return ends

        def carries(share: float) -> bool:
            driven_share[empty] = share
            return drive_step(empty, self.states[-1], share)[0] > 0.0

        driven_share[empty] = halve(0.0, 1.0, carries)
        for k in range(empty, len(trip.route)):
            share = float(driven_share[k])
            ends = drive_step(k, self.states[-1], share)
            self.states.append((0.0, min(ends[1], hottest_c(trip.vehicle)), 0.0, ends[3]))
            self.powers_w.append((share * command_w, share * brake_w, ends[6], ends[7]))
        return driven_share
