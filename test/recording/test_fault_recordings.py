# SPDX-License-Identifier: Apache-2.0
"""A scenario with a fault leaves a recording that is reproduced, and whose report names the fault."""

import html
import json

import pytest

pytestmark = [pytest.mark.costly, pytest.mark.needs('mcap', 'jinja2')]

# A part of a sentence in the report, by scenario. The heater's, signals' and inputs' own words, not the plan's.
NAMED = {
    'heater_dead': 'dead: the battery does not get the commanded heat',
    'heater_derated': 'derated: it gives only',
    'heater_stuck_on': 'stuck on: the battery is heated without a command',
    'temperature_stuck': 'temperature: has read 18.00 degC for',
    'temperature_never_set': 'temperature: has read 0.00 degC since the first state',
    'temperature_unknown': 'temperature: nan is not a known value',
    'rare_nan': 'temperature: nan is not a known value',
    'voltage_too_low': 'voltage: ',
    'current_reversed': 'current: ',
    'charge_in_percent': 'percentage: ',
    'charge_never_set': 'percentage: 0.0 % contradicts',
    'two_batteries': 'battery_state comes from two batteries',
    'two_locations': 'battery_state comes from two batteries',
    'battery_state_drop_out': 'less than 5 s are allowed',
    'spikes': 'of the latest readings were ignored',
    'sensor_offset': 'the temperature sensor reads up to 1.0 K too warm',
    'clock_back': 'the clock went back by',
    'clock_forward': 'its clock was set forward',
    'late_and_lossy': 'battery_state arrives 2.0 s old',
    'reordered_states': 'battery states were overtaken by later ones',
    'late_without_a_word': 'behind its route; the planner learned it from power or position',
    'charging_cancelled': 'No fast charging at the end of this route',
    'drives_past': '15 % chance of charging',
    'charger_taken': '% chance of charging',
}


# Daily, test_report.py has the report of a drive, test_inputs.py the inputs' time, and the tutorial a heater.
@pytest.mark.deep
@pytest.mark.parametrize('name', NAMED)
def test_report_names_the_fault(name, said, tmp_path):
    # Whether the drive goes as expected is another test's question.
    said('scenario', name, '--record', '.')
    status, output, _ = said('replay', f'{name}.mcap', '--report', 'report.html', '--json', '-')
    assert status == 0 and json.loads(output)['reproduced']
    assert NAMED[name] in html.unescape((tmp_path / 'report.html').read_text())


@pytest.mark.deep
def test_report_of_a_drive_without_a_fault_names_none(said):
    said('scenario', 'nominal', '--record', '.')
    assert json.loads(said('replay', 'nominal.mcap', '--json', '-')[1])['remarks'] == []
