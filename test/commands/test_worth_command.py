# SPDX-License-Identifier: Apache-2.0
"""`preheat worth`: the JSON of the contract, table, picture, and refusals."""

import json

from matplotlib.image import imread
import pytest

from bev_preheat.vehicle import vehicle_file

# Section 8 of the design: the JSON that other programs read.
KEYS = {'targets', 'best', 'without_heating', 'break_even_value_of_time_per_h', 'verdict'}
TARGET_KEYS = {'target_c', 'arrival_temperature_c', 'arrival_soc', 'hvch_electric_wh',
               'charging_time_s', 'bought_energy_wh', 'cost', 'charger_heating', 'charger_heating_wh'}
DRIVE = ['worth', '--vehicle', 'reference', '--route', 'winter_commute', '--temperature', '-2', '--soc',
         '0.3', '--charger-power', '140000', '--departure-soc', '0.7']


@pytest.mark.costly
def test_what_is_written_is_the_contract_and_what_is_found(said, tmp_path):
    status, output, errors = said(*DRIVE, '--energy-price', '0.45', '--value-of-time', '7', '--target',
                                  '18', '--json', 'worth.json', '--plot', 'worth.png')
    assert (status, errors) == (0, '')
    written = json.loads((tmp_path / 'worth.json').read_text())
    assert set(written) >= KEYS
    assert all(set(target) == TARGET_KEYS for target in (
        *written['targets'], written['best'], written['without_heating']))
    assert written['best']['cost'] == min(target['cost'] for target in written['targets'])
    for target in written['targets']:
        assert target['cost'] == pytest.approx(
            0.45 * target['bought_energy_wh'] / 1e3 + 7.0 * target['charging_time_s'] / 3600.0)
    assert written['without_heating'] == written['targets'][0]
    assert written['without_heating']['hvch_electric_wh'] == 0.0
    assert written['verdict'] in output
    assert written['fixed_target']['target_c'] == 18.0
    for word in ('unheated', 'best', 'fixed', f'{written["best"]["target_c"]:.2f}'):
        assert word in output
    assert 'Uncertainty of the model (1 sigma): ' in output
    picture = imread(tmp_path / 'worth.png')
    assert picture.shape[1] > 1000 and picture.std() > 0.05


@pytest.mark.costly
def test_a_charger_that_cannot_is_null_in_json_and_is_drawn(said, tmp_path):
    status, output, errors = said(*DRIVE, '--charger-power', '1500', '--json', '-', '--plot', 'worth.svg')
    written = json.loads(output)
    assert status == 0 and written['best']['charging_time_s'] is None
    assert written['best']['cost'] is None and written['break_even_value_of_time_per_h'] is None
    assert written['verdict'].startswith('This charger cannot charge the battery that far') and (
        written['verdict'] in errors)
    assert (tmp_path / 'worth.svg').stat().st_size > 1000


@pytest.mark.parametrize('arguments, problem', [
    (['--departure-soc', '80'], 'departure state of charge: 80 is not allowed; it must be 0.05 ... 1 '
     "(the vehicle's soc_range); 0.8?"),
    (['--soc', '0.01'], 'state of charge: 1 % is not enough for this trip, even without heating: ')])
def test_refused_in_one_line(refused, arguments, problem):
    assert refused(*DRIVE, *arguments).startswith(problem)


# --- several chargers ---

ALONG = ['worth', '--vehicle', 'reference', '--route', 'reference', '--temperature', '-10', '--soc', '0.5',
         '--chargers', 'reference', '--end-soc', '0.5']


@pytest.mark.deep
@pytest.mark.costly
def test_several_chargers_are_ranked_written_and_drawn(said, tmp_path):
    status, output, errors = said(*ALONG, '--value-of-time', '12', '--json', 'along.json', '--plot',
                                  'along.png')
    assert (status, errors) == (0, '')
    written = json.loads((tmp_path / 'along.json').read_text())
    found = written['chargers']
    assert {item['name'] for item in found} == {'village', 'motorway', 'mall'}
    assert [item['total_cost'] for item in found] == sorted(item['total_cost'] for item in found)
    assert written['best'] == found[0]['name'] and written['verdict'] in output
    for item in found:
        # A charger that may be taken has the costs of both outcomes, too.
        both = {'charged_cost', 'not_charged_cost'} if 'pays_from_probability' in item['worth'] else set()
        assert set(item['worth']) >= KEYS and set(item['worth']['best']) == TARGET_KEYS | both
        assert item['end_soc'] == pytest.approx(0.5, abs=2e-4)
        # The expected cost of a charger that may be taken includes the waiting.
        waiting_s = item['detour_s'] + (0.0 if both else item['expected_wait_s'])
        assert item['total_cost'] == pytest.approx(
            item['worth']['best']['cost'] + 12.0 * waiting_s / 3600.0)
        assert f'{item["total_cost"]:.2f}' in output
    # Occupied in two of five cases, for 15 min.
    assert next(item for item in found if item['name'] == 'mall')['expected_wait_s'] == pytest.approx(360.0)
    picture = imread(tmp_path / 'along.png')
    assert picture.shape[1] > 1000 and picture.std() > 0.05


