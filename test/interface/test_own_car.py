# SPDX-License-Identifier: Apache-2.0
"""`bp.check` and `bp.identify` do the work of the commands of their names."""

import pytest

import bev_preheat as bp
from bev_preheat.identification.check import predict
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
    errors_k = [predict(vehicle, trip).reading_c[-1] - trip.arrival_c for trip in trips]
    assert list(found.arrival_errors_k.values()) == errors_k
    assert found.worst_k == max(map(abs, errors_k)) == found.to_dict()['worst_k']


@pytest.mark.needs('pandas', 'matplotlib')
def test_a_check_has_a_frame_and_a_picture(recordings, tmp_path):
    found = bp.check(bp.load_vehicle('small_car'), recordings, replays=False)
    assert found.to_frame()['arrival_error_k'].to_dict() == found.arrival_errors_k
    found.plot(tmp_path / 'check.png')
    assert (tmp_path / 'check.png').stat().st_size > 10_000


@pytest.mark.needs('casadi', 'scipy')
def test_identify_refuses_too_few_recordings(recordings):
    with pytest.raises(bp.InvalidInput, match='2 usable logs; at least 3 are needed'):
        bp.identify(bp.load_vehicle('small_car'), recordings)
