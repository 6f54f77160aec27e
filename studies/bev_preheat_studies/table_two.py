# SPDX-License-Identifier: Apache-2.0
"""
`preheat reproduce`, Table II of the paper: its figures, ours, and the fit of what Table I leaves out.

The heat capacity, the leakage and the resistance of the reference vehicle are not in the paper.
They are fitted to three cells of the heuristic column; the route is made so that the drivetrain's
heat and the column's sum hold. Everything else is predicted.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_results
from bev_preheat.commands.terminal import print_records, progress_console
from bev_preheat.optional_packages import require
from bev_preheat.planning.plan import difference, energy_gap_wh
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route, route_file
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat.vehicle.curves import InverseTemperatureResistance
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from argparse import Namespace

    from matplotlib.figure import Figure
    from rich.console import Console

    from bev_preheat.commands.parser import Subparsers
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.plan import Optimum, Plan
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

# Table I.
STATE = BatteryState(temperature_c=-7.0, soc=0.9)
GOAL = Goal(target_temperature_c=25.0)
TERMINAL_SOC = 0.6
HEATING_BEFORE_ARRIVAL_S = 28 * 60.0

# Table II [Wh]: field of Energies, heuristic column, NLP column.
TABLE_II = (
    ('joule', 345.1, 361.4),
    ('drivetrain_heat', 1504.0, 1504.0),
    ('hvch_heat', 2038.9, 2019.2),
    ('leakage', -525.8, -526.1),
    ('battery_total', 23889.0, 23888.0),
)
# Cells that are not predicted. The route's integrals of the propulsion power were chosen so that the
# drivetrain's heat and the sum of the heuristic column hold.
ORIGINS = {
    ('heuristic', 'joule'): 'fitted',
    ('heuristic', 'hvch_heat'): 'fitted',
    ('heuristic', 'heating lasts'): 'fitted',
    ('heuristic', 'leakage'): 'fitted',
    ('heuristic', 'drivetrain_heat'): 'by route',
    ('NLP', 'drivetrain_heat'): 'by route',
    ('heuristic', 'battery_total'): 'by route',
}


@dataclass(frozen=True)
class Cell:
    """One figure of the paper beside ours; its `origin`: 'fitted', 'by route' (made to hold) or 'predicted'."""

    column: str
    row: str
    unit: str
    paper: float
    ours: float
    origin: str

    @property
    def difference_percent(self) -> float:
        """Ours above the paper's [%]."""
        return 100.0 * (self.ours - self.paper) / abs(self.paper)


