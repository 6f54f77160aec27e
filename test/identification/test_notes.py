# SPDX-License-Identifier: Apache-2.0
"""Comments of an identified file: the interval beside a value is that of the value."""

from dataclasses import replace
import re
from types import SimpleNamespace

import pytest

from bev_preheat.identification.result import Estimated
from bev_preheat.identification.vehicle_file import notes_of
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath

VEHICLE = replace(load_vehicle('reference'), heat_path=HeatPath(0.0, 20e3, 400.0, 12.0))


@pytest.mark.parametrize('name, key, estimate, value', [
    ('heat_capacity', 'battery.heat_capacity_j_per_k', VEHICLE.battery.heat_capacity_j_per_k + 20e3,
     VEHICLE.battery.heat_capacity_j_per_k),
    ('drivetrain_heat', 'drivetrain.heat_recovery_efficiency', VEHICLE.drivetrain.heat_share,
     VEHICLE.drivetrain.heat_recovery_efficiency),
    ('heat_lag', 'heat_path.coolant_conductance_w_per_k', 50.0, 400.0),
    ('sensor_lag', 'heat_path.sensor_lag_s', 12.0, 12.0),
    ('heater_efficiency', 'hvch.efficiency', VEHICLE.hvch.efficiency, VEHICLE.hvch.efficiency)])
def test_the_interval_contains_the_value_beside_it(name, key, estimate, value):
    """An interval of 1 % about the estimate is one of about 1 % about the value of the file."""
    item = Estimated(name, name, 'unit', estimate, estimate, 0.99 * estimate, 1.01 * estimate, 0.0, 1e9, True, 0.0,
                     '', key)
    result = SimpleNamespace(
        estimates=(item,), vehicle=VEHICLE, electrical=SimpleNamespace(used=()),
        coverage=SimpleNamespace(resistance_from_c=None, resistance_to_c=None, soc=(0.2, 0.9)))
    low, high = map(float, re.search(r'interval (\S+) ... (\S+)', notes_of(result)[key]).groups())
    assert low < value < high
    assert high - low == pytest.approx(0.02 * value, rel=0.1)
