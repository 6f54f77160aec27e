# SPDX-License-Identifier: Apache-2.0
"""
What cooling before a fast charge saves in summer, and how close its plans are to the program.

Each drawn trip, in air of 25 to 40 degC, ends at a charger. The cheapest target is that of `preheat worth`; a car
that differs from its file drives there, with its plan made again every five minutes.
"""

from __future__ import annotations

from argparse import Namespace
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.charging.target_worth import ENERGY_PRICE_PER_KWH, Prices, VALUE_OF_TIME_PER_H
from bev_preheat.charging.worth_search import find_worth, goal_of
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_figures
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import S_PER_MIN
from bev_preheat.optional_packages import require
from bev_preheat.planning.plan import energy_gap_wh, Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.imperfect_car import Mismatch
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.optimality.drawn_trips import draw_trip
from bev_preheat_studies.optimality.heat_sources import drive, SPREAD
from bev_preheat_studies.study import add_study, check_study_arguments, Study

AIR_C, WARMEST_C, DEPARTURE_SOC, CHARGERS_W = (25.0, 40.0), 50.0, 0.8, (11e3, 50e3, 150e3, 250e3)
FIGURES = {'saved_min': 'saved at the charger [min]', 'electric_wh': 'energy of cooling [Wh]',
           'saved_cost': 'cost saved', 'gap_wh': 'above the program [Wh]',
           # The program switches for nothing; a plan runs at little power through its pauses.
           'switch_ons': 'times switched on', 'program_switch_ons': '… by the program',
           'error_k': 'error on arrival [K]', 'beyond_k': 'above the highest temperature [K]'}
LEAST_POWER_W = 1.0


@dataclass(frozen=True)
class SummerResult:
    """One trip; its figures, whose names are in FIGURES, are None if it cannot be driven or is not cooled."""

    number: int
    is_driven: bool = False
    saved_min: float | None = None
    electric_wh: float | None = None
    saved_cost: float | None = None
    gap_wh: float | None = None
    switch_ons: int | None = None
    program_switch_ons: int | None = None
    error_k: float | None = None
    beyond_k: float | None = None


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    add_study(subparsers, 'summer', run, __doc__, 'what cooling saves before a fast charge').add_argument(
        '--vehicle', default='heat_pump_car', metavar='NAME|FILE')


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments)
    require('casadi')
    identity = {'study': 'summer', 'vehicle': arguments.vehicle, 'seed': arguments.seed}
    return Study(partial(solve, arguments.vehicle, arguments.seed), SummerResult, arguments.trips,
                 identity).conduct(arguments, _show)


def solve(vehicle: str, seed: int, number: int) -> SummerResult:
    """Return the SummerResult of a drawn trip."""
    from bev_preheat.nonlinear_program.solve import solve_optimum, SolverFailure
    drawn, random = draw_trip(load_vehicle(vehicle), seed, number), np.random.default_rng([seed, number])
    air_c = random.uniform(*AIR_C)
    steps = np.ones(len(drawn.route))
    drawn = replace(drawn, state=BatteryState(random.uniform(air_c, WARMEST_C), drawn.state.soc), route=replace(
        drawn.route, ambient_temperature_c=air_c * steps, cabin_heating_power_w=0.0 * steps))
    case = drawn.vehicle, drawn.route, drawn.state
    try:
        worth = find_worth(*case, drawn.goal, CHARGERS_W[number % len(CHARGERS_W)], DEPARTURE_SOC, Prices(
            ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H))
    except InvalidInput:
        return SummerResult(number)
    best, without = worth.best, worth.without_heating
    if best.target_c >= without.target_c:
        return SummerResult(number, True)
    goal = goal_of(drawn.goal, best.target_c, without.target_c)
    plan = plan_preheating(*case, goal)
    gap_wh = program_switch_ons = None
    with suppress(SolverFailure):
        program = solve_optimum(*case, goal).plan
        gap_wh, program_switch_ons = energy_gap_wh(plan, program), _switch_ons(program)
    arrival_c, hottest_c = drive(drawn, goal, Mismatch(*(random.uniform(-1.0, 1.0, len(SPREAD)) * SPREAD + 1.0)))
    highest_c = drawn.vehicle.battery.temperature_range_c[1]
    return SummerResult(
        number, True, (without.charging_time_s - best.charging_time_s) / S_PER_MIN, best.hvch_electric_wh,
        without.cost - best.cost, gap_wh, _switch_ons(plan), program_switch_ons, arrival_c - best.target_c,
        max(hottest_c - highest_c, 0.0))


def _switch_ons(plan: Plan) -> int:
    """Return how often a plan switches any source on."""
    is_on = np.abs([*plan.source_power_w.values()]) > LEAST_POWER_W
    return int((np.diff(is_on, prepend=False) & is_on).sum())


def _show(console: Console, results: list[SummerResult]) -> dict[str, Any]:
    found = {name: [value for result in results if (value := getattr(result, name)) is not None]
             for name in FIGURES}
    figures = {name: np.percentile(values, (5, 50, 95, 100)).tolist() for name, values in found.items() if values}
    counts = {'driven': sum(result.is_driven for result in results), 'cooled': len(found['saved_min'])}
    title = f'{counts["driven"]} trips, {counts["cooled"]} cooled'
    print_figures(console, title, ('', '5 %', 'median', '95 %', 'most'), [
        (FIGURES[name], *map('{:.2f}'.format, values)) for name, values in figures.items()])
    return {**counts, 'figures': figures}
