# SPDX-License-Identifier: Apache-2.0
"""`preheat plan`, `optimum`, `compare`, `reproduce`: files, printed text, refusals."""

import json
from pathlib import Path

from matplotlib.image import imread
import numpy as np
import pytest

from bev_preheat.commands.main import main
from bev_preheat.commands.output import write_json
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.planning.planner import DEFAULT_METHOD, METHODS, plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle

pytestmark = pytest.mark.costly

# Section 2.4 of the design: the JSON that other programs read.
PLAN_KEYS = {
    'status', 'method', 'heating_start_s', 'arrival_time_s', 'arrival_temperature_c',
    'arrival_soc', 'energy_wh', 'time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w'}
ENERGY_KEYS = {
    'joule', 'drivetrain_heat', 'hvch_heat', 'hvch_electric', 'leakage', 'battery_total'}

WITHOUT_TARGET = ['--vehicle', 'reference', '--route', 'reference', '--temperature', '-6.5', '--soc', '0.88',
                  '--min-soc', '0.11']
SITUATION = [*WITHOUT_TARGET, '--target', '17']
VEHICLE = load_vehicle('reference')
STATE, GOAL = BatteryState(-6.5, 0.88), Goal(17.0, 0.11)
OPTIMUM, COMPARE, REPRODUCE = (pytest.param(command, marks=pytest.mark.needs('casadi'))
                               for command in ('optimum', 'compare', 'reproduce'))
COMMANDS = ('plan', OPTIMUM, COMPARE, REPRODUCE)


def strict(text):
    """Return the contents of a JSON text; NaN and infinity, which JSON does not have, are errors."""
    def refuse(name):
        raise ValueError(f'{name} is no JSON')

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    """Run a command once with --json and --plot; returns the path without suffix."""
    folder, made = tmp_path_factory.mktemp('preheat'), {}

    def run(command):
        if command not in made:
            path = folder / command
            situation = [] if command == 'reproduce' else SITUATION
            assert main([command, *situation, '--json', f'{path}.json',
                         '--plot', f'{path}.png']) == 0
            made[command] = path
        return made[command]

    return run


@pytest.fixture(scope='module')
def written(results):
    return lambda command: strict(results(command).with_suffix('.json').read_text())


@pytest.mark.parametrize('command, keys', [('plan', PLAN_KEYS), pytest.param(
    'optimum', PLAN_KEYS | {'solver_status', 'solve_time_s'}, marks=pytest.mark.needs('casadi'))])
def test_what_is_written_has_keys_and_lengths_of_the_contract(written, command, keys):
    plan = written(command)
    assert set(plan) >= keys and set(plan['energy_wh']) == ENERGY_KEYS
    assert [len(plan[key]) for key in ('time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w')] == [
        121, 121, 121, 120]


def test_plan_is_that_of_the_arguments(written):
    route = load_route('reference', VEHICLE.defaults)
    expected = plan_preheating(VEHICLE, route, STATE, GOAL, DEFAULT_METHOD).as_dictionary()
    expected['vehicle_assumed'] = []
    expected['planning_time_s'] = written('plan')['planning_time_s']
    expected['route_made_for'] = 'reference'
    plan = dict(written('plan'))
    assert plan.pop('sensitivity')['kelvin_saves_wh'] > 0.0
    assert plan == expected


def test_each_heat_source_has_a_row_and_their_energies_are_that_of_all(said):
    output = said('plan', '--vehicle', 'heat_pump_car', '--route', 'legs/reference', '--temperature', '-15',
                  '--soc', '0.9', '--target', '45')[1]
    rows = dict(line.strip('│ ').split('│') for line in output.splitlines() if line.count('│') == 3)
    figures = {name.strip(): float(rows[name]) for name in rows if '[Wh]' in name}
    of_sources = [figures[f'… {name} [Wh]'] for name in ('hvch', 'motor', 'heat_pump')]
    assert sum(of_sources) == pytest.approx(figures['Sources: electric [Wh]'], abs=0.2)
    assert sum(energy_wh > 0.0 for energy_wh in of_sources) >= 2
    assert not any('HVCH' in name for name in figures)


@pytest.mark.parametrize('command', ['plan', COMPARE])
def test_what_stands_behind_the_plan_is_written_and_printed(written, command, said):
    never = plan_unheated(VEHICLE, load_route('reference', VEHICLE.defaults), STATE, GOAL)
    sensitivity = written(command)['sensitivity']
    assert sensitivity['unheated_colder_k'] == pytest.approx(17.0 - never.arrival_temperature_c, abs=1e-3)
    # Full power suffices from any temperature of the range.
    assert sensitivity['reached_from_c'] is None
    assert sensitivity['sentence'] in said(command, *SITUATION)[1]


