# SPDX-License-Identifier: Apache-2.0
"""A trip's columns from the core and from Python."""

from ctypes import addressof
from dataclasses import replace

import drawn_situations
import numpy as np
import pytest

from bev_preheat.planning.trip import Trip, uncached_trip
from bev_preheat.route.segments import make_route
from bev_preheat.tunables import LONGEST_STEP_S
from bev_preheat.vehicle.core_calls import place
from bev_preheat.vehicle.core_library import core
from bev_preheat.vehicle.core_structs import TripTermsStruct
from bev_preheat.vehicle.model import TRIP_COLUMNS

CAR = drawn_situations.car(drawn_situations.CARS[0])
COLUMNS = [name for name in TRIP_COLUMNS if hasattr(Trip, name)]

BAD_ARGUMENT = -1


def call(null=None, steps=3):
    terms = TripTermsStruct(5.0, 0.1, 0.08, 600.0, 7e3, 1.0, 0.0)
    route = np.ones((8, steps))
    return core().bev_make_trip(
        None if null == 'terms' else addressof(terms), steps, None if null == 'route' else place(route),
        None if null == 'columns' else place(np.empty(len(TRIP_COLUMNS) * steps + 1)))


def test_a_changed_trip_has_the_other_columns_of_the_old_one():
    vehicle, route, *_ = drawn_situations.draw(3, 20)
    trip = uncached_trip(vehicle, route, 1.0, 0.0)
    limit_w = 0.3 * trip.heater_limit_w
    changed = trip.changed(heater_limit_w=limit_w)
    assert changed.heater_limit_w.tolist() == limit_w.tolist()
    for name in {*COLUMNS} - {'heater_limit_w'}:
        assert getattr(changed, name).tolist() == getattr(trip, name).tolist(), name
    # The old one is as before.
    assert trip.heater_limit_w.tolist() != limit_w.tolist()
    with pytest.raises(TypeError, match='idle_w: not columns of a trip'):
        trip.changed(idle_w=limit_w)


@pytest.mark.parametrize('leakage_times', [1.0, 200.0])
def test_a_segment_that_is_too_long_is_divided(leakage_times):
    leaky = replace(CAR, battery=replace(CAR.battery, leakage=replace(
        CAR.battery.leakage, gamma_0_w_per_k=leakage_times * CAR.battery.leakage.gamma_0_w_per_k)))
    duration_s = LONGEST_STEP_S if leakage_times > 1.0 else 1.01 * LONGEST_STEP_S
    route = make_route({
        'duration_s': [40.0, duration_s], 'speed_mps': [0.0, 11.0], 'propulsion_power_w': [7e3, 9e3],
        'ambient_temperature_c': [-3.0]}, CAR.defaults)
    trip, expected = drawn_situations.in_both(lambda: uncached_trip(leaky, route, 1.0, 0.0))
    assert len(trip.route) == len(expected.route) > 2
    assert trip.idle_heat_w.tolist() == expected.idle_heat_w.tolist()


@pytest.mark.parametrize('null', ['terms', 'route', 'columns'])
def test_a_null_pointer_is_refused(null):
    assert call() == 0
    assert call(null=null) == BAD_ARGUMENT
