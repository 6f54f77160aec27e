# SPDX-License-Identifier: Apache-2.0
"""Studies: reproducible trips, outcomes, figures, and the command."""

from dataclasses import asdict, replace
import json
import re

import numpy as np
import pytest
from rich.console import Console

from bev_preheat.commands.main import main
from bev_preheat.console.program import Interrupted, WorkerLost
from bev_preheat.nonlinear_program import solve
from bev_preheat.nonlinear_program.deficits import (
    ARRIVAL_SOC,
    DISCHARGE_POWER,
    HIGHEST_TEMPERATURE,
    StepDeficit,
    TARGET,
)
from bev_preheat.planning.planner import METHODS
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.commands.sweep import print_summary
from bev_preheat_studies.optimality import gap_study as study_run
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip, draw_trip
from bev_preheat_studies.optimality.gap_figures import summarise_gaps
from bev_preheat_studies.optimality.gap_study import (
    BEYOND_RANGE,
    disagreements,
    FEASIBLE,
    GapResult,
    MethodResult,
    NOT_NEEDED,
    POWER_LACKING,
    RESERVE_MISSED,
    result_from,
    run_study,
    solve_trip,
    SOLVER_FAILED,
    UNREACHABLE,
)
from bev_preheat_studies.workers import Workers

pytestmark = pytest.mark.costly

VEHICLE = load_vehicle('reference')


def without_times(result):
    """A GapResult without measured times."""
    return replace(
        result, solve_time_s=None, methods={
            method: replace(own, planning_time_s=0.0) for method, own in result.methods.items()})


def made_method(status='WAITING', gap_wh=0.5, arrival_c=17.0, violation=0.0, keeps_limits=True,
                planning_time_s=0.002):
    return MethodResult(
        status=status, arrival_temperature_c=arrival_c, energy_wh=5000.0 + gap_wh, gap_wh=gap_wh,
        difference='', arrival_soc=0.61, violation=violation, keeps_limits=keeps_limits,
        planning_time_s=planning_time_s)


def made_result(number, outcome=FEASIBLE, detail='', target_c=17.0, optimal_arrival_c=12.0,
                solve_time_s=0.1, **methods):
    return GapResult(
        number=number, outcome=outcome, detail=detail, duration_s=1800.0 + number,
        target_c=target_c, reserve_soc=0.1, optimal_energy_wh=5000.0,
        optimal_arrival_c=optimal_arrival_c, optimal_arrival_soc=0.61, solve_time_s=solve_time_s,
        methods=methods or {'one': made_method()})


@pytest.mark.parametrize('draw', [draw_trip, draw_limit_trip])
def test_same_seed_and_number_draw_the_same_trip(draw):
    first, second = draw(VEHICLE, 4, 9), draw(VEHICLE, 4, 9)
    assert (first.state, first.goal) == (second.state, second.goal)
    assert all((values == getattr(second.route, name)).all()
               for name, values in asdict(first.route).items())


@pytest.mark.parametrize('draw', [draw_trip, draw_limit_trip])
@pytest.mark.parametrize('other', [(4, 10), (5, 9), (9, 4)])
def test_other_seed_or_number_draws_another_trip(draw, other):
    assert draw(VEHICLE, 4, 9).state != draw(VEHICLE, *other).state


# Of a trip without limits this is said below.
@pytest.mark.parametrize('trips', ['limits', pytest.param('free', marks=pytest.mark.deep)])
def test_trip_has_the_same_result_each_time(trips):
    first, second = (solve_trip(VEHICLE, 7, 3, trips) for _ in range(2))
    assert without_times(first) == without_times(second)


def test_result_does_not_depend_on_the_trips_before_it(free_trips):
    alone = solve_trip(load_vehicle('reference'), 7, 2)
    assert without_times(free_trips[2]) == without_times(alone)


@pytest.mark.deep
def test_results_do_not_depend_on_the_number_of_jobs():
    done = []
    for jobs in (1, 2):
        with Workers(jobs) as workers:
            done.append(run_study(VEHICLE, 2, 7, workers, lambda result: None))
    one, two = done
    assert [without_times(result) for result in one] == [without_times(result) for result in two]


def test_a_result_is_read_back_to_the_last_bit():
    result = made_result(3, one=made_method(gap_wh=0.1 + 0.2))
    assert result_from(json.loads(json.dumps(asdict(result)))) == result


