# SPDX-License-Identifier: Apache-2.0
"""What one plan costs in process, and how the cost grows with the number of segments."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
import math
from typing import TYPE_CHECKING

from bev_preheat.experiments.cost.figures import Figure, median_time_s, turns_s
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.vehicle import Vehicle

# The paper's trip, Table I.
STATE = BatteryState(-7.0, 0.9)
GOAL = Goal(25.0)
BOUNDS_MS = {'paper': 0.3, 'optimal_switch': 0.8}
SEGMENT_COUNTS = (120, 1440, 14400)
MERIT_ORDER_RATIO = 3.0
ROUNDS = 200
# Heater 45 s late, coolant 50 s, the sensor 30 s.
SLOW = HeatPath(45.0, 15e3, 300.0, 30.0)


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
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
    for name in ('reference', 'alpine_pass'):
        figures += [_merit_order_ratio(vehicle, name), _heat_path_ratio(vehicle, name)]
    return figures


def _merit_order_ratio(vehicle: Vehicle, name: str) -> Figure:
    """Return what minding the power limits adds to a plan, where none is active and where some are."""
    route = load_route(name, vehicle.defaults)
    # In turns, so that both meet the same load of the machine.
    merit_order_s, switch_s = turns_s(
        lambda: plan_preheating(vehicle, route, STATE, GOAL, 'merit_order'),
        lambda: plan_preheating(vehicle, route, STATE, GOAL, 'optimal_switch'), ROUNDS)
    return Figure(f'plan on {name}, N = {len(route)}, merit_order / optimal_switch',
                  merit_order_s / switch_s, '', MERIT_ORDER_RATIO)


def _heat_path_ratio(vehicle: Vehicle, name: str) -> Figure:
    """Return what heater and coolant as states add to a plan."""
    route = load_route(name, vehicle.defaults)
    slow = replace(vehicle, heat_path=SLOW)
    with_path_s, direct_s = turns_s(
        lambda: plan_preheating(slow, route, STATE, GOAL),
        lambda: plan_preheating(vehicle, route, STATE, GOAL), ROUNDS)
    return Figure(f'plan on {name}, N = {len(route)}, with a heat path / without',
                  with_path_s / direct_s, '')
