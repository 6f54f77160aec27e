# SPDX-License-Identifier: Apache-2.0
"""`preheat compare`: every method and the nonlinear program side by side."""

from __future__ import annotations

from argparse import Namespace

from bev_preheat.commands.optimum import add_no_limits_argument, optimum_lines, solved
from bev_preheat.commands.output import add_output_arguments, check_output_arguments, print_plans, write_results
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.program import FAILED
from bev_preheat.commands.situation import add_methods_argument, add_situation_arguments, read_situation, warn
from bev_preheat.commands.terminal import print_records
from bev_preheat.optional_packages import require
from bev_preheat.planning.maker_rules import MAKER_RULES, plan_by_rule
from bev_preheat.planning.plan import difference, energy_gap_wh
from bev_preheat.planning.planner import (
    as_driven,
    DEFAULT_METHOD,
    method_names,
    plan_preheating,
    refused_methods,
)
from bev_preheat.planning.sensitivity import find_sensitivity
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'compare', help='all methods and the nonlinear program side by side',
        description='Plans of all methods, the optimum, and the extra energy of each plan that reaches the same '
        f'(arrival temperature to {SHORTFALL_TOLERANCE_K:g} K); otherwise the difference. A plan beyond a power '
        'limit is shown as executed: the friction brake takes the rest, and the heater power is reduced.')
    add_situation_arguments(parser)
    add_methods_argument(parser, 'all')
    add_no_limits_argument(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Compare, print, and write the requested files; returns 0, or 1 if the solver failed."""
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    require('casadi')
    inputs = situation.inputs
    if arguments.methods is None:
        warn(*(f'method {problem}' for problem in refused_methods()))
    plans = [plan_preheating(*inputs, method, no_regret=method == DEFAULT_METHOD)
             for method in dict.fromkeys(arguments.methods or method_names())]
    if not arguments.no_power_limits:
        plans = [as_driven(plan, *inputs) for plan in plans]
    optimum = solved(situation, arguments)
    if optimum is None:
        return FAILED
    sensitivity = find_sensitivity(*inputs, plan_preheating(*inputs))
    rules = {name: plan_by_rule(name, *inputs) for name in MAKER_RULES}
    best = optimum.plan
    gaps_wh = {plan.method: energy_gap_wh(plan, best) for plan in plans}
    differences = {plan.method: difference(plan, best) for plan in plans}
    console = write_results(arguments, lambda: {
        'plans': {plan.method: plan.as_dictionary() for plan in plans},
        'maker_rules': {name: plan.as_dictionary() for name, plan in rules.items()},
        'optimum': optimum.as_dictionary(), 'gap_wh': gaps_wh,
        'difference': {method: text or None for method, text in differences.items()},
        'sensitivity': sensitivity and sensitivity.as_dictionary(), **situation.as_dictionary()},
        lambda: situation.figure([*plans, best]))
    rows = [('Solve time [ms]', *('' for _ in plans), f'{1e3 * optimum.solve_time_s:.1f}')]
    if any(differences.values()):
        rows.insert(0, ('Differs from optimum', *differences.values(), ''))
    if any(gap_wh is not None for gap_wh in gaps_wh.values()):
        rows.insert(0, ('Above optimum [Wh]', *(
            '–' if gap_wh is None else f'{gap_wh:+.4f}' for gap_wh in gaps_wh.values()), ''))
    print_plans(console, [*plans, best], situation.title, more_rows=rows)
    print_records(
        console, "Makers' rules",
        ('heater on', 'arrival [degC]', 'SoC [%]', 'heater [Wh]', 'battery [Wh]', 'status'),
        [(name, f'{plan.arrival_temperature_c:.2f}', f'{100.0 * plan.arrival_soc:.2f}',
          f'{plan.energy_wh.hvch_electric:.0f}', f'{plan.energy_wh.battery_total:.0f}', plan.status.name)
         for name, plan in rules.items()], ('left', *('right',) * 4, 'left'))
    console.say(*optimum_lines(optimum))
    if sensitivity is not None:
        console.say(f'{DEFAULT_METHOD}: {sensitivity.in_words()}')
    return 0
