# SPDX-License-Identifier: Apache-2.0
"""`preheat reproduce`: the paper's Table II beside ours."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from bev_preheat.console.output import add_output_arguments, check_output_arguments, write_json
from bev_preheat.console.terminal import print_records, progress_console, result_console
from bev_preheat.optional_packages import require
from bev_preheat.planning.comparison import difference, energy_gap_wh
from bev_preheat.route import load_route, route_file
from bev_preheat.vehicle import load_vehicle, vehicle_file

if TYPE_CHECKING:
    from argparse import Namespace

    from rich.console import Console

    from bev_preheat.commands.arguments import Subparsers
    from bev_preheat_studies.reproduction.table_two import Reproduction


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'reproduce', help="the paper's Table II beside ours",
        description='Table II of the paper, ours, and the difference of each cell; names the cells '
        'to which the reference vehicle was fitted, and the predicted ones.')
    parser.add_argument('--fit', action='store_true',
                        help='repeat the fit and print its parameters')
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Reproduce, print, and write the requested files; returns 0."""
    check_output_arguments(arguments, (vehicle_file('reference'), route_file('reference')))
    require('casadi', *(['scipy'] if arguments.fit else []))
    from bev_preheat_studies.reproduction.table_two import fit_reference, GOAL, reproduce
    with progress_console().status('solving …'):
        result = reproduce()
    if arguments.json:
        write_json(arguments.json, {
            'cells': [asdict(cell) for cell in result.cells],
            'heuristic': result.heuristic.as_dictionary(),
            'optimal_switch': result.optimal_switch.as_dictionary(),
            'optimum': result.optimum.as_dictionary()})
    if arguments.plot:
        from bev_preheat.drawing.plan_figure import draw_plans
        vehicle = load_vehicle('reference')
        draw_plans(arguments.plot, vehicle, load_route('reference', vehicle.defaults), GOAL,
                   [result.heuristic, result.optimum.plan], "the paper's Figure 6", every_panel=True)
    console = result_console(arguments.json)
    print_result(console, result)
    if arguments.fit:
        with progress_console().status('fitting …'):
            fit = fit_reference()
        console.print(f'fit: {fit.message or "converged"}', markup=False)
        for name, value in asdict(fit).items():
            if name != 'message':
                console.print(f'  {name}: {value:.6g}')
    return 0


def print_result(console: Console, result: Reproduction) -> None:
    """Print a Reproduction."""
    rows, column = [], None
    for cell in result.cells:
        rows.append((cell.column if cell.column != column else '', f'{cell.row} ({cell.unit})',
                     f'{cell.paper:.1f}', f'{cell.ours:.1f}', f'{cell.ours - cell.paper:+.1f}',
                     f'{cell.difference_percent:+.2f}', cell.origin))
        column = cell.column
    print_records(console, 'Table II',
                  ('', 'row', 'paper', 'ours', 'diff.', 'diff. (%)', 'cell was'), rows,
                  ('left', 'left', *['right'] * 5))
    best = result.optimum.plan
    for name, plan in (('paper, soc_f = 0.6', result.heuristic),
                       ('optimal_switch', result.optimal_switch)):
        gap_wh = energy_gap_wh(plan, best)
        against = f'{gap_wh:+.4f} Wh' if gap_wh is not None else difference(plan, best)
        console.print(f'{name}: {against} compared with the NLP, arrives at '
                      f'{plan.arrival_temperature_c:.3f} degC', markup=False, soft_wrap=True)
