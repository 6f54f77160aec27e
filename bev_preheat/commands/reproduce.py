# SPDX-License-Identifier: Apache-2.0
"""`preheat reproduce`: the paper's Table II beside ours."""

from dataclasses import asdict

from rich.console import Console
from rich.table import Table

from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_json
from bev_preheat.route import load_route, route_file
from bev_preheat.vehicle import load_vehicle, vehicle_file


def add_parser(subparsers):
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'reproduce', help="the paper's Table II beside ours",
        description="Table II of the paper, ours, and the difference of each cell; which cells "
        'the reference vehicle was fitted to, and which are predicted.')
    parser.add_argument('--fit', action='store_true',
                        help='make the fit again and print the parameters it finds')
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments):
    """Reproduce, print, and write what was asked for; returns 0."""
    check_output_arguments(arguments, (vehicle_file('reference'), route_file('reference')))
    from bev_preheat.reproduction.table_two import fit_reference, reproduce
    console = Console()
    result = reproduce()
    table = Table(title='Table II')
    for heading in ('', 'row', 'paper', 'ours', 'diff.', 'diff. (%)', 'cell was'):
        table.add_column(heading, justify='left' if heading in ('', 'row') else 'right')
    column = None
    for cell in result.cells:
        table.add_row(cell.column if cell.column != column else '', f'{cell.row} ({cell.unit})',
                      f'{cell.paper:.1f}', f'{cell.ours:.1f}', f'{cell.ours - cell.paper:+.1f}',
                      f'{cell.difference_percent:+.2f}', cell.origin)
        column = cell.column
    console.print(table)
    best_wh = result.optimum.plan.energy_wh.battery_total
    for name, plan in (('paper, soc_f = 0.6', result.heuristic),
                       ('optimal_switch', result.optimal_switch)):
        console.print(f'{name}: {plan.energy_wh.battery_total - best_wh:+.4f} Wh against the NLP, '
                      f'arrives at {plan.arrival_temperature_c:.3f} degC', highlight=False)
    if arguments.fit:
        fit = fit_reference()
        console.print(f'fit: {fit.message or "converged"}', highlight=False)
        for name, value in asdict(fit).items():
            if name != 'message':
                console.print(f'  {name}: {value:.6g}', highlight=False)
    if arguments.json:
        write_json(arguments.json, {
            'cells': [asdict(cell) for cell in result.cells],
            'heuristic': result.heuristic.as_dictionary(),
            'optimal_switch': result.optimal_switch.as_dictionary(),
            'optimum': result.optimum.as_dictionary()})
    if arguments.plot:
        from bev_preheat.drawing.plan_figure import draw_plans
        vehicle = load_vehicle('reference')
        draw_plans(arguments.plot, vehicle, load_route('reference', vehicle.defaults),
                   [result.heuristic, result.optimum.plan], "the paper's Figure 6")
    return 0