@pytest.fixture(scope='module')
def free_trips():
    """Trips without active limits."""
    return [*(solve_trip(VEHICLE, 7, number) for number in range(4)), solve_trip(VEHICLE, 1, 3)]


def test_the_trips_below_have_several_outcomes(free_trips):
    assert {result.outcome for result in free_trips} >= {FEASIBLE, NOT_NEEDED, UNREACHABLE}


@pytest.mark.parametrize('method', METHODS)
def test_statuses_agree_with_the_outcomes(free_trips, method):
    assert disagreements(free_trips, method) == []


@pytest.mark.deep
def test_statuses_agree_where_the_reserve_is_missed():
    result = solve_trip(VEHICLE, 1, 4)
    assert result.outcome == RESERVE_MISSED
    assert [disagreements([result], method) for method in METHODS] == [[]] * len(METHODS)


@pytest.mark.parametrize('deficit, outcome', [
    ((), FEASIBLE), ((TARGET,), UNREACHABLE), ((TARGET, ARRIVAL_SOC), RESERVE_MISSED),
    ((TARGET, DISCHARGE_POWER), POWER_LACKING), ((HIGHEST_TEMPERATURE,), BEYOND_RANGE)])
def test_the_deficit_of_the_program_is_the_outcome(free_trips, monkeypatch, deficit, outcome):
    number = next(result.number for result in free_trips[:4] if result.outcome == FEASIBLE)
    solve_optimum = solve.solve_optimum

    def solved(*arguments):
        return replace(solve_optimum(*arguments), deficit=tuple(
            StepDeficit(constraint, 0.25, 'K', 'missed') for constraint in deficit))

    monkeypatch.setattr(solve, 'solve_optimum', solved)
    result = solve_trip(VEHICLE, 7, number)
    assert (result.outcome, result.detail.count('missed')) == (outcome, len(deficit))


# test/nonlinear_program/test_optimum.py solves the other trip daily.
@pytest.mark.deep
@pytest.mark.parametrize('number', [137, 324])
def test_a_climb_that_overheats_the_battery_is_no_lack_of_power(number):
    result = solve_trip(VEHICLE, 1, number, 'limits')
    assert result.outcome == BEYOND_RANGE
    assert re.fullmatch(r'battery temperature: \d\.\d\d K above its range at \d+ s', result.detail)
    assert disagreements([result], 'value_function') == []


def test_optimal_switch_is_the_optimum_of_feasible_trips(free_trips):
    gaps_wh = [result.methods['optimal_switch'].gap_wh for result in free_trips
               if result.outcome == FEASIBLE]
    # Lower by at most IPOPT's tolerance, higher by the rest of a partial step.
    assert -1e-3 < min(gaps_wh) and max(gaps_wh) < 0.1


def test_the_paper_costs_more_than_the_optimum(free_trips):
    gaps_wh = [result.methods['paper'].gap_wh for result in free_trips
               if result.outcome == FEASIBLE]
    assert max(gaps_wh) > 1.0


def test_gap_is_the_energy_above_the_optimum(free_trips):
    for result in free_trips:
        for own in result.methods.values():
            assert own.difference == ''
            assert own.gap_wh == pytest.approx(own.energy_wh - result.optimal_energy_wh, abs=1e-9)


@pytest.mark.parametrize('outcome, status, agrees', [
    (FEASIBLE, 'WAITING', True), (FEASIBLE, 'HEATING', True), (FEASIBLE, 'NOT_NEEDED', False),
    (FEASIBLE, 'TARGET_UNREACHABLE', False), (NOT_NEEDED, 'NOT_NEEDED', True),
    (NOT_NEEDED, 'WAITING', False), (UNREACHABLE, 'TARGET_UNREACHABLE', True),
    (UNREACHABLE, 'WAITING', False), (BEYOND_RANGE, 'WAITING', True),
    (BEYOND_RANGE, 'POWER_LIMITED', False), (SOLVER_FAILED, 'WAITING', True)])
def test_what_contradicts_the_program(outcome, status, agrees):
    result = made_result(5, outcome, one=made_method(status))
    assert (disagreements([result], 'one') == []) is agrees


