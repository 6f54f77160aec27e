# SPDX-License-Identifier: Apache-2.0
"""Expected figures: what deviates is named with its value, the expected one and the tolerance."""

import json

import pytest
from recorded_drive import LONG_TARGET_C

from bev_preheat.recording.comparison import deviations

pytestmark = [pytest.mark.needs('mcap', 'rclpy')]
# The first minutes of the drive are enough.
PART = ('--to', '120')
VALUES = {'number': 24.81, 'none': None, 'flag': True, 'words': ['WAITING', 'HEATING'], 'series': [1.0, 2.0, 3.5]}


@pytest.mark.parametrize('expected, told', [
    ({'number': (24.7, 0.2)}, None), ({'number': (24.7, 0.1)}, ('number', '24.81', '24.7', '0.1')),
    ({'number': (None, 0.2)}, ('number', '24.81', 'none', '0.2')), ({'none': (None, 0.0)}, None),
    ({'none': (1.0, 5.0)}, ('none', 'none', '1', '5')), ({'flag': (1, 0.0)}, ('flag', 'true', '1', '0')),
    ({'words': (['WAITING', 'ARRIVED'], 0.0)}, ('words[1]', '"HEATING"', '"ARRIVED"', '0')),
    ({'series': ([1.0, 2.0, 3.0], 0.5)}, None),
    ({'series': ([1.0, 2.0, 3.0], 0.4)}, ('series[2]', '3.5', '3', '0.4')),
    ({'series': ([1.0], 0.5)}, ('series', '3 values', '1 values', '0'))])
def test_a_deviation_is_named(expected, told):
    found = deviations(expected, VALUES)
    assert [tuple(each) for each in found] == ([] if told is None else [told])


@pytest.fixture
def written(recorded, said, tmp_path):
    """Return the recording's folder, and its written figures."""
    assert said('replay', recorded[1], *PART, '--write-expected', 'expected.json')[0] == 0
    return recorded[1], json.loads((tmp_path / 'expected.json').read_text())


def expecting(folder, path, contents):
    """Write a file of figures; returns the words of a replay that expects them."""
    path.write_text(contents if isinstance(contents, str) else json.dumps(contents))
    return ['replay', folder, *PART, '--expect', path]


def test_what_was_written_is_expected_and_the_first_deviation_is_told(written, tmp_path, said):
    folder, contents = written
    expected = contents['expected']
    assert expected['reproduced'] == {'value': True} and len(expected['minute_command_w']['value']) == 3
    status, output, _ = said(*expecting(folder, tmp_path / 'e.json', contents))
    assert status == 0 and 'as expected: 18 figures' in output
    expected['hvch_commanded_wh']['value'] -= 30.0
    expected['switch_ons']['value'] = 7
    status, output, _ = said(*expecting(folder, tmp_path / 'e.json', contents))
    assert status == 1
    assert 'not as expected: switch_ons: 1, expected 7, tolerance 0; 2 of 18 figures deviate' in output


@pytest.mark.parametrize('contents, told', [
    ('{', 'is not JSON'), ('[]', "format 'None'"),
    pytest.param({'format': 2}, "format '2'", marks=pytest.mark.deep),
    ({'format': 1, 'expected': {}}, 'nothing would be checked'),
    ({'format': 1, 'expected': {'arival_s': {'value': 1.0}}}, 'is arrival_s meant?'),
    ({'format': 1, 'expected': {'arrival_s': 1.0}}, 'arrival_s: has no value'),
    ({'format': 1, 'expected': {'arrival_s': {'value': 1.0, 'tolerance': -1}}}, 'at least 0'),
    pytest.param({'format': 1, 'expected': {'arrival_s': {'value': 1.0, 'tolerance': True}}}, 'at least 0',
                 marks=pytest.mark.deep)])
def test_a_wrong_file_of_figures_is_one_line(recorded, tmp_path, said, contents, told):
    status, _, errors = said(*expecting(recorded[1], tmp_path / 'e.json', contents))
    [line] = errors.splitlines()
    assert status == 2 and told in line


@pytest.mark.deep
def test_a_changed_signal_changes_the_planner(long_folder, said):
    result = json.loads(said('replay', long_folder, '--change', 'temperature=+2', '--json', '-')[1])
    # The part of the 2 K that the battery does not keep until arrival is saved heat: by the file, C dT / eta. The
    # drives do not arrive equally warm: each stops by an estimate from readings in steps of half a kelvin.
    from bev_preheat.vehicle import load_vehicle
    vehicle = load_vehicle('reference')
    recorded, changed = result['recorded'], result['changed']
    warmer_k = changed['arrival_temperature_c'] - recorded['arrival_temperature_c']
    heat_wh = (2.0 - warmer_k) * vehicle.battery.heat_capacity_j_per_k / vehicle.hvch.efficiency / 3600.0
    less_wh = recorded['hvch_commanded_wh'] - changed['hvch_commanded_wh']
    assert less_wh == pytest.approx(heat_wh, rel=0.03)
    # The planner has followed: without that it would arrive at 21.5 degC.
    assert changed['arrival_temperature_c'] == pytest.approx(LONG_TARGET_C, abs=0.5)
