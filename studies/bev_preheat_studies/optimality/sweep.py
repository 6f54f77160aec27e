# SPDX-License-Identifier: Apache-2.0
"""`preheat sweep`: the planning methods compared with the nonlinear program on random trips."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.commands.parser import completed_by
from bev_preheat.commands.situation import add_methods_argument
from bev_preheat.commands.terminal import print_figures
from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.optional_packages import require
from bev_preheat.planning.dynamics import limits_of_steps_w
from bev_preheat.planning.plan import energy_gap_wh
from bev_preheat.planning.planner import as_driven, DEFAULT_METHOD, METHODS, plan_preheating
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.tunables import HEATING_PRICE, SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat_studies.optimality.drawn_trips import DRAWS
from bev_preheat_studies.results_file import digest_of
from bev_preheat_studies.study import add_study_arguments, check_study_arguments, distribution, Study, text_of

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Sequence

    from rich.console import Console

    from bev_preheat.commands.parser import Subparsers
    from bev_preheat.planning.plan import Optimum, Plan
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_studies.optimality.drawn_trips import DrawnTrip

    # Plain values, as in JSON.
    Figures = dict[str, Any]

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
# Most disagreements printed for a method; the JSON has all.
MOST_LISTED = 10
PERCENTILES = {'median': 50.0, '95 %': 95.0, 'worst': 100.0}


@dataclass(frozen=True)
class MethodResult:
    """
    The result of one method on one trip, simulated within the limits.

    `gap_wh` is the energy above the program's, with the price of heating if the program has one; None if plan and
    program do not reach the same. `violation` is the
    largest excess over a power limit, as a share of the power; 0 without any. `keeps_limits`: the plan itself kept
    the limits.
    """

    status: str
    arrival_temperature_c: float
    gap_wh: float | None
    violation: float
    keeps_limits: bool


@dataclass(frozen=True)
class GapResult:
    """One trip: its data, the program's result, and each method's result."""

    number: int
    outcome: str
    detail: str
    duration_s: float
    target_c: float
    optimal_energy_wh: float | None
    optimal_arrival_c: float | None
    methods: dict[str, MethodResult]

    @property
    def is_feasible(self) -> bool:
        """Whether the program reaches target and reserve by heating."""
        return self.outcome == FEASIBLE


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'sweep', help='methods compared with the nonlinear program on random trips',
        description="Random trips: the distribution of each method's extra energy over the optimum of the "
        'nonlinear program, where the method reaches the same.')
    parser.add_argument('--feasible', type=int, default=300, metavar='N',
                        help='draw until N trips are feasible (default: %(default)s)')
    parser.add_argument('--trips', choices=tuple(DRAWS), default='free',
                        help="free: only the heater's limit is active; limits: descents, climbs, "
                        'tight reserves and a changing cabin demand (default: %(default)s)')
    parser.add_argument('--priced', action='store_true',
                        help=f'heating costs {HEATING_PRICE:.0%}% of its energy more, as in plans')
    add_methods_argument(parser, ', '.join(METHODS))
    completed_by('vehicles', parser.add_argument(
        '--vehicle', default='reference', metavar='NAME|FILE', help='vehicle to scale (default: %(default)s)'))
    add_study_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Run the study; returns 0. An interrupted study is summarised up to that point."""
    check_study_arguments(arguments, (vehicle_file(arguments.vehicle),), 'feasible')
    require('casadi')
    methods = tuple(dict.fromkeys(arguments.methods or METHODS))

    def show(console: Console, results: list[GapResult]) -> Figures:
        summary = summarise_gaps(results, methods)
        if arguments.plot:
            from bev_preheat.drawing.figure import save_figure
            from bev_preheat_studies.optimality.sweep_figure import make_sweep_figure
            save_figure(make_sweep_figure(results, methods), arguments.plot)
        print_summary(console, summary)
        return {'summary': summary}

    return sweep_study(load_vehicle(arguments.vehicle), arguments.feasible, arguments.seed, arguments.trips,
                       methods, HEATING_PRICE if arguments.priced else 0.0).conduct(arguments, show)


def sweep_study(vehicle: Vehicle, feasible: int, seed: int, trips: str,
                methods: Sequence[str], heating_price: float = 0.0) -> Study[GapResult]:
    """Return the Study that draws trips until `feasible` of them are; `trips` is a name of DRAWS."""
    task = partial(solve_trip, vehicle, seed, trips, methods, heating_price=heating_price)
    return Study(task, GapResult, feasible, {
        'study': 'sweep', 'seed': seed, 'trips': trips, 'vehicle': f'{vehicle.name} ({digest_of(vehicle)})',
        'methods': list(methods), 'heating_price': heating_price,
    }, lambda result: result.is_feasible, 'feasible trips')


def solve_trip(vehicle: Vehicle, seed: int, trips: str, methods: Sequence[str], number: int,
               heating_price: float = 0.0) -> GapResult:
    """
    Return the GapResult of one drawn trip; `trips` is a name of DRAWS: those of 'free' are without limits.

    `heating_price` is that of the program.
    """
    from bev_preheat.nonlinear_program.solve import solve_optimum, SolverFailure
    trip, limited = DRAWS[trips](vehicle, seed, number), trips == 'limits'
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    # The other methods are measured without the no-regret check, also when they are worse than not heating.
    plans = {method: plan_preheating(*inputs, method, no_regret=method == DEFAULT_METHOD)
             for method in methods}
    driven = {method: as_driven(plan, *inputs) if limited else plan for method, plan in plans.items()}
    best, outcome, detail = None, SOLVER_FAILED, ''
    try:
        optimum = solve_optimum(*inputs, limited, heating_price=heating_price)
        best, (outcome, detail) = optimum.plan, _outcome(optimum)
    except SolverFailure as error:
        detail = str(error)
    return GapResult(
        number, outcome, detail, trip.route.total_duration_s, trip.goal.target_temperature_c,
        best.energy_wh.battery_total if best else None, best.arrival_temperature_c if best else None,
        {method: MethodResult(
            plans[method].status.name, plan.arrival_temperature_c,
            _gap_wh(plan, best, heating_price) if best else None,
            _violation(trip, plan) if limited else 0.0, plan is plans[method]) for method, plan in driven.items()})