def test_a_target_missed_by_a_hair_may_be_called_missed_or_not():
    result = made_result(5, UNREACHABLE, target_c=17.0, optimal_arrival_c=16.87,
                         one=made_method('HEATING'))
    assert disagreements([result], 'one') == []


def distribution(values):
    return {'median': np.median(values), '95 %': np.quantile(values, 0.95), 'worst': max(values)}


@pytest.fixture
def made_results():
    """Eleven feasible trips with figures from everywhere, and two others."""
    random = np.random.default_rng(2)
    results = [
        made_result(
            number, solve_time_s=random.uniform(0.05, 0.5), target_c=random.uniform(8.0, 30.0),
            optimal_arrival_c=20.0,
            one=made_method(gap_wh=random.uniform(-1.0, 90.0),
                            arrival_c=random.uniform(8.0, 30.0),
                            violation=random.uniform(0.0, 0.3), keeps_limits=number % 3 > 0,
                            planning_time_s=random.uniform(1e-4, 1e-2)))
        for number in range(11)]
    return [*results, made_result(11, NOT_NEEDED, one=made_method('NOT_NEEDED', 7000.0)),
            made_result(12, UNREACHABLE, one=made_method('WAITING', 8000.0))]


@pytest.mark.parametrize('figure', ['gap_wh', 'violation', 'planning_time_s'])
def test_distribution_of_a_method_is_that_of_the_feasible_trips(made_results, figure):
    values = [getattr(result.methods['one'], figure) for result in made_results[:11]]
    assert summarise_gaps(made_results, ['one'])['methods']['one'][figure] == pytest.approx(
        distribution(values), rel=1e-12)


def test_arrival_error_is_what_lies_outside_the_target_and_the_warmer_optimum(made_results):
    errors_k = [min(abs(result.methods['one'].arrival_temperature_c - allowed_c) for allowed_c in (
        result.target_c, max(result.target_c, 20.0),
        np.clip(result.methods['one'].arrival_temperature_c, result.target_c, max(result.target_c, 20.0))))
                for result in made_results[:11]]
    figures = summarise_gaps(made_results, ['one'])['methods']['one']
    assert figures['arrival_error_k'] == pytest.approx(
        distribution(errors_k), rel=1e-12)


def test_solve_time_is_that_of_the_feasible_trips(made_results):
    assert summarise_gaps(made_results, ['one'])['solve_time_s'] == pytest.approx(
        distribution([result.solve_time_s for result in made_results[:11]]), rel=1e-12)


def test_outcomes_are_counted(made_results):
    summary = summarise_gaps(made_results, ['one'])
    assert (summary['trips'], summary['outcomes']) == (
        13, {FEASIBLE: 11, NOT_NEEDED: 1, UNREACHABLE: 1})


def test_plans_that_break_limits_are_counted(made_results):
    # Trips 0, 3, 6 and 9.
    assert summarise_gaps(made_results, ['one'])['methods']['one']['plans_that_break_limits'] == 4


def test_worst_trip_is_a_feasible_one(made_results):
    worst = max(made_results[:11], key=lambda result: result.methods['one'].gap_wh)
    assert summarise_gaps(made_results, ['one'])['methods']['one']['worst_trip'] == worst.number


def test_contradictions_are_listed(made_results):
    assert summarise_gaps(made_results, ['one'])['methods']['one']['disagreements'] == [
        {'number': 12, 'outcome': UNREACHABLE, 'status': 'WAITING'}]


@pytest.fixture
def failing_solver(monkeypatch):
    def solve_optimum(*arguments):
        raise solve.SolverFailure('IPOPT ended with Restoration_Failed, and with sorrow')

    monkeypatch.setattr(solve, 'solve_optimum', solve_optimum)


def test_solver_failure_is_an_outcome(failing_solver):
    result = solve_trip(VEHICLE, 7, 0)
    assert (result.outcome, result.detail, result.optimal_energy_wh) == (
        SOLVER_FAILED, 'IPOPT ended with Restoration_Failed, and with sorrow', None)


def test_solver_failure_keeps_the_plans_of_the_methods(failing_solver):
    methods = solve_trip(VEHICLE, 7, 0).methods
    assert {method: own.gap_wh for method, own in methods.items()} == dict.fromkeys(METHODS)
    assert min(own.energy_wh for own in methods.values()) > 0.0


