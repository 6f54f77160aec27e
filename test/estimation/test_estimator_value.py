# SPDX-License-Identifier: Apache-2.0
"""The Estimator as a value: plain data, and the same estimates after it was written and read back."""

from contextlib import nullcontext
from dataclasses import replace
import pickle

from driven_car import Commands, Course, DrivenCar, observed, VEHICLE
from plain_values import not_plain
import pytest

from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.soak import after_soak
from bev_preheat.native.library import without_core
from bev_preheat.planning.situation import BatteryState

SECONDS = 1300
HEATED = Commands(((30, 900),))
# The heater is dead until it is repaired.
REPAIRED_S = 700
# What happens at these seconds.
SOAK_S, CLOCK_S, ACQUITTED_S, ROUTE_S, JUMP_S = 0, 760, 800, 820, 1200
# Between these seconds: a reading that is too warm [K], a state that the model does not describe, a silence.
SPIKE_S, HELD_S, SILENCE_S = (150, 320), (950, 1000), (1050, 1120)


def states():
    """Yield (second, MeasuredState) of a drive in which all sorts of things happen."""
    car = DrivenCar(commands=HEATED, seed=5, traffic_w=800.0,
                    heater=lambda second, commanded_w: commanded_w if second > REPAIRED_S else 0.0)
    for second in range(SECONDS):
        measurement = car.drive()
        spike_k = 2.0 if SPIKE_S[0] <= second < SPIKE_S[1] else 20.0 if second >= JUMP_S else 0.0
        if not SILENCE_S[0] <= second < SILENCE_S[1]:
            yield second, replace(measurement, state=BatteryState(
                measurement.state.temperature_c + spike_k, measurement.state.soc))


def estimators(written_at=()):
    """Return the Estimator after each state; it is written and read back at some seconds."""
    estimator, passed = Estimator.of(VEHICLE), []
    for second, measurement in states():
        if second in written_at:
            estimator = pickle.loads(pickle.dumps(estimator))
        if second == SOAK_S:
            estimator = estimator.after_soak(after_soak(VEHICLE, -10.0, 3600.0))
        if second == CLOCK_S:
            estimator = estimator.without_instants()
        if second == ACQUITTED_S:
            estimator = estimator.of_healthy_heater()
        if second == ROUTE_S:
            estimator = estimator.of_another_route()
        estimator = (estimator.held(measurement, VEHICLE, second % 20 != 0) if HELD_S[0] <= second < HELD_S[1]
                     else observed(estimator, measurement, Course(known=second % 100 > 5), HEATED))
        passed.append(estimator)
    return passed


def digits(estimators):
    """Return all numbers of the estimates, to the last digit."""
    return [(each.estimate.mean.tobytes(), each.estimate.covariance.tobytes(), each.estimate.heater,
             each.estimate.resets, each.estimate.sensor_offset_k, each.estimate.ignored_share,
             each.belief.weights.tobytes(), each.belief.mean.tobytes()) for each in estimators]


@pytest.mark.parametrize('context', [nullcontext, without_core])
def test_an_estimator_is_plain_data_and_goes_on_the_same_after_it_was_written_and_read_back(context):
    with context():
        passed = estimators()
        assert [place for estimator in passed[::10] for place in not_plain(estimator)] == []
        assert digits(estimators(range(0, SECONDS, 7))) == digits(passed)
    # All sorts of things have happened.
    assert Heater.DEAD in {each.estimate.heater.heater for each in passed}
    assert passed[-1].resets == 1
    assert passed[0].offset_k != 0.0
    assert passed[SPIKE_S[1]].readings.ignored_share > 0.2


def test_an_earlier_estimator_is_not_changed_by_later_states():
    passed = estimators()
    kept = passed[400]
    before = pickle.dumps(kept)
    later = observed(kept, next(state for second, state in states() if second == 401), Course(), HEATED)
    later.of_healthy_heater().of_another_route().without_instants()
    assert pickle.dumps(kept) == before
