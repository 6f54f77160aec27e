# SPDX-License-Identifier: Apache-2.0
"""The shipped routes: made from their descriptions, and with the promised properties."""

from dataclasses import fields

import numpy as np
import pytest

from bev_preheat.files.input_files import configuration_folder
from bev_preheat.route.csv_file import load_route
from bev_preheat.route.legs import load_legs
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import load_vehicle

REFERENCE = load_vehicle('reference')
FOLDER = configuration_folder('routes')
NAMES = sorted(path.stem for path in FOLDER.glob('*.csv'))


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