def failed_result(number):
    return made_result(number, SOLVER_FAILED, 'IPOPT gave up', optimal_arrival_c=None,
                       solve_time_s=None, one=replace(made_method(), gap_wh=None))


def test_solver_failure_is_in_the_summary():
    summary = summarise_gaps([made_result(0), failed_result(1), made_result(2)], ['one'])
    assert summary['solver_failures'] == [{'number': 1, 'detail': 'IPOPT gave up'}]
    assert summary['outcomes'] == {FEASIBLE: 2, SOLVER_FAILED: 1}


def test_solver_failure_is_printed(capsys):
    print_summary(Console(width=120), summarise_gaps([made_result(0), failed_result(1)], ['one']))
    assert 'solver failed on trip 1: IPOPT gave up' in capsys.readouterr().out


def test_nothing_is_made_up_where_no_trip_is_feasible():
    summary = summarise_gaps([failed_result(0)], ['one'])
    assert (summary['solve_time_s'], summary['methods']['one']['gap_wh'],
            summary['methods']['one']['worst_trip']) == ({}, {}, None)


@pytest.fixture(scope='module')
def sweep(tmp_path_factory):
    """JSON and picture of a small sweep."""
    folder = tmp_path_factory.mktemp('sweep')
    assert main(['sweep', '--feasible', '2', '--seed', '7', '--jobs', '1',
                 '--json', str(folder / 'sweep.json'), '--plot', str(folder / 'sweep.png')]) == 0
    return json.loads((folder / 'sweep.json').read_text()), folder / 'sweep.png'


def test_sweep_runs_until_enough_trips_are_feasible(sweep):
    outcomes = [result['outcome'] for result in sweep[0]['results']]
    assert (outcomes.count(FEASIBLE), outcomes[-1]) == (2, FEASIBLE)


def test_sweep_leaves_no_trip_out(sweep):
    numbers = [result['number'] for result in sweep[0]['results']]
    assert numbers == list(range(len(numbers)))


def test_sweep_says_what_was_run(sweep):
    assert {key: sweep[0][key] for key in ('seed', 'vehicle', 'trips')} == {
        'seed': 7, 'vehicle': 'reference', 'trips': 'free'}


def test_sweep_summarises_its_results(sweep):
    gaps_wh = [result['methods']['paper']['gap_wh'] for result in sweep[0]['results']
               if result['outcome'] == FEASIBLE]
    assert sweep[0]['summary']['methods']['paper']['gap_wh'] == pytest.approx(
        distribution(gaps_wh), rel=1e-12)


def test_sweep_draws_a_picture(sweep):
    from matplotlib.image import imread
    # 5 in by 9 in at 130 dots an inch.
    assert imread(sweep[1]).shape[:2] == (650, 1170)


def reporting(results, then=None):
    """Return a study that reports results, and then raises an exception, if there is one."""
    def run_study(vehicle, feasible, seed, executor, report, trips, finished, keep, methods):
        for result in results:
            report(result)
        if then is not None:
            raise then
    return run_study


def test_sweep_lists_solver_failures(monkeypatch, tmp_path, capsys):
    results = [made_result(0, **dict.fromkeys(METHODS, made_method())),
               replace(failed_result(1), methods=dict.fromkeys(
                   METHODS, replace(made_method(), gap_wh=None)))]
    monkeypatch.setattr(study_run, 'run_study', reporting(results))
    path = tmp_path / 'sweep.json'
    assert main(['sweep', '--feasible', '1', '--json', str(path)]) == 0
    assert 'solver failed on trip 1: IPOPT gave up' in capsys.readouterr().out
    assert [item['outcome'] for item in json.loads(path.read_text())['results']] == [
        FEASIBLE, SOLVER_FAILED]


@pytest.mark.parametrize('arguments, message', [
    (['--feasible', '0'], 'preheat: error: --feasible: 0 is not allowed; it must be 1 ... 100000'),
    (['--seed', '-3'], 'preheat: error: --seed: -3 is not allowed; it must be 0 ... 2147483648'),
    (['--jobs', '0'], 'preheat: error: --jobs: 0 is not allowed; it must be 1 ... 1024')])
def test_sweep_refuses_in_one_line(arguments, message, capsys):
    assert main(['sweep', *arguments]) == 2
    assert capsys.readouterr().err == f'{message}\n'