@pytest.mark.costly
def test_a_charger_that_does_not_serve_is_listed_with_the_reason(said):
    status, output, _ = said(*ALONG, '--end-soc', '0.9', '--only', 'village', '--json', '-', '--plot', 'a.svg')
    written = json.loads(output)
    assert status == 0 and written['best'] is None
    [item] = written['chargers']
    assert item['problem'].startswith('even 100 % is not enough for the rest of the route: ')
    assert item['worth'] is None and item['total_cost'] is None


@pytest.mark.parametrize('arguments, problem', [
    (['--only', 'moll'], "--only: charger 'moll' is unknown; "),
    (['--end-soc', '30'], "the top of the vehicle's soc_range; 0.3?"),
    (['--departure-soc', '0.8'], '--departure-soc: not allowed with --chargers'),
    (['--target-range', '20', '25'], '--target-range: not allowed with --chargers'),
    (['--target', '20'], '--target: not allowed with --chargers'),
    (['--charger-power', '50000'], '--charger-power: not allowed with --chargers'),
    (['--chargers', 'nowhere'], "charger 'nowhere' is unknown; known: reference"),
    (['--route', 'winter_commute', '--only', 'village'], 'chargers[0] (village).at_min: 20 is beyond the ')])
def test_several_chargers_refused_in_lines(said, arguments, problem):
    status, output, errors = said(*ALONG, *arguments)
    assert (status, output) == (2, '')
    assert problem in errors.splitlines()[0] and errors.startswith('preheat: error: ')


def test_a_range_of_targets_with_a_table_of_charging_times(said, refused, tmp_path):
    *words, _, _, _, _ = DRIVE
    rows = [f'{soc},{at_c},{time_s}' for soc in (0, 1) for at_c, time_s in ((-10, 2000), (7, 1500), (8, 900))]
    (tmp_path / 'times.csv').write_text('\n'.join(['arrival_soc,arrival_temperature_c,charging_time_s', *rows]))
    within = [*words, '--charging-times', 'times.csv', '--target-range']
    status, output, _ = said(*within, '5', '10', '--min-soc', '0.05', '--json', '-')
    written = json.loads(output)
    assert status == 0 and written['target_range_c'] == [5.0, 10.0]
    assert set(written['best']) == TARGET_KEYS
    assert written['best']['arrival_temperature_c'] == pytest.approx(8.0, abs=0.06)
    assert written['best']['charging_time_s'] == pytest.approx(900.0, abs=30.0)
    status, output, _ = said(*within, '40', '45')
    assert status == 0 and 'No target within the range is reached' in output
    status, output, _ = said(*within, '-25', '-20')
    assert status == 0 and 'Unheated, the battery arrives above the range' in output
    for wrong, problem in (
            ([*words, '--charging-times', 'times.csv'], '--charging-times: only with --target-range'),
            ([*within, '5', '10', '--charger-power', '9e4'], '--charger-power: not allowed with --charging-times'),
            ([*within, '5', '10', '--target', '20'], '--target: not allowed with --target-range')):
        assert refused(*wrong).startswith(problem)


@pytest.mark.costly
def test_a_price_of_ageing_stands_beside_minutes_and_energy(said, tmp_path):
    text = vehicle_file('reference').read_text(encoding='utf-8')
    (tmp_path / 'aged.yaml').write_text(text.replace('charging:', 'charging:\n  ageing: ' + (
        '{model: schimpe_2018, battery_price: 9000, age_years: 3, full_cycles: 200}')), encoding='utf-8')
    status, output, _ = said(*DRIVE, '--vehicle', 'aged.yaml', '--json', 'aged.json')
    written = json.loads((tmp_path / 'aged.json').read_text())
    best, unheated = written['best'], written['without_heating']
    assert status == 0 and set(best) == TARGET_KEYS | {'ageing_cost', 'ageing_outside_share'}
    assert best['ageing_cost'] < unheated['ageing_cost']
    for item, name in ((best, 'best'), (unheated, 'unheated')):
        line = next(line for line in output.splitlines() if f'│ {name} ' in line)
        assert [cell.strip() for cell in line.split('│')][4:8] == [
            f'{item["charging_time_s"] / 60.0:.1f}', f'{item["bought_energy_wh"] / 1e3:.2f}',
            f'{item["ageing_cost"]:.2f}', f'{item["cost"]:.2f}']
    assert f'{100.0 * best["ageing_outside_share"]:.0f} % of the charge with the best target' in output
    car = ('--vehicle', 'aged.yaml', '--charger-power', '50000')
    _, output, _ = said(*DRIVE[:-4], *car, '--target-range', '5', '12')
    assert 'ageing' in output and 'all charge is within' in output
    _, output, _ = said(*ALONG, *car[:2], '--only', 'village', '--json', '-', '--plot', 'along.png')
    [village] = json.loads(output)['chargers']
    assert village['ageing_cost'] == village['worth']['best']['ageing_cost'] > 0.0
    assert village['total_cost'] == pytest.approx(
        village['worth']['best']['cost'] + 10.0 * village['detour_s'] / 3600.0)
    _, output, _ = said('charge', *car, '--departure-soc', '0.7', '--arrival-temperature', '-10', '20',
                        '--arrival-soc', '0.1', '--ambient', '-10')
    assert 'Ageing [cost]' in output and ' of the charge from -10 degC, which counts as at the edge.' in output


def test_without_a_charge_to_leave_with_it_is_80_percent_as_in_the_planner(said):
    *words, _, _ = DRIVE
    assert json.loads(said(*words, '--json', '-')[1])['departure_soc'] == 0.8
