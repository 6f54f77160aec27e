# SPDX-License-Identifier: Apache-2.0
"""Commands accepted by the simulated heater."""

import math

import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.simulation.heater_lease import HeaterLease, lease_of_command


def test_good_command_is_a_lease():
    assert lease_of_command(2500.0, 14.0, now_s=11.0, maximum_power_w=7000.0) == HeaterLease(
        power_w=2500.0, until_s=14.0)


@pytest.mark.parametrize('power_w, until_s, message', [
    (math.nan, 14.0, 'battery_heating_power: nan W is not allowed; it must be 0 ... 7000 W'),
    (-1.0, 14.0, 'battery_heating_power: -1 W'),
    (7001.0, 14.0, 'battery_heating_power: 7001 W'),
    (math.inf, 14.0, 'battery_heating_power: inf W'),
    (0.0, 11.0, 'valid_until: is 0.000 s in the past'),
    (2500.0, 8.5, 'valid_until: is 2.500 s in the past'),
])
def test_bad_command_is_refused(power_w, until_s, message):
    with pytest.raises(InvalidInput, match=message):
        lease_of_command(power_w, until_s, now_s=11.0, maximum_power_w=7000.0)
