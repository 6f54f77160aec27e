# SPDX-License-Identifier: Apache-2.0
"""
Energy of heating that further heat sources save against the HVCH alone, over the temperature of the air.

A car that differs from its file drives each drawn trip; its plan is made again every five minutes.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_figures
from bev_preheat.drawing.figure import grid_figure, legend_above, save_figure
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.simulation.heater import HeaterLease
from bev_preheat.simulation.imperfect_car import Mismatch, true_vehicle
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import hvch_alone
from bev_preheat_studies.optimality.drawn_trips import draw_trip, DrawnTrip
from bev_preheat_studies.study import add_study, check_study_arguments, Study

AIR_C = (-25, -20, -15, -10, -5, 0, 5, 10)
# Steps of 30 s between two plans; half the range of the true car's factors, in the order of Mismatch.
STEPS_BETWEEN_PLANS = 10
SPREAD = (0.1, 0.2, 0.2, 0.05, 0.15)


@dataclass(frozen=True)
class SourcesResult:
    """One trip: air [deg C], energy of heating saved [%], error of a car on arrival [K]; None: no figure."""

    number: int
    air_c: int
    saved_percent: float | None = None
    error_k: float | None = None


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    add_study(subparsers, 'heat_sources', run, __doc__, 'energy that heat sources save', most=200, plots=True
              ).add_argument('--vehicle', default='heat_pump_car', metavar='NAME|FILE')


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments)
    identity = {'study': 'heat_sources', 'vehicle': arguments.vehicle, 'seed': arguments.seed}
    return Study(partial(solve, arguments.vehicle, arguments.seed), SourcesResult, arguments.trips,
                 identity).conduct(arguments, partial(_show, arguments.plot))


def solve(vehicle: str, seed: int, number: int) -> SourcesResult:
    """Return the SourcesResult of a drawn trip; without figures if the target needs no heat, or is missed."""
    air_c = AIR_C[number % len(AIR_C)]
    drawn = draw_trip(load_vehicle(vehicle), seed, number)
    route = replace(drawn.route, ambient_temperature_c=np.full(len(drawn.route), float(air_c)))
    drawn = replace(drawn, route=route, state=BatteryState(air_c + 2.0, drawn.state.soc))
    unheated, alone, mixed = (plan_preheating(car, route, drawn.state, goal) for car, goal in (
        (drawn.vehicle, replace(drawn.goal, charging_planned=False)), (hvch_alone(drawn.vehicle), drawn.goal),
        (drawn.vehicle, drawn.goal)))
    if alone.heating_start_s is None or max(alone.shortfall_k, mixed.shortfall_k) > SHORTFALL_TOLERANCE_K:
        return SourcesResult(number, air_c)
    spent_wh, mixed_wh = (
        plan.energy_wh.battery_total - unheated.energy_wh.battery_total for plan in (alone, mixed))
    factors = np.random.default_rng([seed, number]).uniform(-1.0, 1.0, len(SPREAD)) * SPREAD + 1.0
    arrival_c, _ = drive(drawn, drawn.goal, Mismatch(*factors))
    return SourcesResult(number, air_c, 100.0 * (1.0 - mixed_wh / spent_wh),
                         arrival_c - drawn.goal.target_temperature_c)


def drive(drawn: DrawnTrip, goal: Goal, mismatch: Mismatch) -> tuple[float, float]:
    """Return the temperature on arrival and the highest [deg C] of the true car, whose plan is made again."""
    route, hottest_c = drawn.route, drawn.state.temperature_c
    plant = VehiclePlant(true_vehicle(drawn.vehicle, mismatch, None), route, drawn.state)
    for step in range(len(route)):
        after = step % STEPS_BETWEEN_PLANS
        if after == 0:
            plan = plan_preheating(drawn.vehicle, route.segments(step, len(route)), BatteryState(
                min(plant.temperature_c, drawn.vehicle.battery.temperature_range_c[1]), plant.soc), goal)
        powers_w = {name: float(power_w[after]) for name, power_w in plan.source_power_w.items()}
        plant.advance_under(HeaterLease(powers_w.pop('hvch'), math.inf, powers_w), float(route.time_s[step + 1]))
        hottest_c = max(hottest_c, plant.temperature_c)
    return plant.temperature_c, hottest_c


def summarise(results: Sequence[SourcesResult]) -> dict[int, list[list[float]]]:
    """Return 5, 50 and 95 % of energy saved [%] and error [K] for each temperature of the air [deg C]."""
    return {air_c: [np.percentile(values, (5, 50, 95)).tolist() for values in zip(*found)] for air_c in AIR_C if (
        found := [(result.saved_percent, result.error_k) for result in results
                  if result.air_c == air_c and result.saved_percent is not None])}


def _show(plot: str | None, console: Console, results: list[SourcesResult]) -> dict[str, Any]:
    figures = summarise(results)
    print_figures(console, 'Energy of heating saved [%], error on arrival [K]', (
        'air [degC]', 'saved: 5 %', 'median', '95 %', 'error: 5 %', 'median', '95 %'), [
        (f'{air_c}', *map('{:.1f}'.format, saved), *map('{:+.2f}'.format, errors_k))
        for air_c, (saved, errors_k) in figures.items()])
    if plot:
        figure, ((axis,),) = grid_figure(1, 1, 'Energy of heating saved against the HVCH alone', height_in=4.0)
        low, middle, high = np.transpose([saved for saved, _ in figures.values()])
        lines = [axis.fill_between([*figures], low, high, alpha=0.3, label='5 … 95 %'),
                 *axis.plot([*figures], middle, marker='o', label='median')]
        axis.set(xlabel='temperature of the air [°C]', ylabel='energy saved [%]')
        legend_above(axis, lines)
        save_figure(figure, plot)
    return {'figures': figures}
