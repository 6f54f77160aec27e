# SPDX-License-Identifier: Apache-2.0
"""Cost of a plan in process, and its growth with the number of segments."""

from __future__ import annotations

from ctypes import addressof
from dataclasses import replace
from functools import partial
import math
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.calls import place
from bev_preheat.native.library import core
from bev_preheat.native.structs import room, SwitchPlanStruct
from bev_preheat.planning.core_engine import trip_in_core, vehicle_in_core
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.cost.figures import Figure, median_time_s, turns_s
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

# The paper's trip, Table I.
STATE = BatteryState(-7.0, 0.9)
GOAL = Goal(25.0)
BOUNDS_MS = {'paper': 0.3, 'optimal_switch': 0.15, 'value_function': 0.15}
# Bound on the time of a plan in Python over that of its single call of the native core.
CORE_RATIO = 5.0
SEGMENT_COUNTS = (120, 1440, 14400)
# Bounds on the time of a plan: over that of `optimal_switch` if no limit is active (reference), and if some are
# (alpine_pass, and the slowest of drawn trips), as docs/decisions/0014-value-function.md asks.
ROUTE, RATIO = 'reference', 3.0
PASS, LIMITED_BOUND_MS = 'alpine_pass', 20.0
LIMIT_TRIPS, LIMIT_SEED = 20, 0
ROUNDS = 200
# Heater lag 45 s, coolant 50 s, sensor lag 30 s.
SLOW = HeatPath(45.0, 15e3, 300.0, 30.0)


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    vehicle = load_vehicle('reference')
    route = load_route(ROUTE, vehicle.defaults)
    figures = []
    for method in METHODS:
        times_s = {}
        for count in SEGMENT_COUNTS:
            split = route.resampled(route.total_duration_s / count)
            times_s[count] = median_time_s(
                partial(plan_preheating, vehicle, split, STATE, GOAL, method),
                repetitions=max(5, 60000 // count))
            log(f'{method}, N = {count}: {1e3 * times_s[count]:.3f} ms')
        figures.append(Figure(f'plan, {method}, N = {len(route)}, median',
                              1e3 * times_s[len(route)], 'ms', BOUNDS_MS.get(method)))
        first, last = SEGMENT_COUNTS[0], SEGMENT_COUNTS[-1]
        exponent = math.log(times_s[last] / times_s[first]) / math.log(last / first)
        figures.append(Figure(f'growth of {method} with N from {first} to {last}: exponent',
                              exponent, '', 1.1))
    figures += [_new_route(vehicle, route), *_core_ratios(vehicle, route)]
    for name in (ROUTE, PASS):
        figures += [*_limit_figures(vehicle, name), _heat_path_ratio(vehicle, name)]
    return [*figures, *_limit_trips(vehicle, log)]


def _new_route(vehicle: Vehicle, route: Route) -> Figure:
    """Return the time of a plan on a route that was not planned before, as after the car has moved on."""
    durations_s = []
    for copy in [replace(route) for _ in range(ROUNDS)]:
        started = perf_counter()
        plan_preheating(vehicle, copy, STATE, GOAL)
        durations_s.append(perf_counter() - started)
    return Figure(f'plan, value_function, N = {len(route)}, each on a new route, median',
                  1e3 * median(durations_s), 'ms')


def _core_ratios(vehicle: Vehicle, route: Route) -> list[Figure]:
    """Return the time of a plan over that of its call of the native core; empty without a core."""
    library = core()
    if library is None:
        return []
    native = vehicle_in_core(vehicle)
    trip = trip_in_core(make_trip(vehicle, route))
    instants, plan = trip.steps + 1, SwitchPlanStruct()
    arrays = [np.empty(count) for count in (
        room('BEV_SWITCH_MEMORY', trip.steps), instants, instants, trip.steps)]
    arguments = (native.address, trip.address, STATE.soc, STATE.temperature_c,
                 GOAL.target_temperature_c, 0, None, *map(place, arrays), addressof(plan))
    call = partial(library.bev_plan_switch, *arguments)
    figures = []
    for method in ('value_function', 'optimal_switch'):
        plan_s, call_s = turns_s(
            partial(plan_preheating, vehicle, route, STATE, GOAL, method), call, 5 * ROUNDS)
        figures.append(Figure(f'plan, {method}, N = {trip.steps} / the call of the core in it',
                              plan_s / call_s, '', CORE_RATIO))
    return [Figure('call of the core in a plan, median', 1e3 * call_s, 'ms'), *figures]


def _limit_figures(vehicle: Vehicle, name: str) -> list[Figure]:
    """Return the time of a plan on a route, and its ratio to a plan without power limits."""
    route = load_route(name, vehicle.defaults)
    # Alternating, so that both see the same load of the machine.
    by_values_s, switch_s = turns_s(
        lambda: plan_preheating(vehicle, route, STATE, GOAL, 'value_function'),
        lambda: plan_preheating(vehicle, route, STATE, GOAL, 'optimal_switch'), ROUNDS)
    what = f'plan on {name}, N = {len(route)}, value_function'
    return [Figure(f'{what}, median', 1e3 * by_values_s, 'ms',
                   LIMITED_BOUND_MS if name == PASS else None),
            Figure(f'{what} / optimal_switch', by_values_s / switch_s, '',
                   RATIO if name == ROUTE else None)]


def _limit_trips(vehicle: Vehicle, log: Callable[[str], object]) -> list[Figure]:
    """Return the time of plans on drawn trips with active limits: the longest, and the mean."""
    times_ms = []
    for number in range(LIMIT_TRIPS):
        trip = draw_limit_trip(vehicle, LIMIT_SEED, number)
        times_ms.append(1e3 * median_time_s(
            partial(plan_preheating, trip.vehicle, trip.route, trip.state, trip.goal), repetitions=9))
        log(f'trip {number} with limits: {times_ms[-1]:.3f} ms')
    what = f'plans on {LIMIT_TRIPS} drawn trips with limits'
    return [Figure(f'{what}, the slowest', max(times_ms), 'ms', LIMITED_BOUND_MS),
            Figure(f'{what}, mean', sum(times_ms) / len(times_ms), 'ms')]


def _heat_path_ratio(vehicle: Vehicle, name: str) -> Figure:
    """Return the ratio of a plan's time with heater and coolant as states to that without."""
    route = load_route(name, vehicle.defaults)
    slow = replace(vehicle, heat_path=SLOW)
    with_path_s, direct_s = turns_s(
        lambda: plan_preheating(slow, route, STATE, GOAL),
        lambda: plan_preheating(vehicle, route, STATE, GOAL), ROUNDS)
    return Figure(f'plan on {name}, N = {len(route)}, with a heat path / without',
                  with_path_s / direct_s, '')
