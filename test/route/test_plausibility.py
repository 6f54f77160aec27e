# SPDX-License-Identifier: Apache-2.0
"""Wrong units in a route raise warnings, right ones do not."""

from dataclasses import replace

import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.route.for_vehicle import route_for
from bev_preheat.route.plausibility import unit_warnings
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
ROUTE = route_for('reference', VEHICLE).route
ROUTES = sorted([*(path.stem for path in configuration_folder('routes').glob('*.csv')),
                 *(f'legs/{path.stem}' for path in configuration_folder('routes/legs').glob('*.yaml'))])
VEHICLES = sorted(path.stem for path in configuration_folder('vehicles').glob('*.yaml'))


def times(field, factor):
    return replace(ROUTE, **{field: factor * getattr(ROUTE, field)})


# Daily one vehicle for each route.
@pytest.mark.parametrize('route, vehicle', [
    pytest.param(route, vehicle, marks=[pytest.mark.deep] * (at % len(VEHICLES) != number))
    for at, route in enumerate(ROUTES) for number, vehicle in enumerate(VEHICLES)])
def test_no_route_that_comes_with_the_package_is_warned_of(route, vehicle):
    vehicle = load_vehicle(vehicle)
    try:
        loaded = route_for(route, vehicle).route
    except InvalidInput:
        # Its drivetrain is too weak for the road, or its road load is unknown.
        return
    assert unit_warnings([loaded], vehicle) == []


@pytest.mark.parametrize('route, field', [
    (replace(ROUTE, cabin_heating_power_w=0.0 * ROUTE.duration_s + 50e3), 'cabin_heating_power'),
    (replace(ROUTE, auxiliary_power_w=0.0 * ROUTE.duration_s + 50e3), 'auxiliary_power'),
    (replace(ROUTE, ambient_temperature_c=0.0 * ROUTE.duration_s + 59.0), 'ambient_temperature'),
    # In km/h.
    (times('speed_mps', 3.6), 'speed'),
    # In kW; and in mW.
    (replace(ROUTE, **{name: getattr(ROUTE, name) / 1e3 for name in (
        'propulsion_power_w', 'propulsion_power_rms_w', 'propulsion_power_magnitude_w')}), 'propulsion_power'),
    (times('propulsion_power_w', 100.0), 'propulsion_power')])
def test_a_wrong_unit_is_named(route, field):
    (warning,) = unit_warnings([ROUTE, route], VEHICLE)
    assert warning.startswith(f'{field}: ') and warning.endswith('; check the unit')


def test_in_a_car_without_a_heater_the_cabin_is_warmed_by_another_source():
    assert unit_warnings([ROUTE], replace(VEHICLE, hvch=replace(VEHICLE.hvch, maximum_power_w=0.0))) == []