def test_an_interrupted_sweep_keeps_what_is_finished(monkeypatch, tmp_path, capsys):
    methods = dict.fromkeys(METHODS, made_method())
    monkeypatch.setattr(study_run, 'run_study', reporting(
        [made_result(0, **methods), made_result(1, NOT_NEEDED, **methods),
         made_result(2, **methods)], Interrupted()))
    path, picture = tmp_path / 'sweep.json', tmp_path / 'sweep.png'
    assert main(['sweep', '--feasible', '9', '--json', str(path), '--plot', str(picture)]) == 130
    out, err = capsys.readouterr()
    assert err == (f'preheat: interrupted after 2 of 9 feasible trips; finished results are in {path} '
                   f'and {picture}\n')
    assert 'part of the study' in out and '3 trips: 2 feasible, 1 not needed' in out
    written = json.loads(path.read_text())
    assert (written['complete'], written['feasible'], written['summary']['trips']) == (False, 9, 3)
    assert [result['number'] for result in written['results']] == [0, 1, 2]
    from matplotlib.image import imread
    assert imread(picture).std() > 0.02


def test_an_interrupted_sweep_without_a_file_says_so(monkeypatch, capsys):
    monkeypatch.setattr(study_run, 'run_study', reporting(
        [made_result(0, **dict.fromkeys(METHODS, made_method()))], Interrupted()))
    assert main(['sweep', '--feasible', '2']) == 130
    assert capsys.readouterr().err == ('preheat: interrupted after 1 of 2 feasible trips; the summary '
                                       'covers finished results only\n')


def test_a_sweep_that_is_interrupted_at_once_writes_nothing(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(study_run, 'run_study', reporting([], Interrupted()))
    assert main(['sweep', '--feasible', '2', '--json', str(tmp_path / 'x.json')]) == 130
    assert capsys.readouterr() == ('', 'preheat: interrupted after 0 of 2 feasible trips; nothing '
                                       'finished, nothing written\n')
    assert list(tmp_path.iterdir()) == []


def test_a_lost_worker_costs_no_finished_trip(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(study_run, 'run_study', reporting(
        [made_result(0, **dict.fromkeys(METHODS, made_method()))], WorkerLost()))
    path = tmp_path / 'sweep.json'
    assert main(['sweep', '--feasible', '2', '--json', str(path)]) == 1
    assert capsys.readouterr().err == (
        'preheat: error: a worker process was killed after 1 of 2 feasible trips; finished results '
        f'are in {path}\n')
    assert len(json.loads(path.read_text())['results']) == 1


def test_trips_on_which_a_method_reaches_something_else_have_no_gap():
    results = [made_result(0), made_result(1, one=replace(
        made_method(arrival_c=9.0), gap_wh=None, difference='3.00 K colder')),
        made_result(2, one=made_method(gap_wh=7.0))]
    figures = summarise_gaps(results, ['one'])['methods']['one']
    assert (figures['compared_trips'], figures['worst_trip']) == (2, 2)
    assert figures['gap_wh'] == pytest.approx(distribution([0.5, 7.0]))
    # The distance from the program's arrival covers all trips.
    assert figures['arrival_error_k']['worst'] == pytest.approx(8.0)


def test_where_no_trip_can_be_compared_there_is_no_figure(capsys):
    other = replace(made_method(), gap_wh=None, difference='3.00 K colder')
    print_summary(Console(width=120), summarise_gaps([made_result(0, one=other)], ['one']))
    out = capsys.readouterr().out
    assert re.search('one: energy gap \\(Wh\\) +│ +– │ +– │ +– │', out)
    assert '1 trips have no gap, as the method does not reach the same as the program (to 0.2 K)' in out


# The plans of both methods, and their gap, are daily above.
@pytest.mark.deep
def test_on_trips_with_limits_only_like_is_compared_with_like():
    """Methods that ignore limits cannot drive this trip as planned, and would seem to save energy."""
    result = solve_trip(VEHICLE, 1, 3, 'limits')
    paper, by_values = result.methods['paper'], result.methods['value_function']
    assert paper.energy_wh < result.optimal_energy_wh - 100.0
    assert (paper.gap_wh, paper.difference.endswith(' kW larger')) == (None, True)
    assert by_values.gap_wh == pytest.approx(by_values.energy_wh - result.optimal_energy_wh)
