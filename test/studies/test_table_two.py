# SPDX-License-Identifier: Apache-2.0
"""Table II: the difference from the paper's, and the fit."""

from dataclasses import replace

import pytest

from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Leakage
from bev_preheat_studies import table_two
from bev_preheat_studies.table_two import fit_reference, reproduce

pytestmark = pytest.mark.needs('casadi')

ROWS = ('joule', 'drivetrain_heat', 'hvch_heat', 'leakage', 'battery_total')


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


def test_figures_of_ours_are_those_of_the_plans(reproduction):
    plans = {'heuristic': reproduction.heuristic, 'NLP': reproduction.optimum.plan}
    for cell in reproduction.cells:
        plan = plans[cell.column]
        assert cell.ours == (plan.arrival_time_s - plan.heating_start_s
                             if cell.row == 'heating lasts'
                             else vars(plan.energy_wh)[cell.row])


@pytest.mark.parametrize('column, rows, most', [
    # The rows that the vehicle was fitted to, or the route made for, hold to what six digits of the vehicle file
    # and a power of 0.1 W in the route file leave, far less than half a per cent.
    ('heuristic', ROWS, 5e-3),
    # Predicted. The paper's two columns differ by 6 Wh in their parts and by 1 Wh in their totals, and the Joule
    # heat of one is 4.7 % above that of the other for reasons that it does not give.
    ('NLP', ROWS[:-1], 0.05)])
def test_figures_are_near_those_of_the_paper(reproduction, column, rows, most):
    cells = {cell.row: cell for cell in reproduction.cells if cell.column == column}
    for row in rows:
        assert cells[row].ours == pytest.approx(cells[row].paper, rel=most), row


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