def _gap_wh(plan: Plan, best: Plan, heating_price: float) -> float | None:
    gap_wh = energy_gap_wh(plan, best)
    heating_wh = float((plan.drawn_power_w - best.drawn_power_w) @ np.diff(plan.time_s)) / JOULES_PER_WH
    return None if gap_wh is None else gap_wh + heating_price * heating_wh


def _violation(drawn: DrawnTrip, plan: Plan) -> float:
    """Return the largest excess over a power limit at the start or end of a step, as a share of the power."""
    trip = make_trip(drawn.vehicle, drawn.route)
    terminal_w = (trip.idle_power_w + plan.drawn_power_w + plan.friction_brake_power_w)
    least_w, most_w = limits_of_steps_w(trip.vehicle, plan.soc, plan.battery_temperature_c, trip.power_variance_w2)
    beyond_w = np.maximum(terminal_w - most_w, least_w - terminal_w)
    return max(0.0, float((beyond_w / np.maximum(np.abs(terminal_w), 1.0)).max()))


def _outcome(optimum: Optimum) -> tuple[str, str]:
    from bev_preheat.nonlinear_program.solve import ARRIVAL_SOC, HIGHEST_TEMPERATURE, TARGET
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
    RESERVE_MISSED: (Status.SOC_LIMITED.name, Status.POWER_LIMITED.name, Status.OUT_OF_CHARGE.name),
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


def summarise_gaps(results: Sequence[GapResult], methods: Iterable[str]) -> Figures:
    """Return the summary of GapResults as a dictionary of plain values."""
    feasible = [result for result in results if result.is_feasible]
    summary: Figures = {
        'trips': len(results), 'outcomes': dict(Counter(result.outcome for result in results)),
        'solver_failures': [{'number': result.number, 'detail': result.detail}
                            for result in results if result.outcome == SOLVER_FAILED], 'methods': {}}
    for method in methods:
        own = [result.methods[method] for result in feasible]
        compared = [(gap_wh, result.number) for result in feasible
                    if (gap_wh := result.methods[method].gap_wh) is not None]
        summary['methods'][method] = {
            # Trips on which the method reaches the same target and reserve as the program.
            'compared_trips': len(compared),
            'gap_wh': distribution((gap_wh for gap_wh, _ in compared), **PERCENTILES),
            'arrival_error_k': distribution((
                _arrival_error_k(result.methods[method].arrival_temperature_c, result.target_c,
                                 result.optimal_arrival_c)
                for result in feasible if result.optimal_arrival_c is not None), **PERCENTILES),
            'violation': distribution((result.violation for result in own), **PERCENTILES),
            'plans_that_break_limits': sum(not result.keeps_limits for result in own),
            'disagreements': [
                {'number': result.number, 'outcome': result.outcome, 'status': result.methods[method].status}
                for result in disagreements(results, method)],
            'worst_trip': max(compared, key=itemgetter(0))[1] if compared else None}
    return summary


def _arrival_error_k(arrival_c: float, target_c: float, optimal_arrival_c: float) -> float:
    """Return the distance of an arrival from the interval between target and the program's arrival [K]."""
    # If heat pays for itself, the program may end above the target.
    return max(target_c - arrival_c, arrival_c - max(target_c, optimal_arrival_c), 0.0)


def print_summary(console: Console, summary: Figures) -> None:
    """Print the tables of a summary."""
    outcomes = ', '.join(f'{count} {name}' for name, count in summary['outcomes'].items())
    console.print(f'{summary["trips"]} trips: {outcomes}', soft_wrap=True)
    print_figures(console, 'Compared with the nonlinear program, on the feasible trips', ('', *PERCENTILES), [
        (f'{method}: {heading}', *(text_of(figures[key].get(name), '.4g', factor) for name in PERCENTILES))
        for method, figures in summary['methods'].items()
        for heading, key, factor in (
            ('energy gap (Wh)', 'gap_wh', 1.0), ('arrival error (K)', 'arrival_error_k', 1.0),
            ('limit broken by (%)', 'violation', 100.0))])
    feasible = summary['outcomes'].get(FEASIBLE, 0)
    for method, figures in summary['methods'].items():
        others = feasible - figures['compared_trips']
        console.print(
            f'{method}: worst gap in trip {figures["worst_trip"]}; ' +
            (f'{others} trips have no gap, as the method does not reach the same as the program '
             f'(to {SHORTFALL_TOLERANCE_K:g} K); ' if others else '') +
            f'{figures["plans_that_break_limits"]} plans break a limit and are shown as driven '
            f'within it; {len(figures["disagreements"])} trips in which its status contradicts '
            'the program', soft_wrap=True)
        for item in figures['disagreements'][:MOST_LISTED]:
            console.print(f'  trip {item["number"]}: the program says {item["outcome"]}, '
                          f'{method} says {item["status"]}', soft_wrap=True)
    for failure in summary['solver_failures']:
        console.print(f'solver failed on trip {failure["number"]}: {failure["detail"]}',
                      markup=False, soft_wrap=True)
