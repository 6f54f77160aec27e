# SPDX-License-Identifier: Apache-2.0
"""Power limits of the coldest cell."""

import pytest

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.cell_spread import limited_by_coldest_cell

VEHICLE = load_vehicle('reference')


@pytest.mark.parametrize('curve', ['discharge_power_limit', 'charge_power_limit'])
@pytest.mark.parametrize('temperature_c', [-22.0, 3.0, 17.5, 39.0])
def test_a_limit_is_that_of_the_coldest_cell(curve, temperature_c):
    limited = limited_by_coldest_cell(VEHICLE, 7.0)
    whole, coldest = (getattr(vehicle.battery, curve).function(FLOATS) for vehicle in (VEHICLE, limited))
    assert coldest(0.4, temperature_c) == pytest.approx(whole(0.4, temperature_c - 7.0))


def test_the_charger_sees_it_too_and_nothing_else_changes():
    limited = limited_by_coldest_cell(VEHICLE, 7.0)
    assert limited.charging.power_limit.function(FLOATS)(0.2, 10.0) == pytest.approx(
        VEHICLE.charging.power_limit.function(FLOATS)(0.2, 3.0))
    for unchanged in ('open_circuit_voltage', 'resistance', 'leakage', 'heat_capacity_j_per_k'):
        assert getattr(limited.battery, unchanged) is getattr(VEHICLE.battery, unchanged)
    assert limited_by_coldest_cell(VEHICLE, 0.0) is VEHICLE
