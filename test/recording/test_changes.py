# SPDX-License-Identifier: Apache-2.0
"""Options of `preheat replay`, `--change` and `--set` above all: usual names work, and others are suggested."""

import json

import pytest

from bev_preheat.recording.changes import signal_change, UNITS

pytestmark = [pytest.mark.needs('mcap', 'rclpy')]


@pytest.mark.parametrize('words, told', [
    (['--change', 'target=90'], "target: '90' is not allowed; it must be -40 ... 60 degC"),
    (['--change', 'soc=50'], 'it must be 0 ... 1 (a share)'), (['--change', 'soc=none'], "'none'"),
    (['--change', 'temperature=+nan'], '+NUMBER or -NUMBER [K]'),
    (['--change', 'colour=+1'], 'temperature [degC], soc [0 ... 1]'), (['--change', 'target'], 'SIGNAL=VALUE'),
    (['--change', 'temperture=+2'], 'did you mean --change temperature=...'),
    (['--change', 'target_temp=30'], 'did you mean --change target=...'),
    (['--change', 'heat_capacity=4e5'], 'battery.heat_capacity_j_per_k=...'),
    (['--change', 'maximum_power=5000'], 'hvch.maximum_power_w=...'),
    (['--change', 'hvch.maximum_powr_w=5000'], "did you mean 'maximum_power_w'"),
    (['--change', 'hvch.efficiency=87'], 'the recorded vehicle file: hvch.efficiency'),
    (['--set', 'target=30'], 'did you mean --change target=...'),
    (['--set', 'comand_lease=3'], 'did you mean command_lease=...'),
    (['--set', 'command_lease=0.5'], 'command_lease: 0.5 s must be longer than command_period, 1 s'),
    (['--set', 'command_period=0.5'], 'command_period: is not allowed as a change'),
    (['--change', 'compiled_core=false'], 'compiled_core: is not allowed as a change'),
    (['--set', 'colour=red'], "'colour=red' is not allowed"),
    (['--set', 'arrival_soc_margin=nan'], 'arrival_soc_margin'),
    (['--set', 'arrival_soc_margin=much'], 'a number'), (['--set', 'estimation=1'], 'true or false'),
    (['--method', 'magic'], "'magic'"), (['--explain', 'nan'], 'seconds from the start'),
    (['--explain', '25:00'], 'such as 1500, or a time of day (UTC), 00:00:00 ... 23:59:59'),
    (['--explain', '9999'], '--explain: the recording has no step at 2'),
    # A time of day, as which 12:30 min of the outputs would be read.
    (['--explain', '23:30'], ' 23:30:00 UTC; it is '),
    (['--explain', '23:30'], 'give seconds from its start, 0 ... '),
    (['--method', 'paper', '--set', 'method=optimal_switch'],
     '--method: method: paper contradicts optimal_switch, which is given as well; leave one out'),
    (['--set', 'energy_price=0.3', '--set', 'energy_price=0.4'], '--set: energy_price: 0.4 contradicts 0.3'),
    (['--set', 'energy_price=0.3', '--change', 'energy_price=0.4'], '--change: energy_price: 0.4 contradicts 0.3'),
    (['--vehicle', 'reference', '--change', 'vehicle=small_car'], 'vehicle: small_car contradicts reference'),
    (['--change', 'hvch.efficiency=0.8', '--change', 'hvch.efficiency=0.9'], 'efficiency: 0.9 contradicts 0.8'),
    (['--change', 'temperature=+2', '--change', 'temperature==20'], '20 degC contradicts temperature + 2'),
    (['--explain', '60', '--to', '90'], '--to: not allowed'),
    (['--from', '9999'], '--from: the recording has no step at 2'), (['--to', '-5'], '--to: the recording'),
    (['--from', '300', '--to', '10'], 'is before --from'), (['--from', 'noon'], 'seconds from the start'),
    (['--route', 'reference'], '--route')])
def test_an_option_that_is_not_understood_is_one_line_with_unit_range_or_the_name_meant(
        recorded, refused, words, told):
    assert told in refused('replay', recorded[1], *words)


@pytest.mark.parametrize('signal', UNITS)
def test_a_number_replaces_and_a_sign_changes(signal):
    low, high = UNITS[signal][2]
    for value in (low, high):
        assert signal_change(signal, f'={value}').of(0.37) == value
    assert signal_change(signal, '+0.5').of(1.25) == 1.75 and signal_change(signal, '-0.5').of(1.25) == 0.75
    assert signal_change(signal, '*2').of(1.25) == 2.5


@pytest.fixture
def result_of(recorded, said):
    def run(change):
        status, output, _ = said('replay', recorded[1], '--to', '150', '--json', '-', '--change', change)
        assert status == 0
        return json.loads(output)
    return run


def test_a_target_replaces_that_of_the_route(result_of):
    """The recorded route asks for 12.5 degC."""
    by_value, by_difference = result_of('target=10.5'), result_of('target=-2')
    assert by_value['changed'] == by_difference['changed']
    assert by_value['changed']['hvch_commanded_wh'] < by_value['recorded']['hvch_commanded_wh']
    assert 'target 10.5 degC' in by_value['verdict'][-1]
    assert result_of('target_temperature=10.5')['changed'] == by_value['changed']


def test_a_key_of_the_vehicle_file_changes_the_planners_car(result_of):
    result = result_of('hvch.maximum_power_w=3000')
    assert 'With hvch.maximum_power_w=3000' in result['verdict'][-1]
    heated_s = sum(span['to_ns'] - span['from_ns'] for span in result['changed']['heating']) / 1e9
    assert heated_s > 60.0
    assert result['changed']['hvch_commanded_wh'] <= 3000.0 * (heated_s + 5.0) / 3600.0
