# SPDX-License-Identifier: Apache-2.0
"""`preheat compare`: every method and the nonlinear program side by side."""

import sys

from rich.console import Console

from bev_preheat.commands.optimum import add_no_limits_argument, optimum_lines
from bev_preheat.commands.output import (
    add_output_arguments, check_output_arguments, plan_table, write_json)
from bev_preheat.commands.situation import add_situation_arguments, read_situation
from bev_preheat.planning.planner import (
    as_driven, DEFAULT_METHOD, METHODS, plan_preheating)


def add_parser(subparsers):
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'compare', help='all methods and the nonlinear program side by side',
        description='Plans of all methods, the optimum, and what each costs more than it. A plan '
        'that breaks a power limit is shown as it would be driven: the friction brake takes what '
        'the battery may not, and the heater gives way.')
    add_situation_arguments(parser)
    add_no_limits_argument(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments):
    """Compare, print, and write what was asked for; returns 0, or 1 where the solver failed."""
    from bev_preheat.optimum.solve import SolverFailure, solve_optimum
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    inputs = situation.vehicle, situation.route, situation.state, situation.goal
    plans = [plan_preheating(*inputs, method, safeguarded=method == DEFAULT_METHOD)
             for method in METHODS]
    if not arguments.no_power_limits:
        plans = [as_driven(plan, *inputs) for plan in plans]
    console = Console()
    try:
        with console.status('solving …'):
            optimum = solve_optimum(*inputs, not arguments.no_power_limits)
    except SolverFailure as error:
        print(f'preheat: {error}', file=sys.stderr)
        return 1
    title = f'vehicle {situation.vehicle.name}, route {arguments.route}'
    best_wh = optimum.plan.energy_wh.battery_total
    gaps_wh = {plan.method: plan.energy_wh.battery_total - best_wh for plan in plans}
    table = plan_table([*plans, optimum.plan], title)
    table.add_row('More than the optimum (Wh)',
                  *(f'{gaps_wh[plan.method]:+.4f}' for plan in plans), '')
    table.add_row('Solve time (ms)', *('' for _ in plans), f'{1e3 * optimum.solve_time_s:.1f}')
    console.print(table)
    for line in optimum_lines(optimum):
        console.print(line, highlight=False, soft_wrap=True)
    if arguments.json:
        write_json(arguments.json, {
            'plans': {plan.method: plan.as_dictionary() for plan in plans},
            'optimum': optimum.as_dictionary(), 'gap_wh': gaps_wh})
    if arguments.plot:
        from bev_preheat.drawing.plan_figure import draw_plans
        draw_plans(arguments.plot, situation.vehicle, situation.route,
                   [*plans, optimum.plan], title)
    return 0
