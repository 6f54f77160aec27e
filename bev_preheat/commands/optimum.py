# SPDX-License-Identifier: Apache-2.0
"""`preheat optimum`: the solution of the nonlinear program for a route."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from bev_preheat.commands.output import add_output_arguments, check_output_arguments, print_plans, write_results
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.program import FAILED, say
from bev_preheat.commands.situation import add_situation_arguments, PlanningArguments, read_situation, warn
from bev_preheat.commands.terminal import progress_console
from bev_preheat.optional_packages import require
from bev_preheat.planning.plan import Optimum
from bev_preheat.planning.planner import DEFAULT_METHOD


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'optimum', help='solve the nonlinear program for a route',
        description='The optimum of problem (9) for this route, by IPOPT.')
    add_situation_arguments(parser)
    add_no_limits_argument(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def add_no_limits_argument(parser: ArgumentParser) -> None:
    """Add `--no-power-limits`."""
    parser.add_argument('--no-power-limits', action='store_true',
                        help="leave out the battery's charge and discharge limits (9i)")


def run(arguments: Namespace) -> int:
    """Solve, print, and write the requested files; returns 0, or 1 if the solver failed."""
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    require('casadi')
    optimum = solved(situation, arguments)
    if optimum is None:
        return FAILED
    console = write_results(arguments, lambda: {**optimum.as_dictionary(), **situation.as_dictionary()},
                            lambda: situation.figure([optimum.plan]))
    print_plans(console, [optimum.plan], situation.title)
    console.say(*optimum_lines(optimum))
    return 0


def solved(situation: PlanningArguments, arguments: Namespace) -> Optimum | None:
    """Return the Optimum; say why, and return None, if the solver failed."""
    from bev_preheat.nonlinear_program.solve import solve_optimum, SolverFailure
    if situation.inputs[0].heating_gates.looks_at_battery:
        warn(f"heating_gates: the optimum, makers' rules and all methods but {DEFAULT_METHOD} heat regardless of "
             'minimum_soc and maximum_temperature_c')
    try:
        with progress_console().status('solving …'):
            return solve_optimum(*situation.inputs, not arguments.no_power_limits)
    except SolverFailure as error:
        say(f'preheat: {error}')
        return None


def optimum_lines(optimum: Optimum) -> list[str]:
    """Return the solver's result, as lines of text."""
    lines = [f'{optimum.plan.status.name}: {optimum.plan.explanation}',
             f'Solver: {optimum.solver_status}, {optimum.iterations} iterations, '
             f'{1e3 * optimum.solve_time_s:.0f} ms.']
    if optimum.infeasible:
        lines.append(f'Infeasible; best possible result: {"; ".join(optimum.infeasible)}.')
    elif optimum.marginal_cost_wh_per_k == optimum.marginal_cost_wh_per_k:
        lines.append(f'One more kelvin on arrival would cost {optimum.marginal_cost_wh_per_k:.1f} Wh.')
    return lines
