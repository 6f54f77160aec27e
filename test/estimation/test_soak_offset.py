# SPDX-License-Identifier: Apache-2.0
"""Sensor offset after a soak, compared with an integration and limits."""

from dataclasses import replace
import math

import numpy as np
import pytest

from bev_preheat.control.inputs import Measurement
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.prior import after_soak, expected_offset_k
from bev_preheat.planning.situation import BatteryState
from bev_preheat.tunables import (
    AMBIENT_DEVIATION_K,
    OFFSET_DEVIATION_K,
    PARKED_DEVIATION_K,
    PARKED_WARMER_K,
    READING_NOISE_K,
)
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Uncertainty

VEHICLE = load_vehicle('reference')
HOUR_S = 3600.0
NIGHT = after_soak(VEHICLE, -7.0, 24.0 * HOUR_S)
NOISE = READING_NOISE_K**2


def test_a_battery_cools_as_the_vehicles_leakage_lets_it():
    gamma = VEHICLE.battery.leakage.coefficient_w_per_k(0.0)
    warmer_k = PARKED_WARMER_K
    for _ in range(7200):
        warmer_k -= gamma * warmer_k / VEHICLE.battery.heat_capacity_j_per_k
    assert after_soak(VEHICLE, -7.0, 7200.0).temperature_c == pytest.approx(
        -7.0 + warmer_k, abs=1e-3)


@pytest.mark.parametrize('share, uncertainty', [
    (1.0, VEHICLE.uncertainty), (0.6, Uncertainty(heat_capacity=0.0346, leakage=0.0693))])
def test_how_far_it_spreads_is_that_of_drawn_cars(share, uncertainty):
    random = np.random.default_rng(3)
    count, standing_s = 100_000, 3.0 * HOUR_S
    parked_k = random.normal(PARKED_WARMER_K, PARKED_DEVIATION_K, count)
    gamma = VEHICLE.battery.leakage.coefficient_w_per_k(0.0) * (1.0 + share * random.uniform(-0.2, 0.2, count))
    capacity = VEHICLE.battery.heat_capacity_j_per_k * (1.0 + share * random.uniform(-0.1, 0.1, count))
    left_k = parked_k * np.exp(-gamma / capacity * standing_s)
    standing = after_soak(replace(VEHICLE, uncertainty=uncertainty), 0.0, standing_s)
    assert standing.temperature_c == pytest.approx(left_k.mean(), rel=0.05)
    assert standing.left_deviation_k == pytest.approx(left_k.std(), rel=0.1)


def test_residual_warmth_is_no_offset_where_nobody_measured_the_leakage():
    """
    A battery 6 K warmer than the air after 10 h lost a third of the assumed heat, which a sensor does not explain.

    Drawn cars say how far the temperature spreads, by a leakage of a factor e^0.8.
    """
    random = np.random.default_rng(4)
    assumed = replace(VEHICLE, assumed=('battery.leakage',), uncertainty=Uncertainty())
    standing_s = 10.0 * HOUR_S
    standing = after_soak(assumed, 8.0, standing_s)
    rate = VEHICLE.battery.leakage.coefficient_w_per_k(0.0) / VEHICLE.battery.heat_capacity_j_per_k * np.exp(
        random.normal(0.0, math.hypot(0.8, 0.058), 200_000))
    left_k = random.normal(PARKED_WARMER_K, PARKED_DEVIATION_K, len(rate)) * np.exp(-rate * standing_s)
    assert standing.left_deviation_k == pytest.approx(
        math.sqrt(np.mean((left_k + 8.0 - standing.temperature_c)**2)), rel=0.02)
    measured, unmeasured = (expected_offset_k(after_soak(car, 8.0, standing_s), 14.0, NOISE)
                            for car in (VEHICLE, assumed))
    assert unmeasured < 0.65 * measured
    told = replace(assumed, uncertainty=Uncertainty(leakage=0.1))
    assert expected_offset_k(after_soak(told, 8.0, standing_s), 14.0, NOISE) == pytest.approx(measured, rel=0.01)


@pytest.mark.parametrize('difference_k', [0.5, 2.0, 3.0])
def test_a_difference_is_shared_between_sensor_and_forecast(difference_k):
    warm = expected_offset_k(NIGHT, -7.0 + difference_k, NOISE)
    cold = expected_offset_k(NIGHT, -7.0 - difference_k, NOISE)
    most = difference_k * OFFSET_DEVIATION_K**2 / (
        OFFSET_DEVIATION_K**2 + AMBIENT_DEVIATION_K**2)
    assert 0.8 * most < warm < most
    assert cold == pytest.approx(-warm, abs=0.01)


def test_the_offset_is_bounded_whatever_is_read():
    readings_c = np.linspace(-60.0, 60.0, 2401)
    offsets_k = [expected_offset_k(NIGHT, reading_c, NOISE) for reading_c in readings_c.tolist()]
    assert np.abs(offsets_k).max() < 2.5
    assert math.isfinite(expected_offset_k(NIGHT, 1e6, NOISE))


def state(stamp_s, temperature_c):
    return Measurement(BatteryState(temperature_c, 0.8), round(stamp_s * 1e9))


@pytest.mark.parametrize('seen_before', [False, True])
def test_the_estimator_subtracts_the_offset_from_this_reading_on(seen_before):
    estimator = Estimator.of(VEHICLE)
    if seen_before:
        estimator = estimator.observed(state(0.0, -5.0), (), VEHICLE)
        assert estimator.estimate.temperature_c == pytest.approx(-5.0)
    estimator = estimator.after_soak(NIGHT)
    estimator = estimator.observed(state(10.0, -5.0), (), VEHICLE)
    offset_k = estimator.estimate.sensor_offset_k
    assert 0.5 < offset_k < 1.0
    assert estimator.estimate.temperature_c == pytest.approx(-5.0 - offset_k)
    # After a gap the battery restarts from the next reading; the sensor is the same.
    estimator = estimator.observed(state(500.0, -4.0), (), VEHICLE)
    assert estimator.estimate.temperature_c == pytest.approx(-4.0 - offset_k)
