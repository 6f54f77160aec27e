# SPDX-License-Identifier: Apache-2.0
"""The vehicle and the routes of the tests of the public interface."""

import pytest

import bev_preheat as bp


@pytest.fixture(scope='module')
def vehicle():
    return bp.load_vehicle('reference')


@pytest.fixture(scope='module')
def route(vehicle):
    return bp.load_route('reference', vehicle)


@pytest.fixture(scope='module')
def short_route(vehicle):
    """A quarter of an hour, because a drive takes time for each simulated second."""
    return bp.make_route({'duration_s': [300.0] * 3, 'speed_mps': 22.0, 'propulsion_power_w': [14e3, 22e3, 18e3],
                          'ambient_temperature_c': -7.0}, vehicle)
