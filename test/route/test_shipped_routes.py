# SPDX-License-Identifier: Apache-2.0
"""The shipped routes: made from their descriptions, and with the promised properties."""

from dataclasses import fields

import numpy as np
import pytest

from bev_preheat.files.configuration import configuration_folder
from bev_preheat.route.csv_file import load_route
from bev_preheat.route.for_vehicle import route_for
from bev_preheat.route.legs import load_legs
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import load_vehicle

REFERENCE = load_vehicle('reference')
FOLDER = configuration_folder('routes')
NAMES = sorted(path.stem for path in FOLDER.glob('*.csv'))
VEHICLES = sorted(path.stem for path in configuration_folder('vehicles').glob('*.yaml'))


def shipped(name):
    # The files are complete, so no vehicle's defaults are needed.
    return load_route(name, None)


def test_each_route_has_its_description_and_the_other_way_round():
    assert NAMES == sorted(path.stem for path in (FOLDER / 'legs').glob('*.yaml'))
    assert NAMES


@pytest.mark.costly
@pytest.mark.parametrize('name', NAMES)
def test_the_file_holds_what_its_description_makes(name):
    made = load_legs(name, REFERENCE)
    assert made.name == name
    for field in fields(Route):
        # Half a unit of the last digit in the file, plus another machine's rounding.
        digit = 1e-3 if field.name.endswith('_w') else 1e-6
        np.testing.assert_allclose(getattr(shipped(name), field.name),
                                   getattr(made.route, field.name), rtol=0.0, atol=0.6 * digit)


@pytest.mark.parametrize('name', NAMES)
def test_the_file_names_the_command_that_made_it(name):
    assert (f'preheat route --legs {name} --vehicle reference --output config/routes/{name}.csv'
            in (FOLDER / f'{name}.csv').read_text(encoding='utf-8'))


def test_the_reference_is_the_papers_trip():
    route = shipped('reference')
    power_w, duration_s = route.propulsion_power_w, route.duration_s
    assert duration_s.tolist() == [30.0] * 120
    assert route.distance_m == pytest.approx(73e3, abs=0.001)
    assert np.abs(power_w) @ duration_s / 3600.0 == pytest.approx(18800.0, abs=0.001)
    assert power_w @ duration_s / 3600.0 == pytest.approx(18722.0, abs=0.001)
    np.testing.assert_array_equal(route.propulsion_power_rms_w, np.abs(power_w))
    assert set(route.ambient_temperature_c) == {-7.0}
    assert set(route.cabin_heating_power_w) == {1978.0}
    assert set(route.auxiliary_power_w) == {500.0}


def test_calibration_of_the_reference_is_a_matter_of_percent():
    scales = [float(remark.split('scaled by ')[1].split()[0])
              for remark in load_legs('reference', REFERENCE).remarks]
    assert len(scales) == 3
    assert all(abs(scale - 1.0) < 0.05 for scale in scales)


def test_the_winter_commute_is_too_short_to_warm_the_reference_battery():
    route = shipped('winter_commute')
    assert 15 * 60.0 <= route.total_duration_s <= 20 * 60.0
    assert np.all((route.ambient_temperature_c >= -12.0) & (route.ambient_temperature_c <= -7.0))
    # Full heater power, all drivetrain heat, and twice the Joule heat of 0.1 ohm at
    # 400 V, into 378 kJ/K without any leakage.
    power_w = (0.87 * (7000.0 - route.cabin_heating_power_w)
               + 0.08 * np.abs(route.propulsion_power_w)
               + 2.0 * 0.1 * (route.propulsion_power_rms_w + 7500.0)**2 / 400.0**2)
    warmest_c = -7.0 + power_w @ route.duration_s / 378e3
    assert warmest_c < 15.0


def test_the_city_varies_within_its_segments():
    route = shipped('city_stop_and_go')
    total_s = route.total_duration_s
    mean_w = route.propulsion_power_w @ route.duration_s / total_s
    rms_w = np.sqrt(route.propulsion_power_rms_w**2 @ route.duration_s / total_s)
    of_means_w = np.sqrt(route.propulsion_power_w**2 @ route.duration_s / total_s)
    assert rms_w > 3.0 * mean_w
    assert rms_w > 2.0 * of_means_w


def test_the_pass_has_a_long_descent_and_a_valley_behind_it():
    route = shipped('alpine_pass')
    descending = (route.propulsion_power_w < -20e3) & (route.propulsion_power_w > -40e3)
    first, last = np.flatnonzero(descending)[[0, -1]]
    assert np.all(descending[first:last + 1])
    assert route.duration_s[first:last + 1].sum() >= 20 * 60.0
    assert route.duration_s[last + 1:].sum() >= 20 * 60.0
    assert route.propulsion_power_w[last + 5:-4].min() > 0.0
    # The climb.
    assert route.propulsion_power_w[:first].max() > 40e3
    assert 70 * 60.0 <= route.total_duration_s <= 90 * 60.0
    assert route.ambient_temperature_c[0] == route.ambient_temperature_c[-1] == -8.0
    assert route.ambient_temperature_c[first] == pytest.approx(-12.0, abs=0.2)


def test_the_motorway_lasts_three_hours():
    route = shipped('motorway_3h')
    assert route.total_duration_s == pytest.approx(3 * 3600.0, abs=1e-3)
    assert np.median(route.speed_mps) * 3.6 > 85.0


# Daily one route for each vehicle.
@pytest.mark.costly
@pytest.mark.parametrize('name, vehicle', [
    pytest.param(name, vehicle, marks=[pytest.mark.deep] * (at % len(NAMES) != number))
    for at, vehicle in enumerate(VEHICLES) for number, name in enumerate(NAMES)])
def test_every_shipped_vehicle_drives_the_same_road(name, vehicle):
    driven = route_for(f'legs/{name}', load_vehicle(vehicle)).route
    for field in ('duration_s', 'speed_mps', 'ambient_temperature_c'):
        np.testing.assert_array_equal(getattr(driven, field), getattr(shipped(name), field))
