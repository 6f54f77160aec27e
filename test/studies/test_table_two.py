# SPDX-License-Identifier: Apache-2.0
"""Table II: the difference from the paper's, the origin of each cell, and the fit."""

from dataclasses import replace

import pytest

from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Leakage
from bev_preheat_studies import table_two
from bev_preheat_studies.table_two import fit_reference, reproduce

pytestmark = pytest.mark.needs('casadi')

# The paper's figures, copied from its Table II a second time [Wh]: heuristic, NLP.
PAPER = {
    'joule': (345.1, 361.4),
    'drivetrain_heat': (1504.0, 1504.0),
    'hvch_heat': (2038.9, 2019.2),
    'leakage': (-525.8, -526.1),
    'battery_total': (23889.0, 23888.0),
}


@pytest.fixture(scope='module')
def reproduction():
    return reproduce()


@pytest.fixture(scope='module')
def fit():
    """The fit, from a start that is off by some per cent in each number."""
    vehicle = load_vehicle('reference')
    battery = vehicle.battery
    start = replace(vehicle, battery=replace(
        battery, heat_capacity_j_per_k=1.06 * battery.heat_capacity_j_per_k,
        leakage=Leakage(0.91 * battery.leakage.gamma_0_w_per_k,
                        0.91 * battery.leakage.gamma_v_w_per_k_per_mps),
        resistance=replace(battery.resistance, k_ohm_k=1.04 * battery.resistance.k_ohm_k)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_two, 'load_vehicle', lambda name: start)
        return fit_reference()


def ours(reproduction, column, row):
    (cell,) = [cell for cell in reproduction.cells if (cell.column, cell.row) == (column, row)]
    return cell.ours


def test_paper_figures_are_those_of_the_paper(reproduction):
    assert {(cell.column, cell.row): cell.paper for cell in reproduction.cells
            if cell.unit == 'Wh'} == {
                (column, row): figures[at] for row, figures in PAPER.items()
                for at, column in enumerate(('heuristic', 'NLP'))}


def test_figures_of_ours_are_those_of_the_plans(reproduction):
    plans = {'heuristic': reproduction.heuristic, 'NLP': reproduction.optimum.plan}
    for cell in reproduction.cells:
        plan = plans[cell.column]
        assert cell.ours == (plan.arrival_time_s - plan.heating_start_s
                             if cell.row == 'heating lasts'
                             else vars(plan.energy_wh)[cell.row])


# The rows that the vehicle was fitted to, or the route made for, hold to what six digits of the
# vehicle file and a power of 0.1 W in the route file leave, far less than half a per cent.
@pytest.mark.parametrize('row', PAPER)
def test_heuristic_column_is_within_half_a_per_cent(reproduction, row):
    assert ours(reproduction, 'heuristic', row) == pytest.approx(PAPER[row][0], rel=5e-3)


# Predicted. The paper's two columns differ by 6 Wh in their parts and by 1 Wh in their totals, and
# the Joule heat of one is 4.7 % above that of the other for reasons that it does not give.
@pytest.mark.parametrize('row', [row for row in PAPER if row != 'battery_total'])
def test_program_column_is_within_five_per_cent(reproduction, row):
    assert ours(reproduction, 'NLP', row) == pytest.approx(PAPER[row][1], rel=0.05)


def test_program_costs_no_more_than_the_exact_heuristic(reproduction):
    gap_wh = (reproduction.optimal_switch.energy_wh.battery_total
              - reproduction.optimum.plan.energy_wh.battery_total)
    # The paper finds 1 Wh; both sides meet the same target with the same integrator here.
    assert -1e-3 < gap_wh < 1.0


@pytest.mark.parametrize('number', [
    'heat_capacity_j_per_k', 'gamma_0_w_per_k', 'gamma_v_w_per_k_per_mps', 'k_ohm_k'])
def test_fit_finds_the_numbers_of_the_vehicle_file(fit, number):
    battery = load_vehicle('reference').battery
    of_file = {**vars(battery), **vars(battery.leakage), **vars(battery.resistance)}
    # The file has six digits of heat capacity and leakage and five of the resistance.
    assert getattr(fit, number) == pytest.approx(of_file[number], rel=2e-5)
