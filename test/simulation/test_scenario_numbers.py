# SPDX-License-Identifier: Apache-2.0
"""Whole numbers in a scenario are floats: a ROS message refuses integers there."""

from pathlib import Path

import yaml

from bev_preheat.simulation.scenario import load_scenario

SCENARIO = Path(__file__).resolve().parents[2] / 'config/scenarios/two_batteries.yaml'


def test_whole_numbers_of_another_battery_are_floats(tmp_path):
    contents = yaml.safe_load(SCENARIO.read_text())
    contents['sensors']['other'].update(temperature_c=20, soc=1, voltage_v=12)
    file = tmp_path / 'whole.yaml'
    file.write_text(yaml.safe_dump(contents))
    other = load_scenario(file).imperfections.sensors.other
    numbers = (other.temperature_c, other.soc, other.voltage_v)
    assert numbers == (20.0, 1.0, 12.0)
    assert all(isinstance(number, float) for number in numbers)
