# SPDX-License-Identifier: Apache-2.0
"""Plans against programs and searches on drawn trips: the trips, the gaps, and their figures."""

from dataclasses import replace
import json

import pytest

from bev_preheat.charging.stop import ChargingProspect
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.nonlinear_program import solve
from bev_preheat.nonlinear_program.solve import ARRIVAL_SOC, DISCHARGE_POWER, HIGHEST_TEMPERATURE, TARGET
from bev_preheat.planning.plan import StepDeficit
from bev_preheat.planning.situation import BatteryState
from bev_preheat.tunables import HEATING_PRICE
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.__main__ import main
from bev_preheat_studies.optimality import (
    arrival_range,
    best_target,
    heat_sources,
    summer,
    sweep,
    uncertain_charging,
)
from bev_preheat_studies.optimality.best_target import compare_trip, WorthGap
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip
from bev_preheat_studies.optimality.sweep import disagreements, FEASIBLE, GapResult, MethodResult, solve_trip
from bev_preheat_studies.optimality.sweep_figure import make_sweep_figure
from bev_preheat_studies.optimality.uncertain_charging import compare, Gap

VEHICLE = load_vehicle('reference')


def test_drives_to_a_charger_are_of_all_kinds():
    trips = [draw_charging_trip(1, number) for number in range(60)]
    assert trips[7].stop == draw_charging_trip(1, 7).stop != trips[8].stop
    assert len({trip.vehicle.name for trip in trips}) == 5
    for is_of_a_kind in (
            lambda trip: trip.route.propulsion_power_w.min() < 0.0,
            lambda trip: not trip.vehicle.charging.battery_heating,
            lambda trip: not trip.vehicle.heat_path.is_direct,
            lambda trip: trip.prices.time_per_h == 0.0,
            lambda trip: trip.stop.charger_power_w < 60e3,
            lambda trip: trip.stop.ambient_c < -20.0):
        assert 0 < sum(map(is_of_a_kind, trips)) < 60


# --- Methods against the nonlinear program ---

@pytest.mark.costly
@pytest.mark.needs('casadi')
@pytest.mark.parametrize('deficit, outcome', [
    ((TARGET,), sweep.UNREACHABLE), ((TARGET, ARRIVAL_SOC), sweep.RESERVE_MISSED),
    ((TARGET, DISCHARGE_POWER), sweep.POWER_LACKING), ((HIGHEST_TEMPERATURE,), sweep.BEYOND_RANGE)])
def test_the_deficit_of_the_program_is_the_outcome(monkeypatch, deficit, outcome):
    solve_optimum = solve.solve_optimum
    missed = tuple(StepDeficit(constraint, 0.25, 'K', 'missed') for constraint in deficit)
    monkeypatch.setattr(solve, 'solve_optimum', lambda *arguments, **named: replace(
        solve_optimum(*arguments, **named), deficit=missed))
    result = solve_trip(VEHICLE, 7, 'free', ('value_function',), 0)
    assert (result.outcome, result.detail.count('missed')) == (outcome, len(deficit))


# A day's test of the priced program: test_a_price_of_heating_leaves_surplus_to_the_brake_that_saves_less.
@pytest.mark.deep
@pytest.mark.costly
@pytest.mark.needs('casadi')
def test_heat_pumps_lose_energy_to_a_program_without_the_price_of_heating_alone():
    vehicle, method = load_vehicle('heat_pump_car'), 'value_function'
    free_wh, priced_wh = (solve_trip(vehicle, 1, 'limits', (method,), 9, price).methods[method].gap_wh
                          for price in (0.0, HEATING_PRICE))
    assert abs(priced_wh) < 0.05 < 3.0 < free_wh


def made(number, outcome=FEASIBLE, gap_wh=0.5, status='WAITING', arrival_c=17.0, violation=0.0):
    return GapResult(number, outcome, '', 1800.0 + number, 17.0, 5000.0, 12.0, {
        'one': MethodResult(status, arrival_c, gap_wh, violation, violation == 0.0)})


@pytest.mark.parametrize('outcome, status, agrees', [
    (FEASIBLE, 'WAITING', True), (FEASIBLE, 'NOT_NEEDED', False), (FEASIBLE, 'TARGET_UNREACHABLE', False),
    (sweep.NOT_NEEDED, 'WAITING', False), (sweep.UNREACHABLE, 'TARGET_UNREACHABLE', True),
    (sweep.UNREACHABLE, 'WAITING', False), (sweep.BEYOND_RANGE, 'WAITING', True),
    (sweep.SOLVER_FAILED, 'WAITING', True)])