@pytest.mark.parametrize('more', [['--no-charging'], ['--charging-probability', '0.01']])
def test_without_a_target_nothing_stands_behind_the_plan(said, more):
    status, out, err = said('plan', *WITHOUT_TARGET, *more, '--json', '-')
    assert status == 0 and strict(out)['sensitivity'] is None and 'kelvin' not in err


@pytest.mark.needs('casadi')
def test_optimum_is_that_of_the_arguments(written):
    from bev_preheat.nonlinear_program import solve
    route = load_route('reference', VEHICLE.defaults)
    optimum = solve.solve_optimum(VEHICLE, route, STATE, GOAL)
    result = written('optimum')
    assert result['energy_wh']['battery_total'] == pytest.approx(optimum.plan.energy_wh.battery_total, abs=1e-6)
    assert (result['method'], result['solver_status']) == ('nlp', 'Solve_Succeeded')
    assert 0.0 < result['solve_time_s'] < 60.0


@pytest.mark.needs('casadi')
@pytest.mark.parametrize('command', ['optimum', 'compare'])
def test_an_optimum_that_the_car_refuses_is_told(said, command):
    text = (configuration_folder('vehicles') / 'reference.yaml').read_text()
    Path('gated.yaml').write_text(f'{text}heating_gates: {{maximum_temperature_c: 12}}\n')
    assert 'warning' not in said(command, *SITUATION, '--json', '-')[2]
    status, out, err = said(command, *SITUATION, '--vehicle', 'gated.yaml', '--json', '-')
    assert status == 0 and "the optimum, makers' rules and all methods but value_function heat regardless" in err
    result = strict(out)
    # 17 degC, to which the car does not heat.
    assert result.get('optimum', result)['arrival_temperature_c'] == pytest.approx(17.0, abs=0.01)


def test_the_method_of_earlier_versions_is_the_one_that_took_its_place_and_this_is_said_once(said):
    status, out, err = said('plan', *SITUATION, '--method', 'merit_order', '--json', '-')
    assert status == 0 and strict(out)['method'] == 'value_function'
    assert err.count('method merit_order no longer exists; value_function took its place') == 1
    assert err.count('merit_order') == 1


@pytest.mark.needs('casadi')
def test_comparison_has_every_method_its_energy_above_the_optimum_and_the_optimum(written):
    comparison = written('compare')
    assert set(comparison['plans']) == set(METHODS)
    assert set(comparison['optimum']) >= PLAN_KEYS | {'solver_status', 'solve_time_s'}
    best_wh = comparison['optimum']['energy_wh']['battery_total']
    assert comparison['gap_wh'] == pytest.approx({
        method: plan['energy_wh']['battery_total'] - best_wh for method, plan in comparison['plans'].items()})


@pytest.mark.needs('casadi')
def test_reproduction_has_its_cells_and_plans(written):
    reproduction = written('reproduce')
    assert len(reproduction['cells']) == 12
    assert set(reproduction['cells'][0]) == {'column', 'row', 'unit', 'paper', 'ours', 'origin'}
    for name in ('heuristic', 'optimal_switch', 'optimum'):
        assert set(reproduction[name]) >= PLAN_KEYS


@pytest.mark.parametrize('command', COMMANDS)
def test_picture_has_its_size_and_is_not_blank(results, command):
    picture = imread(results(command).with_suffix('.png'))
    # Panels of 1.6 in (2.2 in where plans are compared in four) and 0.8 in more, 9 in wide, 130 dots an inch.
    assert picture.shape[:2] == ((1248 if command == 'compare' else 1560), 1170)
    assert picture[..., :3].std() > 0.02


@pytest.mark.needs('casadi')
def test_optimum_says_what_a_kelvin_would_cost(written, said):
    cost_wh = written('optimum')['marginal_cost_wh_per_k']
    assert f'One more kelvin on arrival would cost {cost_wh:.1f} Wh.' in said('optimum', *SITUATION)[1]


@pytest.mark.needs('casadi')
def test_unreachable_target_is_said_and_unknown_cost_is_null(said):
    status, output, errors = said('optimum', *SITUATION, '--step', '120', '--target', '55', '--json', '-')
    optimum = strict(output)
    assert status == 0 and optimum['marginal_cost_wh_per_k'] is None
    assert f'best possible result: {optimum["infeasible"][0]}.' in errors


def test_numbers_that_json_does_not_have_become_null(tmp_path):
    path = tmp_path / 'numbers.json'
    write_json(path, {'a': float('nan'), 'b': [1.5, float('inf')], 'c': {'d': -float('inf')}})
    assert strict(path.read_text()) == {'a': None, 'b': [1.5, None], 'c': {'d': None}}


