# SPDX-License-Identifier: Apache-2.0
"""Algorithms 1 and 2 of the paper, as printed: for method `paper`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.dynamics import run_forward, run_on, step_of_floats
from bev_preheat.planning.heat_run import initial_states, run_heated
from bev_preheat.planning.schedule import maximum_from, Schedule
from bev_preheat.tunables import LOST_ABOVE_TARGET_K
from bev_preheat.vehicle.model import Integrator, make_euler, Step
from bev_preheat.vehicle.variants import without_heat_path

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip


def run_paper(trip: Trip, state: BatteryState, target_c: float, terminal_soc: float | None = None) -> Schedule:
    """
    Return the Schedule of the forward and the backward simulation, for a target on arrival [deg C].

    Algorithm 1 runs forward without battery heating, Algorithm 2 backward from the target with all the power that
    the cabin leaves; the heater is switched on where the two temperatures meet.

    The paper asks for T_bk == T_fw at a step; here the first crossing is used and the switching instant
    interpolated within its step. The state of charge at the end, which the paper assumes (`terminal_soc`, its
    soc_f), defaults to that of the forward run. The trajectories are those of a forward run under the resulting
    heater power, because joining the two halves would leave a jump at the crossing. With a heat path, the
    switching instant is found without it, and the trajectories include it.
    """
    if not trip.vehicle.heat_path.is_direct:
        # The paper has no heat path: it switches as if heat arrived at once.
        planned = run_paper(replace(trip, vehicle=without_heat_path(trip.vehicle)), state, target_c,
                            terminal_soc)
        return run_heated(trip, initial_states(state), planned.heater_power_w, planned.heating_start_s)
    idle_w = np.zeros(len(trip.route))
    idle_soc, idle_temperature_c = run_forward(trip, make_euler, state.soc, state.temperature_c)
    if idle_temperature_c[-1] >= target_c:
        return Schedule(None, idle_w, idle_w, idle_soc, idle_temperature_c, make_euler)

    instant_s = find_crossing(trip, target_c, float(idle_soc[-1]) if terminal_soc is None else terminal_soc,
                              idle_temperature_c)
    if instant_s is None:
        instant_s = 0.0
    heater_power_w = maximum_from(trip, instant_s)
    soc, temperature_c = run_on(
        trip, make_euler, idle_soc, idle_temperature_c, trip.step_at(instant_s), heater_power_w)
    return Schedule(instant_s, heater_power_w, idle_w, soc, temperature_c, make_euler)


def find_crossing(trip: Trip, target_c: float, terminal_soc: float,
                  idle_temperature_c: FloatArray,
                  make_integrator: Integrator = make_euler) -> float | None:
    """
    Return the instant [s] at which Algorithm 2 meets the unheated run; None if it never does.

    `idle_temperature_c` (N + 1 values) is the unheated run, colder than the target at its end.
    The paper steps backward by Euler's method; another one may be passed.
    """
    columns = [array.tolist() for array in trip.inputs(trip.heater_limit_w)]
    try:
        return _backward(step_of_floats(trip.vehicle, make_integrator), trip, columns,
                         target_c, terminal_soc, idle_temperature_c.tolist())
    except ValueError:
        return _backward(step_of_floats(trip.vehicle, make_integrator, saturating=True), trip,
                         columns, target_c, terminal_soc, idle_temperature_c.tolist())


def _backward(step: Step[float], trip: Trip, columns: list[list[float]], target_c: float,
              soc: float, idle_temperature_c: list[float]) -> float | None:
    temperature_c = target_c
    above_k = target_c - idle_temperature_c[-1]
    steps = zip(range(len(trip.route) - 1, -1, -1), *(reversed(column) for column in columns))
    for k, duration_s, power_w, variance_w2, heat_w, leakage_w_per_k in steps:
        soc, temperature_c, _, _ = step(
            soc, temperature_c, -duration_s, power_w, variance_w2, heat_w, leakage_w_per_k)
        above_before_k, above_k = above_k, temperature_c - idle_temperature_c[k]
        if above_k <= 0.0:
            return float(trip.time_s[k + 1]
                         - duration_s * above_before_k / (above_before_k - above_k))
        if temperature_c > target_c + LOST_ABOVE_TARGET_K:
            return None
    return None
