# SPDX-License-Identifier: Apache-2.0
"""
The best target of `preheat worth` against the joint nonlinear program of drive and charging session.

Draws random drives to a charger, finds the best target of each, and solves the joint program from several starts.
Drives and charges both plans with the same simulation, and reports the extra cost of the best target.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
import math
from typing import Any

from rich.console import Console

from bev_preheat.charging.worth_search import find_worth
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_figures
from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.vehicle.charging import charging_of
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip
from bev_preheat_studies.study import add_study, check_study_arguments, distribution, Study

# Outcomes of a trip.
COMPARED, NOT_DRIVEN, NEVER_CHARGED, SOLVER_FAILED = 'compared', 'not driven', 'never charged', 'solver failed'
# Below this heating energy, a plan counts as unheated.
HEATED_WH = 10.0
ROUNDING = 1e-9
# Trips listed by number: gaps above this share of the cost.
LISTED_GAP = 1e-3
PERCENTILES = {'least': 0.0, 'median': 50.0, '95 %': 95.0, 'worst': 100.0}


@dataclass(frozen=True)
class WorthGap:
    """
    One trip: its outcome, and the simulated costs of the best target and of the program.

    `blind_cost` is the program's cost without the start from the best target. `failed` counts IPOPT's failed
    calls. Temperatures on arrival [degC].
    """

    number: int
    outcome: str
    detail: str
    vehicle: str
    has_heat_path: bool
    cools: bool
    cost: float | None = None
    program_cost: float | None = None
    blind_cost: float | None = None
    arrival_c: float | None = None
    program_arrival_c: float | None = None
    is_heated: bool = False
    calls: int = 0
    failed: int = 0

    @property
    def gap(self) -> float | None:
        """Relative excess cost of the best target over the program; None: not compared."""
        return relative_gap(self.cost, self.program_cost)

    @property
    def blind_gap(self) -> float | None:
        """Relative excess cost over the program that was not started from the best target."""
        return relative_gap(self.cost, self.blind_cost)


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    add_study(subparsers, 'best_target', run, __doc__,
              'the best target against the joint program of drive and session')


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments)
    require('casadi')
    return Study(
        partial(compare_trip, arguments.seed), WorthGap, arguments.trips,
        {'study': 'best_target', 'seed': arguments.seed}, lambda result: result.outcome == COMPARED,
        'compared trips').conduct(arguments, _show)


def compare_trip(seed: int, number: int) -> WorthGap:
    """Return the WorthGap of one drawn trip."""
    from bev_preheat_studies.optimality.charging_program import solve_charging
    trip = draw_charging_trip(seed, number)
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    car = trip.vehicle.name, not trip.vehicle.heat_path.is_direct, charging_of(trip.vehicle).cooling is not None
    try:
        worth = find_worth(*inputs, trip.stop.charger_power_w, trip.stop.departure_soc, trip.prices)
    except InvalidInput as error:
        return WorthGap(number, NOT_DRIVEN, str(error), *car)
    unheated = plan_unheated(*inputs)
    if unheated.undeliverable_power_w > 0.0 or unheated.soc_shortfall > 0.0:
        return WorthGap(number, NOT_DRIVEN, unheated.explanation, *car)
    if math.isinf(worth.best.cost):
        return WorthGap(number, NEVER_CHARGED, worth.verdict, *car)
    optimum = solve_charging(*inputs, trip.stop, trip.prices, (worth.best.target_c,))
    attempts, best = optimum.attempts, optimum.best
    solved = [attempt for attempt in attempts if attempt.driven is not None]
    calls: dict[str, Any] = {'calls': len(attempts), 'failed': len(attempts) - len(solved)}
    if best is None:
        return WorthGap(number, SOLVER_FAILED, attempts[0].status, *car, **calls)
    # The start whose cost equals the best target's is the start from the best target.
    blind = [attempt.driven.cost for attempt in solved if attempt.driven is not None and (
        worth.best is worth.without_heating or attempt.start > worth.best.cost * (1.0 + ROUNDING))]
    return WorthGap(
        number, COMPARED, '', *car, worth.best.cost, best.cost, min(blind, default=None),
        worth.best.arrival_temperature_c, best.plan.arrival_temperature_c,
        max(worth.best.hvch_electric_wh, best.plan.energy_wh.hvch_electric) > HEATED_WH, **calls)


def relative_gap(cost: float | None, other: float | None) -> float | None:
    """Return the excess of a cost over `other`, as a share of `other`; 0 if both are zero."""
    if cost is None or other is None:
        return None
    if cost == other:
        return 0.0
    return (cost - other) / other if other > 0.0 else math.inf


def summarise(results: Sequence[WorthGap]) -> dict[str, Any]:
    """Return the figures of a study as plain values for JSON; gaps as shares of the cost."""
    compared = [result for result in results if result.outcome == COMPARED]
    heated = [result for result in compared if result.is_heated]
    groups = {
        'all trips': [result.gap for result in compared],
        '… program not started from the best target': [result.blind_gap for result in compared],
        'heated, heat arrives at once': [result.gap for result in heated if not result.has_heat_path],
        'heated, with a heat path': [result.gap for result in heated if result.has_heat_path],
        'the car cools at the charger': [result.gap for result in compared if result.cools]}
    return {
        'trips': len(results),
        'outcomes': {outcome: sum(result.outcome == outcome for result in results)
                     for outcome in (COMPARED, NOT_DRIVEN, NEVER_CHARGED, SOLVER_FAILED)},
        'heated': len(heated), 'calls': sum(result.calls for result in results),
        'failed_calls': sum(result.failed for result in results),
        'gaps': {name: distribution(gaps, **PERCENTILES) for name, gaps in groups.items()}}


def _show(console: Console, results: list[WorthGap]) -> dict[str, Any]:
    summary = summarise(results)
    outcomes = ', '.join(f'{count} {name}' for name, count in summary['outcomes'].items() if count)
    console.print(f'{summary["trips"]} trips: {outcomes}; {summary["heated"]} are heated', soft_wrap=True)
    print_figures(
        console, 'Cost of the best target above the joint program (%)', ('', *PERCENTILES),
        [(name, *(f'{100.0 * gaps[key]:.4f}' if gaps else '–' for key in PERCENTILES))
         for name, gaps in summary['gaps'].items()])
    console.print(f'IPOPT failed in {summary["failed_calls"]} of {summary["calls"]} calls', soft_wrap=True)
    for result in results:
        if result.gap is not None and abs(result.gap) > LISTED_GAP:
            console.print(
                f'trip {result.number}, {result.vehicle}: best target {result.arrival_c:.1f} degC costs '
                f'{result.cost:.3f}, program {result.program_arrival_c:.1f} degC {result.program_cost:.3f}',
                soft_wrap=True)
    return {'summary': summary}
