# SPDX-License-Identifier: Apache-2.0
"""Expected figures: what deviates is named with its value, the expected one and the tolerance."""

import json

import pytest
from recorded_drive import LONG_TARGET_C

from bev_preheat.commands.main import main
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


@pytest.fixture(scope='module')
def written(recorded, tmp_path_factory):
    """Return the recording's folder, and its written figures."""
    path = tmp_path_factory.mktemp('expected') / 'expected.json'
    assert main(['replay', str(recorded[1]), *PART, '--write-expected', str(path)]) == 0
    return recorded[1], json.loads(path.read_text())


def expect(folder, path, contents, *words):
    path.write_text(contents if isinstance(contents, str) else json.dumps(contents))
    return main(['replay', str(folder), *PART, '--expect', str(path), *words])


def test_what_was_written_is_expected(written, tmp_path, capsys):
    folder, contents = written
    assert contents['expected']['reproduced'] == {'value': True}
    assert len(contents['expected']['minute_command_w']['value']) == 3
    assert expect(folder, tmp_path / 'e.json', contents) == 0
    assert 'as expected: 18 figures' in capsys.readouterr().out


def test_the_first_deviation_is_told(written, tmp_path, capsys):
    folder, contents = written
    contents = json.loads(json.dumps(contents))
    contents['expected']['hvch_commanded_wh']['value'] -= 30.0
    contents['expected']['switch_ons']['value'] = 7
    assert expect(folder, tmp_path / 'e.json', contents) == 1
    output = capsys.readouterr().out
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
def test_a_wrong_file_of_figures_is_one_line(recorded, tmp_path, capsys, contents, told):
    assert expect(recorded[1], tmp_path / 'e.json', contents) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert told in line


@pytest.mark.deep
def test_a_changed_signal_changes_the_planner(long_folder, capsys):
    assert main(['replay', str(long_folder), '--change', 'temperature=+2', '--json', '-']) == 0
    result = json.loads(capsys.readouterr().out)
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
