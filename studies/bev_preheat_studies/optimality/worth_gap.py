# SPDX-License-Identifier: Apache-2.0
"""Compare the best target of `find_worth` with the joint program of drive and session, on many trips."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import count
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.charging.worth import find_worth
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.vehicle.charging import charging_of
from bev_preheat_studies.kept_results import Kept
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip
from bev_preheat_studies.workers import Workers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bev_preheat.charging.worth import Worth
    from bev_preheat.nonlinear_program.charging_program import ChargingOptimum
    from bev_preheat_studies.optimality.charging_trips import ChargingTrip

# Outcomes of a trip.
COMPARED = 'compared'
NOT_DRIVEN = 'not driven'
NEVER_CHARGED = 'never charged'
SOLVER_FAILED = 'solver failed'
# Costs of IPOPT's optima that differ by more than this share are different optima.
SAME_COST = 1e-3
# Below this heating energy, a plan counts as unheated.
HEATED_WH = 10.0
ROUNDING = 1e-9
PERCENTILES = {'median': 50.0, '95 %': 95.0, 'worst': 100.0}


@dataclass(frozen=True)
class WorthGap:
    """
    One trip: its outcome, and the simulated costs of the best target and of the program.

    `blind_cost` is the program's cost without the start from the best target. `optima` counts IPOPT's optima
    of different cost, `failed` its failed calls. Temperatures on arrival [degC].
    """

    number: int
    outcome: str
    detail: str
    vehicle: str
    has_heat_path: bool
    cools: bool = False
    cost: float | None = None
    program_cost: float | None = None
    blind_cost: float | None = None
    unheated_cost: float | None = None
    arrival_c: float | None = None
    program_arrival_c: float | None = None
    hvch_electric_wh: float | None = None
    program_hvch_electric_wh: float | None = None
    optima: int = 0
    calls: int = 0
    failed: int = 0
    solve_time_s: float | None = None

    @property
    def gap(self) -> float | None:
        """Relative excess cost of the best target over the program; None: not compared."""
        return relative_gap(self.cost, self.program_cost)

    @property
    def blind_gap(self) -> float | None:
        """Relative excess cost over the program that was not started from the best target."""
        return relative_gap(self.cost, self.blind_cost)

    @property
    def is_heated(self) -> bool:
        """Whether the best target or the program heats."""
        return max(self.hvch_electric_wh or 0.0, self.program_hvch_electric_wh or 0.0) > HEATED_WH


def relative_gap(cost: float | None, other: float | None) -> float | None:
    """Return the excess of a cost over `other`, as a share of `other`; 0 if both are zero."""
    if cost is None or other is None:
        return None
    if cost == other:
        return 0.0
    return (cost - other) / other if other > 0.0 else math.inf


def solve_charging_trip(seed: int, number: int) -> WorthGap:
    """Return the WorthGap of one drawn trip."""
    return compare(draw_charging_trip(seed, number))


def compare(trip: ChargingTrip) -> WorthGap:
    """Return the WorthGap of a trip."""
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    car = (trip.vehicle.name, not trip.vehicle.heat_path.is_direct,
           charging_of(trip.vehicle).cooling is not None)
    try:
        worth = _worth_of(trip)
    except InvalidInput as error:
        return WorthGap(trip.number, NOT_DRIVEN, str(error), *car)
    unheated = plan_unheated(*inputs)
    if unheated.undeliverable_power_w > 0.0:
        return WorthGap(trip.number, NOT_DRIVEN, f'{unheated.undeliverable_power_w:.0f} W short', *car)
    if unheated.soc_shortfall > 0.0:
        return WorthGap(trip.number, NOT_DRIVEN, 'the reserve is not kept', *car)
    if math.isinf(worth.best.cost):
        return WorthGap(trip.number, NEVER_CHARGED, worth.verdict, *car)
    optimum = _optimum_of(trip, worth)
    attempts = optimum.attempts
    found = [attempt.driven.cost for attempt in attempts if attempt.driven is not None]
    if optimum.best is None:
        return WorthGap(trip.number, SOLVER_FAILED, attempts[0].status, *car, calls=len(attempts),
                        failed=len(attempts))
    # The start whose cost equals the best target's is the start from the best target.
    blind = [attempt.driven.cost for attempt in attempts if attempt.driven is not None and (
        worth.best is worth.without_heating or attempt.start > worth.best.cost * (1.0 + ROUNDING))]
    return WorthGap(
        trip.number, COMPARED, '', *car, cost=worth.best.cost, program_cost=optimum.best.cost,
        blind_cost=min(blind, default=None), unheated_cost=worth.without_heating.cost,
        arrival_c=worth.best.arrival_temperature_c,
        program_arrival_c=optimum.best.plan.arrival_temperature_c,
        hvch_electric_wh=worth.best.hvch_electric_wh,
        program_hvch_electric_wh=optimum.best.plan.energy_wh.hvch_electric,
        optima=count_optima(found), calls=len(attempts), failed=len(attempts) - len(found),
        solve_time_s=optimum.solve_time_s)


def solve_both(trip: ChargingTrip) -> tuple[Worth, ChargingOptimum]:
    """Return the Worth and the ChargingOptimum of a trip; raise InvalidInput if it cannot be driven."""
    worth = _worth_of(trip)
    return worth, _optimum_of(trip, worth)


def _worth_of(trip: ChargingTrip) -> Worth:
    return find_worth(trip.vehicle, trip.route, trip.state, trip.goal, trip.stop.charger_power_w,
                      trip.stop.departure_soc, trip.prices)


def _optimum_of(trip: ChargingTrip, worth: Worth) -> ChargingOptimum:
    from bev_preheat.nonlinear_program.charging_program import solve_charging
    return solve_charging(trip.vehicle, trip.route, trip.state, trip.goal, trip.stop, trip.prices,
                          (worth.best.target_c,))


def count_optima(costs: Sequence[float]) -> int:
    """Return the number of costs that exceed the next lower one by more than SAME_COST."""
    costs = sorted(cost for cost in costs if math.isfinite(cost))
    return sum(index == 0 or cost > (1.0 + SAME_COST) * costs[index - 1]
               for index, cost in enumerate(costs))


def summarise(results: Sequence[WorthGap]) -> dict[str, Any]:
    """Return the figures of a study as plain values for JSON; gaps as shares of the cost."""
    compared = [result for result in results if result.outcome == COMPARED]
    figures: dict[str, Any] = {
        'trips': len(results),
        'outcomes': {outcome: sum(result.outcome == outcome for result in results)
                     for outcome in (COMPARED, NOT_DRIVEN, NEVER_CHARGED, SOLVER_FAILED)},
        'calls': sum(result.calls for result in results),
        'failed_calls': sum(result.failed for result in results),
        'several_optima': [result.number for result in compared if result.optima > 1]}
    heated = [result for result in compared if result.is_heated]
    late = [result for result in heated if result.has_heat_path]
    at_once = [result for result in heated if not result.has_heat_path]
    cooled = [result for result in compared if result.cools]
    figures.update(heated=len(heated), heated_by_heat_path=len(late), cooled=len(cooled))
    for name, key_name, chosen in (
            ('gap', 'gap', compared), ('blind_gap', 'blind_gap', compared),
            ('heated_gap', 'gap', at_once), ('heat_path_gap', 'gap', late),
            ('cooled_gap', 'gap', cooled)):
        gaps = [(gap, result.number) for result in chosen
                if (gap := getattr(result, key_name)) is not None]
        values = [gap for gap, _ in gaps]
        figures[name] = {key: float(np.percentile(values, share)) for key, share in (
            {'least': 0.0, **PERCENTILES}).items()} if values else {}
        figures[f'worst_{name}_trip'] = max(gaps)[1] if gaps else None
    return figures


def result_from(record: dict[str, Any]) -> WorthGap:
    """Return a WorthGap from its record in a file of results."""
    return WorthGap(**record)


def run_worth_study(compared: int, seed: int, jobs: int | None, report: Callable[[WorthGap], object],
                    kept: Kept[WorthGap] | None = None) -> list[WorthGap]:
    """
    Run trips 0, 1, 2 … until `compared` of them are compared; return their WorthGaps in order.

    `report(result)` is called with each result once it and all earlier ones are finished; `kept` are those of an
    earlier run. The trips do not depend on `jobs`. Raises WorkerLost if a process dies.
    """
    results: list[WorthGap] = []
    found, kept = 0, kept or Kept()
    with Workers(jobs) as workers:
        for result in run_numbered(workers, partial(solve_charging_trip, seed), count(), kept.finished, kept.keep):
            results.append(result)
            found += result.outcome == COMPARED
            report(result)
            if found >= compared:
                break
    return results