@pytest.mark.parametrize('command', [OPTIMUM, COMPARE])
def test_solver_failure_ends_with_1_and_one_line(monkeypatch, tmp_path, said, command):
    from bev_preheat.nonlinear_program import solve

    def solve_optimum(*arguments):
        raise solve.SolverFailure('IPOPT ended with Restoration_Failed')

    monkeypatch.setattr(solve, 'solve_optimum', solve_optimum)
    assert said(command, *SITUATION, '--json', 'result.json') == (
        1, '', 'preheat: IPOPT ended with Restoration_Failed\n')
    assert not (tmp_path / 'result.json').exists()


REFUSED = {
    'vehicle that is nearly there': (
        ['--vehicle', 'referense'],
        "vehicle 'referense' is unknown; did you mean 'reference'?; known: "),
    'route that is nearly there': (
        ['--route', 'alpine_pas'],
        "route 'alpine_pas' is unknown; did you mean 'alpine_pass'?; known: "),
    'no route file': (['--route', 'none.csv'], 'none.csv: no such file'),
    'unknown temperature': (['--temperature', 'nan'], 'battery temperature: nan is not allowed'),
    'charge in per cent': (['--soc', '88'],
                           'state of charge: 88 is not allowed; it must be 0 ... 1; 0.88?'),
    'target without charging': (['--no-charging'], '--target: not allowed with --no-charging'),
    'highest without charging': (['--no-charging', '--max-arrival-temperature', '30'], '--target, --max-arrival'),
    'no step': (['--step', '0'], '--step: 0 s is not allowed; it must be 0.1 ... 3600 s')}


@pytest.mark.parametrize('command', ['plan', OPTIMUM, COMPARE])
@pytest.mark.parametrize('arguments, beginning', REFUSED.values(), ids=REFUSED)
def test_user_error_is_one_clear_line_and_status_2(refused, command, arguments, beginning):
    # The last of two equal arguments counts.
    assert refused(command, *SITUATION, *arguments).startswith(beginning)


@pytest.mark.parametrize('option, value, named', [
    ('--charging-probability', 'nan', 'charging probability: nan'),
    ('--charging-probability', '1.1', 'charging probability: 1.1'),
    ('--arrival-deviation', '-1', 'arrival deviation: -1'),
    ('--charging-known-before', 'inf', 'time before arrival: inf')])
def test_a_bad_prospect_of_charging_is_refused_in_one_line(refused, option, value, named):
    assert f'{named} is not allowed' in refused('plan', *SITUATION, option, value)


@pytest.mark.parametrize('option', ['--arrival-deviation', '--charging-known-before'])
def test_a_doubt_that_does_not_change_the_plan_is_refused(refused, said, option):
    assert f'{option}: only with --charging-probability below 1' in refused('plan', *SITUATION, option, '300')
    assert said('plan', *SITUATION, option, '300', '--charging-probability', '0.9')[0] == 0
    assert said('plan', *SITUATION, option, '0')[0] == 0
    assert '--charging-probability: not allowed with --no-charging' in refused(
        'plan', *SITUATION, '--no-charging', option, '300', '--charging-probability', '0.9')


@pytest.mark.parametrize('temperature', ['-7.', '-.7e1', '-7e0', '-07'])
def test_a_temperature_below_zero_may_be_written_in_any_way(said, temperature):
    status, output, _ = said('plan', '--vehicle', 'reference', '--route', 'reference', '--soc', '0.9',
                             '--temperature', temperature)
    assert (status, output.splitlines()[-2]) == (
        0, 'WAITING: Heating starts in 32:02 min: arrival in 1:00:00 h at 25.0 degC, target 25.0 degC.')


def test_long_rows_are_divided_unless_the_step_is_given(said, tmp_path):
    (tmp_path / 'long.csv').write_text('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n'
                                       '900,20,15000,-5\n1500,25,20000,-5\n50,10,9000,-5\n')
    words = ['plan', '--vehicle', 'reference', '--route', './long.csv', '--temperature', '0', '--soc', '0.8',
             '--target', '15', '--json', '-']
    plans = [json.loads(said(*words, *more)[1]) for more in ((), ('--step', '5'), ('--step', '600'))]
    assert np.diff(plans[0]['time_s']).max() == 60.0 and len(plans[0]['time_s']) == 15 + 25 + 1 + 1
    heat_wh = [plan['energy_wh']['hvch_electric'] for plan in plans]
    assert heat_wh[0] == pytest.approx(heat_wh[1], rel=2e-4)
    assert abs(heat_wh[2] - heat_wh[1]) > abs(heat_wh[0] - heat_wh[1])
