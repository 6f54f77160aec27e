# SPDX-License-Identifier: Apache-2.0
"""Vehicles made from another: factors, the coldest cell."""

import pytest

from bev_preheat.numerics import FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, limited_by_coldest_cell

VEHICLE = load_vehicle('reference')


def quantities(vehicle):
    battery = vehicle.battery
    return {
        'heat_capacity': battery.heat_capacity_j_per_k,
        'leakage at rest': battery.leakage.coefficient_w_per_k(0.0),
        'leakage at speed': battery.leakage.coefficient_w_per_k(31.0),
        'resistance': battery.resistance.function(FLOATS)(0.63, -7.0),
        'heater_efficiency': vehicle.hvch.efficiency,
        'heater power': vehicle.hvch.maximum_power_w,
        'voltage': battery.open_circuit_voltage.function(FLOATS)(0.63, -7.0),
        'capacity': battery.capacity_as,
        'drivetrain': vehicle.drivetrain.heat_to_battery_w(1.0)}


CHANGED = {'heat_capacity': {'heat_capacity'}, 'leakage': {'leakage at rest', 'leakage at speed'},
           'resistance': {'resistance'}, 'heater_efficiency': {'heater_efficiency'}}


@pytest.mark.parametrize('name', CHANGED)
@pytest.mark.parametrize('vehicle_name', ['reference', 'small_car'])
def test_each_factor_changes_its_own_quantity(name, vehicle_name):
    vehicle = load_vehicle(vehicle_name)
    before = quantities(vehicle)
    after = quantities(corrected_vehicle(vehicle, Corrections(**{name: 1.17})))
    assert after == pytest.approx({
        key: 1.17 * value if key in CHANGED[name] else value for key, value in before.items()})


@pytest.mark.parametrize('curve', ['discharge_power_limit', 'charge_power_limit'])
@pytest.mark.parametrize('temperature_c', [-22.0, 3.0, 17.5, 39.0])
def test_a_limit_is_that_of_the_coldest_cell(curve, temperature_c):
    limited = limited_by_coldest_cell(VEHICLE, 7.0)
    whole, coldest = (getattr(vehicle.battery, curve).function(FLOATS) for vehicle in (VEHICLE, limited))
    assert coldest(0.4, temperature_c) == pytest.approx(whole(0.4, temperature_c - 7.0))
