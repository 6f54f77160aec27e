# SPDX-License-Identifier: Apache-2.0
"""`bp.check` and `bp.identify` do the work of the commands of their names."""

import pytest

import bev_preheat as bp
from bev_preheat.identification.prediction import predict
from bev_preheat.identification.trips import trip_of
from bev_preheat_studies.identification.synthetic_car import draw_car, record_car


@pytest.fixture(scope='module')
def recordings():
    import numpy as np
    generator = np.random.default_rng(4)
    return record_car(draw_car(generator, bp.load_vehicle('small_car')), generator)[:2]


def test_check_has_the_error_of_each_recording(recordings):
    vehicle = bp.load_vehicle('small_car')
    found = bp.check(vehicle, recordings, replays=False)
    trips = [trip_of(recording, vehicle) for recording in recordings]
    assert found.errors_k == [predict(vehicle, trip).reading_c[-1] - trip.arrival_c for trip in trips]


@pytest.mark.needs('casadi')
@pytest.mark.needs('scipy')
def test_identify_refuses_too_few_recordings(recordings):
    with pytest.raises(bp.InvalidInput, match='2 usable logs; at least 3 are needed'):
        bp.identify(bp.load_vehicle('small_car'), recordings)
