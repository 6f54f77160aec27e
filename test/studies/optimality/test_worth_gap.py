# SPDX-License-Identifier: Apache-2.0
"""The study of the best target: its trips, figures and tables."""

import json
import math

import numpy as np
import pytest

from bev_preheat_studies import best_target
from bev_preheat_studies.charging_worth import cases
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip
from bev_preheat_studies.optimality.worth_gap import (
    COMPARED,
    count_optima,
    NEVER_CHARGED,
    relative_gap,
    run_worth_study,
    solve_charging_trip,
    summarise,
    WorthGap,
)

# The first has a heat path; trip 76 has none.
TRIPS = (98, *(pytest.param(number, marks=pytest.mark.deep) for number in (0, 2, 76)))


def test_same_seed_and_number_draw_the_same_trip():
    one, same, other = (draw_charging_trip(3, number) for number in (7, 7, 8))
    assert (one.stop, one.prices, one.state) == (same.stop, same.prices, same.state)
    assert np.array_equal(one.route.propulsion_power_w, same.route.propulsion_power_w)
    assert (one.vehicle.hvch, one.vehicle.heat_path) == (same.vehicle.hvch, same.vehicle.heat_path)
    assert one.stop != other.stop and one.state != other.state


# One of them is driven below, daily.
@pytest.mark.deep
def test_all_kinds_of_trips_are_drawn():
    trips = [draw_charging_trip(1, number) for number in range(60)]
    assert len({trip.vehicle.name for trip in trips}) == 5
    for is_of_a_kind in (
            lambda trip: trip.route.propulsion_power_w.min() < 0.0,
            lambda trip: not trip.vehicle.charging.battery_heating,
            lambda trip: not trip.vehicle.heat_path.is_direct,
            lambda trip: trip.prices.time_per_h == 0.0,
            lambda trip: trip.stop.charger_power_w < 60e3,
            lambda trip: trip.stop.charger_power_w > 150e3,
            lambda trip: trip.stop.ambient_c < -20.0):
        assert 0 < sum(map(is_of_a_kind, trips)) < 60


@pytest.mark.costly
@pytest.mark.needs('casadi')
@pytest.mark.parametrize('number', TRIPS)
def test_the_best_target_is_as_good_as_the_program(number):
    result = solve_charging_trip(1, number)
    assert result.outcome == COMPARED and result.is_heated
    assert abs(result.gap) < 1e-4


@pytest.mark.deep
@pytest.mark.needs('casadi')
def test_the_best_target_is_as_good_as_the_program_on_a_hundred_trips():
    summary = summarise(run_worth_study(100, 1, None, lambda result: None))
    assert summary['outcomes'][COMPARED] == 100
    for gap in ('gap', 'blind_gap'):
        assert summary[gap]['median'] <= 1e-3 and summary[gap]['worst'] <= 5e-3


def result(number, cost, program_cost, wh=500.0, path=False, blind=None):
    return WorthGap(number, COMPARED, '', 'car', path, False, cost, program_cost,
                    program_cost if blind is None else blind, 50.0, 15.0, 14.0, wh, wh, 1, 4, 0, 1.0)


def test_figures_of_a_study():
    results = [result(0, 10.01, 10.0), result(1, 20.0, 20.0, wh=0.0),
               result(2, 30.3, 30.0, path=True, blind=30.6),
               WorthGap(3, NEVER_CHARGED, 'why', 'car', False)]
    figures = summarise(results)
    assert (figures['trips'], figures['heated'], figures['heated_by_heat_path']) == (4, 2, 1)
    assert figures['outcomes'][NEVER_CHARGED] == 1
    assert figures['gap'] == pytest.approx({'least': 0.0, 'median': 1e-3, '95 %': 9.1e-3, 'worst': 1e-2})
    assert figures['heated_gap']['worst'] == pytest.approx(1e-3)
    assert figures['heat_path_gap']['median'] == pytest.approx(1e-2)
    assert figures['blind_gap']['least'] == pytest.approx(-0.3 / 30.6)
    assert figures['worst_gap_trip'] == 2
    assert summarise([results[-1]])['gap'] == {}


def test_gaps_are_shares_of_the_other_cost():
    assert relative_gap(11.0, 10.0) == pytest.approx(0.1)
    assert relative_gap(0.0, 0.0) == 0.0 and relative_gap(1.0, 0.0) == math.inf
    assert relative_gap(None, 1.0) is None and relative_gap(1.0, None) is None


def test_optima_of_different_cost_are_counted():
    assert count_optima([10.0, 10.001, 10.2, math.inf, 10.2]) == 2
    assert count_optima([]) == 0


@pytest.mark.needs('casadi')
def test_the_command_prints_the_table_and_writes_json(capsys, tmp_path, monkeypatch):
    asked = []

    def study(trips, seed, jobs, report, kept):
        asked.append((trips, seed, jobs))
        for number in range(trips):
            report(result(number, 10.0 + 0.02 * number, 10.0))

    monkeypatch.setattr(best_target, 'run_worth_study', study)
    path = tmp_path / 'study.json'
    assert best_target.main(['--trips', '3', '--seed', '5', '--jobs', '2', '--json', str(path)]) == 0
    assert asked == [(3, 5, 2)]
    written = json.loads(path.read_text())
    assert written['complete'] and [item['number'] for item in written['results']] == [0, 1, 2]
    assert written['summary']['gap']['worst'] == pytest.approx(4e-3)
    output = capsys.readouterr().out
    assert 'Cost of the best target above the joint program (%)' in output and '0.4000' in output
    # Trips are listed from a thousandth on.
    assert 'trip 2, car: best target 15.0 degC costs 10.040' in output and 'trip 0, ' not in output


@pytest.mark.costly
@pytest.mark.needs('casadi')
def test_the_command_shows_a_trip_start_by_start(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '200')
    assert best_target.main(['--only', '98']) == 0
    output = capsys.readouterr().out
    assert 'Trip 98, ' in output and 'IPOPT from each start' in output
    assert output.count('Solve_Succeeded') >= 2


@pytest.mark.deep
@pytest.mark.needs('casadi')
def test_the_command_shows_the_reference_trip(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '200')
    monkeypatch.setattr(best_target, 'cases', lambda: cases()[2:3])
    assert best_target.main(['--reference']) == 0
    output = capsys.readouterr().out
    [line] = [line for line in output.splitlines() if '-15' in line]
    cells = [cell.strip() for cell in line.strip('│').split('│')]
    # The same as in docs/explanation/worth.md.
    assert (cells[0], cells[3]) == ('150', '16.1') and abs(float(cells[-1])) <= 1e-3


@pytest.mark.parametrize('arguments, problem', [
    (['--trips', '0'], '--trips: 0 is not allowed; it must be 1 ... 100000'),
    (['--jobs', '0'], '--jobs: 0 is not allowed; it must be 1 ... 1024'),
    (['--seed', '-1'], '--seed: -1 is not allowed'), (['--only', '-1'], '--only: -1 is not allowed'),
    (['--only', '1', '--reference'], '--only, --reference: not allowed together, nor'),
    (['--reference', '--json', 'a.json'], '--only, --reference: not allowed together, nor')])
def test_the_command_refuses_in_one_line(capsys, arguments, problem):
    assert best_target.main(arguments) == 2
    errors = capsys.readouterr().err
    assert problem in errors and errors.count('\n') == 1
