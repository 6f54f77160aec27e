# SPDX-License-Identifier: Apache-2.0
"""Run the methods and the nonlinear program on many trips, on any executor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.comparison import difference, energy_gap_wh
from bev_preheat.planning.planner import as_driven, DEFAULT_METHOD, METHODS, plan_preheating
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle.terminal_limits import make_terminal_limits
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.optimality.drawn_trips import DRAWS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from concurrent.futures import Executor

    from bev_preheat.nonlinear_program.solve import Optimum
    from bev_preheat.planning.plan import Plan
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_studies.optimality.drawn_trips import DrawnTrip

# Outcomes of a trip, as found by the nonlinear program, not by the methods.
FEASIBLE = 'feasible'
NOT_NEEDED = 'not needed'
UNREACHABLE = 'unreachable'
RESERVE_MISSED = 'reserve missed'
POWER_LACKING = 'power lacking'
# Target, reserve and power are met, but the drive itself heats the battery beyond its range.
BEYOND_RANGE = 'beyond range'
SOLVER_FAILED = 'solver failed'
# Below this heating energy, the program's heater counts as unused.
NO_HEATING_WH = 0.01


@dataclass(frozen=True)
class MethodResult:
    """
    The result of one method on one trip, simulated within the limits.

    `gap_wh` is the energy above the program's; None if plan and program do not reach the same, and
    `difference` then names the difference (see planning.comparison). `violation` is the largest excess over a
    power limit, as a share of the power; 0 without any. `keeps_limits`: the plan itself kept the limits.
    """

    status: str
    arrival_temperature_c: float
    energy_wh: float
    gap_wh: float | None
    difference: str
    arrival_soc: float
    violation: float
    keeps_limits: bool
    planning_time_s: float


@dataclass(frozen=True)
class GapResult:
    """One trip: its data, the program's result, and each method's result."""

    number: int
    outcome: str
    detail: str
    duration_s: float
    target_c: float
    reserve_soc: float
    optimal_energy_wh: float | None
    optimal_arrival_c: float | None
    optimal_arrival_soc: float | None
    solve_time_s: float | None
    methods: dict[str, MethodResult]


def solve_trip(vehicle: Vehicle, seed: int, number: int, trips: str = 'free',
               methods: Sequence[str] = tuple(METHODS)) -> GapResult:
    """
    Return the GapResult of one drawn trip.

    `trips`: 'free' (no limit is active; solved without limits) or 'limits' (limits are active). `methods` are the
    names of the planning methods.
    """
    from bev_preheat.nonlinear_program.solve import solve_optimum, SolverFailure
    trip = DRAWS[trips](vehicle, seed, number)
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    limited = trips == 'limits'
    # The other methods are measured without the no-regret check, also when they are worse than not heating.
    plans = {method: plan_preheating(*inputs, method, no_regret=method == DEFAULT_METHOD)
             for method in methods}
    driven = {method: as_driven(plan, *inputs) if limited else plan
              for method, plan in plans.items()}
    optimum, outcome, detail = None, SOLVER_FAILED, ''
    try:
        optimum = solve_optimum(*inputs, limited)
        outcome, detail = _outcome(optimum)
    except SolverFailure as error:
        detail = str(error)
    best = optimum.plan if optimum else None
    return GapResult(
        number=number, outcome=outcome, detail=detail,
        duration_s=trip.route.total_duration_s,
        target_c=trip.goal.target_temperature_c,
        reserve_soc=trip.goal.minimum_arrival_soc,
        optimal_energy_wh=best.energy_wh.battery_total if best else None,
        optimal_arrival_c=best.arrival_temperature_c if best else None,
        optimal_arrival_soc=best.arrival_soc if best else None,
        solve_time_s=optimum.solve_time_s if optimum else None,
        methods={method: MethodResult(
            status=plans[method].status.name,
            arrival_temperature_c=plan.arrival_temperature_c,
            energy_wh=plan.energy_wh.battery_total,
            gap_wh=energy_gap_wh(plan, best) if best else None,
            difference=difference(plan, best) if best else '',
            arrival_soc=plan.arrival_soc,
            violation=_violation(trip, plan) if limited else 0.0,
            keeps_limits=plan is plans[method],
            planning_time_s=plans[method].planning_time_s) for method, plan in driven.items()})


def _violation(drawn: DrawnTrip, plan: Plan) -> float:
    """Return the largest excess over a power limit at the start or end of a step, as a share of the power."""
    trip = make_trip(drawn.vehicle, drawn.route)
    terminal_w = (trip.idle_power_w + plan.drawn_power_w + plan.friction_brake_power_w)
    limits = make_terminal_limits(drawn.vehicle, ARRAYS)
    (least_w, most_w), (least_end_w, most_end_w) = (
        limits(plan.soc[ends], plan.battery_temperature_c[ends], trip.power_variance_w2)
        for ends in (slice(-1), slice(1, None)))
    beyond_w = np.maximum(terminal_w - np.minimum(most_w, most_end_w),
                          np.maximum(least_w, least_end_w) - terminal_w)
    return max(0.0, float((beyond_w / np.maximum(np.abs(terminal_w), 1.0)).max()))


def _outcome(optimum: Optimum) -> tuple[str, str]:
    from bev_preheat.nonlinear_program.deficits import ARRIVAL_SOC, HIGHEST_TEMPERATURE, TARGET
    if optimum.deficit:
        deficit = {item.constraint for item in optimum.deficit} - {HIGHEST_TEMPERATURE}
        outcome = (BEYOND_RANGE if not deficit else UNREACHABLE if deficit == {TARGET} else
                   RESERVE_MISSED if deficit <= {TARGET, ARRIVAL_SOC} else POWER_LACKING)
        return outcome, '; '.join(optimum.infeasible)
    if optimum.plan.energy_wh.hvch_electric < NO_HEATING_WH:
        return NOT_NEEDED, ''
    return FEASIBLE, ''


# The statuses that agree with each outcome of the program. If only giving up the target can keep the reserve, the
# program calls the target unreachable.
EXPECTED = {
    NOT_NEEDED: (Status.NOT_NEEDED.name,),
    UNREACHABLE: (Status.TARGET_UNREACHABLE.name, Status.SOC_LIMITED.name),
    # An empty battery is also short of power.
    RESERVE_MISSED: (Status.SOC_LIMITED.name, Status.POWER_LIMITED.name,
                     Status.OUT_OF_CHARGE.name),
    POWER_LACKING: (Status.POWER_LIMITED.name, Status.OUT_OF_CHARGE.name),
    # Plans heat only within the range; above it, the car's cooling takes over.
    BEYOND_RANGE: (Status.NOT_NEEDED.name, Status.WAITING.name, Status.HEATING.name),
    FEASIBLE: (Status.WAITING.name, Status.HEATING.name),
}


def disagreements(results: Iterable[GapResult], method: str) -> list[GapResult]:
    """
    Return the results in which a method's status contradicts the program.

    A deficit below the methods' tolerance may be reported either way.
    """
    return [result for result in results if result.outcome in EXPECTED
            and result.methods[method].status not in EXPECTED[result.outcome]
            and not (result.outcome == UNREACHABLE and result.optimal_arrival_c is not None
                     and result.target_c - result.optimal_arrival_c < SHORTFALL_TOLERANCE_K)]


def result_of(vehicle: Vehicle, seed: int, trips: str, methods: Sequence[str], number: int) -> GapResult:
    """Return the GapResult of a drawn trip; see `solve_trip`."""
    return solve_trip(vehicle, seed, number, trips, methods)


def run_study(vehicle: Vehicle, feasible: int, seed: int, executor: Executor,
              report: Callable[[GapResult], object], trips: str = 'free',
              finished: Mapping[int, GapResult] | None = None,
              keep: Callable[[int, GapResult], object] | None = None,
              methods: Sequence[str] = tuple(METHODS)) -> list[GapResult]:
    """
    Run trips 0, 1, 2 … until `feasible` of them are feasible; return their GapResults in order.

    Infeasible trips in between are included. `report(result)` is called with each result once it and all
    earlier ones are finished, so that an interrupted study keeps its results. The trips do not depend on
    the executor; `finished` and `keep` are passed to `run_numbered`. Raises WorkerLost if a process dies.
    """
    results: list[GapResult] = []
    found = 0
    for result in run_numbered(executor, partial(result_of, vehicle, seed, trips, methods), count(), finished,
                               keep):
        results.append(result)
        found += result.outcome == FEASIBLE
        report(result)
        if found >= feasible:
            break
    return results


def result_from(record: dict[str, Any]) -> GapResult:
    """Return the GapResult of a dictionary made by `asdict`, read back from JSON."""
    return GapResult(**{**record, 'methods': {
        method: MethodResult(**own) for method, own in record['methods'].items()}})
