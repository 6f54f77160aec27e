# SPDX-License-Identifier: Apache-2.0
"""The vehicle, the routes and the results that the tests of the public interface share."""

import pytest

import bev_preheat as bp


@pytest.fixture(scope='session')
def vehicle():
    return bp.load_vehicle('reference')


@pytest.fixture(scope='session')
def route(vehicle):
    return bp.load_route('reference', vehicle)


@pytest.fixture(scope='session')
def short_route(vehicle):
    """A quarter of an hour, because a drive takes time for each simulated second."""
    return bp.make_route({'duration_s': [300.0] * 3, 'speed_mps': 22.0, 'propulsion_power_w': [14e3, 22e3, 18e3],
                          'ambient_temperature_c': -7.0}, vehicle)


@pytest.fixture(scope='session')
def worth(vehicle, route):
    return bp.worth(vehicle, route, bp.BatteryState(-7.0, 0.9), 150e3, 0.8)


@pytest.fixture(scope='session')
def session(vehicle):
    """A charging session from 5 degC and 20 %."""
    return bp.charging_session(vehicle, bp.BatteryState(5.0, 0.2), 150e3, 0.8, -7.0)


@pytest.fixture(scope='session')
def drive(vehicle, short_route):
    """A drive of a warm battery; each battery state takes a plan, so they are 4 s apart, within all timeouts."""
    return bp.drive(vehicle, short_route, bp.BatteryState(20.0, 0.9), sensors=bp.Sensors(period_s=4.0))