@dataclass(frozen=True)
class Reproduction:
    """Every cell, and the plans they were read off."""

    cells: tuple[Cell, ...]
    heuristic: Plan
    optimal_switch: Plan
    optimum: Optimum

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {'cells': [asdict(cell) for cell in self.cells], 'heuristic': self.heuristic.as_dictionary(),
                'optimal_switch': self.optimal_switch.as_dictionary(), 'optimum': self.optimum.as_dictionary()}

    def figure(self) -> Figure:
        """Return both plans as a figure like the paper's Figure 6."""
        from bev_preheat.drawing.plan_figure import make_plan_figure
        vehicle = load_vehicle('reference')
        return make_plan_figure(vehicle, load_route('reference', vehicle.defaults), GOAL, [
            self.heuristic, self.optimum.plan], "the paper's Figure 6", every_panel=True)


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'reproduce', help="the paper's Table II beside ours",
        description='Table II of the paper, ours, and the difference of each cell; names the cells '
        'to which the reference vehicle was fitted, and the predicted ones.')
    parser.add_argument('--fit', action='store_true', help='repeat the fit and print its parameters')
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Reproduce, print, and write the requested files; returns 0."""
    check_output_arguments(arguments, (vehicle_file('reference'), route_file('reference')))
    require('casadi', *(['scipy'] if arguments.fit else []))
    with progress_console().status('solving …'):
        result = reproduce()
    console = write_results(arguments, result.as_dictionary, result.figure)
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
    print_records(console, 'Table II', ('', 'row', 'paper', 'ours', 'diff.', 'diff. (%)', 'cell was'), rows,
                  ('left', 'left', *['right'] * 5))
    best = result.optimum.plan
    for name, plan in (('paper, soc_f = 0.6', result.heuristic), ('optimal_switch', result.optimal_switch)):
        gap_wh = energy_gap_wh(plan, best)
        against = f'{gap_wh:+.4f} Wh' if gap_wh is not None else difference(plan, best)
        console.print(f'{name}: {against} compared with the NLP, arrives at '
                      f'{plan.arrival_temperature_c:.3f} degC', markup=False, soft_wrap=True)


def reproduce(vehicle: Vehicle | None = None) -> Reproduction:
    """Return the Reproduction, with the reference vehicle or another one."""
    from bev_preheat.nonlinear_program.solve import solve_optimum
    vehicle = vehicle or load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    heuristic = _heuristic(vehicle, route)
    optimal_switch = plan_preheating(vehicle, route, STATE, GOAL, 'optimal_switch')
    optimum = solve_optimum(vehicle, route, STATE, GOAL)
    cells = []
    for column, plan, which in (('heuristic', heuristic, 0), ('NLP', optimum.plan, 1)):
        for row, *papers_wh in TABLE_II:
            cells.append(Cell(column, row, 'Wh', papers_wh[which], getattr(plan.energy_wh, row),
                              ORIGINS.get((column, row), 'predicted')))
        cells.append(Cell(column, 'heating lasts', 's', HEATING_BEFORE_ARRIVAL_S, _heated_s(plan),
                          ORIGINS.get((column, 'heating lasts'), 'predicted')))
    return Reproduction(tuple(cells), heuristic, optimal_switch, optimum)


def _heuristic(vehicle: Vehicle, route: Route) -> Plan:
    return plan_preheating(vehicle, route, STATE, GOAL, 'paper', no_regret=False, terminal_soc=TERMINAL_SOC)


def _heated_s(plan: Plan) -> float:
    """Return how long before arrival a Plan that heats begins to [s]."""
    assert plan.heating_start_s is not None
    return plan.arrival_time_s - plan.heating_start_s


@dataclass(frozen=True)
class Fit:
    """The result of the fit; `message` is the root finder's, None after success."""

    heat_capacity_j_per_k: float
    gamma_0_w_per_k: float
    gamma_v_w_per_k_per_mps: float
    k_ohm_k: float
    message: str | None


def fit_reference() -> Fit:
    """
    Return the Fit of heat capacity, leakage and resistance to the heuristic column.

    Three unknowns for three cells: 28 min of heating (which is the HVCH row), Joule heat, leakage.
    The ratio of the two leakage coefficients and the reference temperature of the resistance are
    assumed; the cells say nothing about them.
    """
    from scipy.optimize import root
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    resistance = vehicle.battery.resistance
    if not isinstance(resistance, InverseTemperatureResistance):
        raise TypeError('only a vehicle whose resistance is a formula can be fitted')
    wanted = {row: heuristic for row, heuristic, _ in TABLE_II}

    def misses(factors: FloatArray) -> list[float]:
        plan = _heuristic(corrected_vehicle(vehicle, Corrections(*factors)), route)
        return [_heated_s(plan) - HEATING_BEFORE_ARRIVAL_S, plan.energy_wh.joule - wanted['joule'],
                plan.energy_wh.leakage - wanted['leakage']]

    found = root(misses, np.ones(3), options={'eps': 1e-5})
    fitted = corrected_vehicle(vehicle, Corrections(*found.x)).battery
    return Fit(fitted.heat_capacity_j_per_k, fitted.leakage.gamma_0_w_per_k,
               fitted.leakage.gamma_v_w_per_k_per_mps, resistance.k_ohm_k * found.x[2],
               None if found.success else found.message)