def test_what_contradicts_the_program(outcome, status, agrees):
    assert (disagreements([made(5, outcome, status=status)], 'one') == []) is agrees


def test_figures_of_a_sweep():
    results = [made(0, gap_wh=1.0), made(1, gap_wh=3.0, violation=0.02), made(2, gap_wh=None, arrival_c=16.0),
               made(3, sweep.UNREACHABLE, gap_wh=99.0), made(4, sweep.SOLVER_FAILED, gap_wh=None)]
    summary = sweep.summarise_gaps(results, ['one'])
    figures = summary['methods']['one']
    assert summary['outcomes'] == {FEASIBLE: 3, sweep.UNREACHABLE: 1, sweep.SOLVER_FAILED: 1}
    assert figures['compared_trips'] == 2 and figures['worst_trip'] == 1
    assert figures['gap_wh'] == pytest.approx({'median': 2.0, '95 %': 2.9, 'worst': 3.0})
    assert figures['arrival_error_k']['worst'] == 1.0
    assert (figures['violation']['worst'], figures['plans_that_break_limits']) == (0.02, 1)
    assert sweep.summarise_gaps(results[3:], ['one'])['methods']['one']['gap_wh'] == {}
    shares, over_length = make_sweep_figure(results, ['one']).axes
    line = shares.get_lines()[0]
    assert line.get_xydata().tolist() == [[1.0, 0.0], [1.0, pytest.approx(100 / 3)], [3.0, pytest.approx(200 / 3)]]
    assert line.get_label() == 'one, not comparable on 1'
    assert list(over_length.get_lines()[0].get_ydata()) == [1.0, 3.0]


# --- The best target ---

@pytest.mark.costly
@pytest.mark.needs('casadi')
# With a heat path.
@pytest.mark.parametrize('number', [98, pytest.param(76, marks=pytest.mark.deep)])
def test_the_best_target_is_as_good_as_the_joint_program(number):
    result = compare_trip(1, number)
    assert result.outcome == best_target.COMPARED and result.is_heated
    assert abs(result.gap) < 1e-4


def test_figures_of_best_targets():
    def gap(number, cost, program_cost, blind, **changes):
        return WorthGap(number, best_target.COMPARED, '', 'car', **{
            'has_heat_path': False, 'cools': False, 'is_heated': True, **changes}, cost=cost,
            program_cost=program_cost, blind_cost=blind, calls=4, failed=1)

    results = [gap(0, 10.01, 10.0, 10.0), gap(1, 20.0, 20.0, 20.0, is_heated=False),
               gap(2, 30.3, 30.0, 30.6, has_heat_path=True),
               WorthGap(3, best_target.NEVER_CHARGED, 'why', 'car', False, False)]
    figures = best_target.summarise(results)
    assert (figures['trips'], figures['heated'], figures['calls'], figures['failed_calls']) == (4, 2, 12, 3)
    gaps = figures['gaps']
    assert gaps['all trips'] == pytest.approx({'least': 0.0, 'median': 1e-3, '95 %': 9.1e-3, 'worst': 1e-2})
    assert gaps['heated, heat arrives at once']['worst'] == pytest.approx(1e-3)
    assert gaps['… program not started from the best target']['least'] == pytest.approx(-0.3 / 30.6)
    assert gaps['the car cools at the charger'] == {}


# --- Uncertain charging ---

@pytest.mark.costly
@pytest.mark.parametrize('number', [
    pytest.param(10, id='even chance'), pytest.param(2, id='with a heat path', marks=pytest.mark.deep)])
def test_the_best_target_costs_no_more_than_the_search_finds(number):
    gap = compare(1, number)
    assert gap.outcome == uncertain_charging.COMPARED
    # Heating pays on these drives.
    assert gap.cost < gap.unheated_cost * 0.98
    assert gap.gap <= 1e-3


def test_figures_of_uncertain_charging():
    gaps = [Gap(0, uncertain_charging.COMPARED, '', ChargingProspect(0.5), False, 10.1, 10.0, 12.0, 10.1),
            Gap(1, uncertain_charging.COMPARED, '', ChargingProspect(0.5, 60.0), True, 9.0, 9.0, 9.5, 10.0),
            Gap(2, uncertain_charging.NOT_DRIVEN, 'why', ChargingProspect())]
    figures = uncertain_charging.summarise(gaps)
    assert (figures['drives'], figures['compared']) == (3, 2)
    assert figures['gaps']['arrival time exact']['worst'] == pytest.approx(0.01)
    assert figures['gaps']['with a heat path'] == pytest.approx(
        {'drives': 1, 'least': 0.0, 'median': 0.0, '95 %': 0.0, 'worst': 0.0})
    assert figures['saved'] == pytest.approx({'mean': 0.05, 'most': 0.1})


# --- The best target within a range against a scan of starts.

@pytest.mark.costly
def test_a_target_within_a_range_scores_no_less_than_the_best_start_of_a_scan(tmp_path):
    car = configuration_folder('vehicles') / 'crossover_800v.yaml'
    (tmp_path / arrival_range.CAR).write_text(car.read_text())
    (tmp_path / 'way.csv').write_text('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n'
                                      '900,20,15000,-2\n1300,25,20000,-3\n400,12,9000,-2\n')
    task = arrival_range.Task(tmp_path, (12.0, 18.0), 0.1, 0.8, (30.0, 20.0), BatteryState(1.0, 0.7), 1)
    cheap = arrival_range.solve(task, 0)
    assert (cheap.left_out, cheap.route) == ('', 'way.csv')
    assert cheap.points > cheap.scan_points - 0.002 and cheap.arrival_c == pytest.approx(12.0, abs=0.01)
    (tmp_path / arrival_range.TIMES).write_text('arrival_soc,arrival_temperature_c,charging_time_s\n' + ''.join(
        f'{soc},{at_c},{time_s}\n' for soc in (0, 1) for at_c, time_s in ((0, 2000), (14, 1900), (15, 900))))
    warm = arrival_range.solve(task, 0)
    assert warm.points > warm.scan_points - 0.002 and warm.arrival_c == pytest.approx(15.0, abs=0.06)
    assert arrival_range.summarise([cheap, warm, arrival_range.RangeResult(2, 'drawn 1', 'arrives warm')]) == {
        'routes': 3, 'solved': 2, 'not_worse': 2, 'above_scan': {
            'least': min(above := [each.points - each.scan_points for each in (cheap, warm)]),
            'median': pytest.approx(sum(above) / 2), 'most': max(above)}}


# --- Energy that further heat sources save.

def test_a_heat_pump_saves_more_in_warmer_air_and_a_car_that_differs_arrives(tmp_path):
    picture, file = tmp_path / 'saved.png', tmp_path / 'saved.json'
    assert main(['heat_sources', '--trips', '32', '--jobs', '1', '--plot', str(picture), '--json', str(file)]) == 0
    contents = json.loads(file.read_text())
    results = [heat_sources.SourcesResult(**result) for result in contents['results']]
    figures = heat_sources.summarise(results)
    assert contents['figures'] == {str(air_c): values for air_c, values in figures.items()}
    saved = {air_c: percentiles[1] for air_c, (percentiles, _) in figures.items()}
    # In air of -25 degC the pump does not work.
    assert -1.0 < saved[-25] < 5.0 < 25.0 < saved[-20] < saved[-10] < saved[10] < 70.0
    assert max(abs(error_k) for _, errors_k in figures.values() for error_k in errors_k) < 2.0
    assert picture.stat().st_size > 10_000


# test_cooled_worth.py shows the same daily, of one drive.
@pytest.mark.deep
def test_summer_drives_are_cooled_where_it_pays(tmp_path):
    file = tmp_path / 'summer.json'
    assert main(['summer', '--trips', '8', '--jobs', '1', '--json', str(file)]) == 0
    contents = json.loads(file.read_text())
    results = [summer.SummerResult(**result) for result in contents['results']]
    cooled = [result for result in results if result.saved_min is not None]
    assert contents['driven'] == sum(result.is_driven for result in results)
    assert len(results) >= len(cooled) == contents['cooled'] > 2
    for result in cooled:
        assert result.saved_cost > 0.0 and result.saved_min > 0.0 and result.beyond_k < 0.5
        assert result.gap_wh is None or -0.5 < result.gap_wh < 5.0
        assert result.switch_ons > 0 and result.program_switch_ons in (None, *range(result.switch_ons, 100))
