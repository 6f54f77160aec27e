# SPDX-License-Identifier: Apache-2.0
"""The filters: comparison with a scalar Kalman filter, conservation, bounds, and finite numbers."""

from dataclasses import replace

from driven_car import AMBIENT_C, DRIVE, LIMIT_W, VEHICLE
import numpy as np
import pytest

from bev_preheat.estimation.belief import Belief, WANDER_IN_AN_HOUR
from bev_preheat.estimation.estimate import (
    FACTORS,
    HEATER,
    LOCAL,
    PROPULSION,
    RESISTANCE,
    SENSOR,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.estimation.hypotheses import SHARES
from bev_preheat.estimation.prior import (
    FACTOR_BOUNDS,
    LAGS,
    Lags,
    Learned,
    PLACING,
)
from bev_preheat.tunables import (
    LOCAL_DEVIATION_K,
    LOCAL_LAG_S,
    NOMINAL_HEAT_LAG_S,
    NOMINAL_SENSOR_LAG_S,
    SIGNAL_NOISE_K,
)
from bev_preheat.vehicle.description import Uncertainty

# No Joule heat, no drivetrain heat: only leakage changes the temperature.
STILL = replace(DRIVE, speed_mps=0.0, propulsion_power_w=0.0, cabin_heating_power_w=0.0, auxiliary_power_w=0.0,
                terminal_power_w=0.0)


def placed(learned=None):
    return Belief.of(VEHICLE, learned).placed(-5.0, 0.4, 0.8, 1e-4)


def changed(belief, mean=(), covariance=()):
    """Return a Belief with other values in elements of the means and on the diagonals of the covariances."""
    means, covariances = belief.mean.copy(), belief.covariance.copy()
    for element, value in mean:
        means[..., element] = value
    for element, value in covariance:
        covariances[..., element, element] = value
    return replace(belief, mean=means, covariance=covariances)


def test_the_evidence_of_a_reading_is_its_likelihood_and_always_a_number():
    belief = changed(placed(), mean=[(SENSOR, -5.0), (LOCAL, 0.0)])
    deviation_k = np.sqrt(belief.covariance[0, 0, SENSOR, SENSOR] + belief.covariance[0, 0, LOCAL, LOCAL] + 2.0 *
                          belief.covariance[0, 0, SENSOR, LOCAL] + SIGNAL_NOISE_K**2 + 0.5**2 / 12.0)
    seen = belief.evidence(-5.0, 0.5)
    assert seen == pytest.approx(-np.log(deviation_k))
    assert seen - belief.evidence(-5.0 + deviation_k, 0.5) == pytest.approx(0.5)
    # One wild reading decides nothing.
    assert seen - belief.evidence(60.0, 0.5) == pytest.approx(1.0)
    for value in np.nan, np.inf:
        for lost in changed(belief, mean=[(SENSOR, value)]), changed(belief, covariance=[(SENSOR, value)]):
            assert np.isfinite(lost.evidence(-5.0, 0.5))


def test_temperature_is_that_of_a_kalman_filter_written_here():
    # Factors, lags and rises are known, so only core, heat under way, sensor and local rise are left.
    belief = placed(Learned(np.zeros(6), np.zeros((6, 6)), Lags(np.zeros(2), np.zeros(2))))
    belief = changed(belief, *[[(element, 0.0) for element in PLACING]] * 2)
    gamma = VEHICLE.battery.leakage.coefficient_w_per_k(0.0)
    decay = 10.0 * gamma / VEHICLE.battery.heat_capacity_j_per_k
    # Over 10 s the sensor follows a battery that changes linearly.
    left, heat_left = (np.exp(-10.0 / lag_s) for lag_s in (NOMINAL_SENSOR_LAG_S, NOMINAL_HEAT_LAG_S))
    behind, late = NOMINAL_SENSOR_LAG_S / 10.0 * (1.0 - left), NOMINAL_HEAT_LAG_S / 10.0 * (1.0 - heat_left)
    battery = np.array([1.0 - decay * (1.0 - late), 1.0 - heat_left, 0.0, 0.0])
    sensor = np.array([1.0 - left, 0.0, left, 0.0]) + (1.0 - behind) * (battery - [1.0, 0.0, 0.0, 0.0])
    step = np.stack((battery, [-decay * late, heat_left, 0.0, 0.0], sensor,
                     [0.0, 0.0, 0.0, np.exp(-10.0 / LOCAL_LAG_S)]))
    constant = decay * AMBIENT_C * np.array([1.0 - late, late, (1.0 - behind) * (1.0 - late), 0.0])
    mean, covariance = np.array([-5.0, 0.0, -5.0, 0.0]), np.zeros((4, 4))
    moving = [TEMPERATURE, UNDER_WAY, SENSOR, LOCAL]
    covariance[np.ix_([0, 2], [0, 2])] = 0.4
    # The reading is the sum of sensor and local rise.
    read = np.array([0.0, 0.0, 1.0, 1.0])
    for reading_c in (-4.2, -5.6, -5.1, -4.9, -6.0):
        mean = step @ mean + constant
        covariance = step @ covariance @ step.T + np.diag(
            WANDER_IN_AN_HOUR[moving]**2 * 10.0 / 3600.0)
        gain = covariance @ read / (read @ covariance @ read + SIGNAL_NOISE_K**2)
        mean = mean + gain * (reading_c - read @ mean)
        covariance = covariance - np.outer(gain, read @ covariance)
        belief = belief.mixed(10.0).moved(VEHICLE, 10.0, STILL, 0.0, LIMIT_W)
        belief = belief.with_temperature(reading_c, 0.0)
    assert LOCAL_DEVIATION_K**2 == pytest.approx(WANDER_IN_AN_HOUR[LOCAL]**2 / 3600.0 * LOCAL_LAG_S / 2.0)
    seen = np.ix_(moving, moving)
    # The other heaters' filters hardly mix in, because heaters fail once in hundreds of hours.
    assert belief.mean[0, 0, moving] == pytest.approx(mean, rel=1e-4)
    # The variance of heat under way is near 0.
    assert belief.covariance[0, 0][seen] == pytest.approx(covariance, rel=5e-3, abs=1e-8)


@pytest.mark.parametrize('power_w', [41900.0, None])
def test_no_hypothesis_is_likelier_because_less_joule_heat_expects_less_noise(power_w):
    """All expect the same readings, some with half the resistance: no reading may tell them apart by its noise."""
    belief = changed(placed(), mean=[(element, 0.0) for element in (LOCAL, *PLACING)])
    mean = belief.mean.copy()
    mean[1:, :, RESISTANCE] = np.log(0.5)
    known = replace(belief, mean=mean, covariance=np.zeros(belief.covariance.shape))
    driven = known.followed(VEHICLE, 10.0, replace(
        DRIVE, propulsion_power_w=40e3, propulsion_power_magnitude_w=40e3, terminal_power_w=power_w), 0.0, LIMIT_W)
    warming_k = driven.mean[:, 0, TEMPERATURE] + 5.0
    assert warming_k[0] > 1.5 * warming_k[1] > 0.0
    for element, least in (LOCAL, 0.01), (TEMPERATURE, 1e-5):
        noise = driven.covariance[..., element, element]
        assert noise.min() > least
        assert noise == pytest.approx(noise[0, 0], rel=0.02), element


def test_propulsion_power_moves_its_factor_and_nothing_more_than_it_may():
    belief = placed()
    for _ in range(200):
        belief = belief.with_propulsion_power(17.6e3, 16e3, 10.0)
    assert belief.mean[0, 0, PROPULSION] == pytest.approx(np.log(1.1), abs=0.03)
    assert belief.mean[0, 0, HEATER] == 0.0
    for _ in range(2000):
        belief = belief.with_propulsion_power(1e9, 16e3, 10.0)
        # A true state that wanders keeps the filter's variance up.
        belief = changed(belief, covariance=[
            (PROPULSION, belief.covariance[..., PROPULSION, PROPULSION] + 1e-3)])
    assert belief.mean[..., PROPULSION].max() == FACTOR_BOUNDS[PROPULSION]


@pytest.mark.parametrize('seed', range(6))
def test_any_stream_leaves_numbers_probabilities_and_covariances(seed):
    drawn, belief = np.random.default_rng(seed), placed()
    for _ in range(400):
        kind = drawn.integers(5)
        if kind == 0:
            belief = belief.after_unknown(drawn.choice([0.1, 1.0, 10.0]))
        elif kind == 1:
            belief = belief.mixed(10.0).moved(VEHICLE, drawn.choice([0.1, 1.0, 10.0]), replace(
                DRIVE, propulsion_power_w=drawn.uniform(-50e3, 150e3),
                terminal_power_w=drawn.choice([None, 0.0, -60e3, 120e3])),
                drawn.choice([0.0, LIMIT_W]), drawn.choice([0.0, LIMIT_W]))
        elif kind == 2:
            belief = belief.with_temperature(drawn.uniform(-40.0, 60.0), drawn.choice([0.0, 0.1, 1.0]))
        elif kind == 3:
            belief = belief.with_soc(drawn.uniform(), drawn.choice([0.0, 0.01]))
        else:
            belief = belief.with_propulsion_power(drawn.uniform(-2e5, 2e5), drawn.uniform(-5e4, 5e4), 1.0)
            belief = belief.weighed(drawn.uniform(-900.0, 900.0, len(SHARES)).tolist())
        assert np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()
        assert belief.weights.sum() == pytest.approx(1.0)
        assert (belief.weights > 0.0).all()
    for index, bound in FACTOR_BOUNDS.items():
        # Mixing may round.
        assert np.abs(belief.mean[..., index]).max() <= bound * (1.0 + 1e-12)
    assert belief.covariance == pytest.approx(np.swapaxes(belief.covariance, -1, -2), rel=1e-12, abs=1e-9)
    eigenvalues = np.linalg.eigvalsh(belief.covariance)
    assert eigenvalues.min() > -1e-9 * max(eigenvalues.max(), 1.0)


def test_deviations_of_the_vehicle_file_replace_the_spreads_down_to_a_least_one_and_never_widen_them():
    # Leakage: that of an insulated to that of a bare pack, a factor of three.
    spreads = np.array([0.1, 0.5 * np.log(3.0), 0.2, 0.1]) / np.sqrt(3.0)
    least = 0.5 * np.array([0.1, 0.2, 0.2, 0.05]) / np.sqrt(3.0)
    for uncertainty, expected in (
            (Uncertainty(0.04, 0.07, 0.1, 0.02), [0.04, 0.07, 0.1, 0.02]),
            (Uncertainty(0.005, 0.005, 0.005, 0.005), least),
            (Uncertainty(1.0, 1.0, 1.0, 1.0), spreads), (Uncertainty(), spreads),
            (Uncertainty(resistance=0.08), [*spreads[:2], 0.08, spreads[3]])):
        belief = Belief.of(replace(VEHICLE, uncertainty=uncertainty))
        variances = belief.covariance[..., FACTORS, FACTORS]
        assert variances == pytest.approx(
            # The car has no other heat sources.
            np.broadcast_to(np.diag([*expected, 0.08, 0.0])**2, variances.shape), rel=0.02)
        assert (belief.mean[..., FACTORS] == 0.0).all()


def test_a_place_that_has_lost_begins_the_next_trip_with_the_car_of_the_likeliest():
    begun = Belief.of(VEHICLE)
    mean, covariance, weights = begun.mean.copy(), begun.covariance.copy(), begun.weights.copy()
    # The third place has drifted to another car, with bounds at the lags; the second one is still possible.
    mean[:, 0, FACTORS], mean[:, 1, FACTORS], mean[:, 2, FACTORS] = 0.05, -0.05, -0.5
    mean[:, 2, LAGS], mean[:, 2, PLACING] = 2.0, 1.9
    covariance[:, 2] *= 0.1
    weights *= np.array([0.65, 0.25, 0.1]) / weights.sum(axis=0)
    after = replace(begun, mean=mean, covariance=covariance, weights=weights).of_another_route()
    assert (after.weights == weights).all()
    lasting = [index for index in range(FACTORS.start, FACTORS.stop) if index != PROPULSION]
    for place, factor in enumerate((0.05, -0.05, 0.05)):
        assert (after.mean[:, place, lasting] == factor).all()
    own = [*LAGS, *PLACING]
    assert (after.mean[:, 2, own] == begun.mean[:, 2, own]).all()
    assert (after.covariance[:, 2] == after.covariance[:, 0])[:, lasting].all()
    assert after.covariance[:, 2, own, own] == pytest.approx(begun.covariance[:, 2, own, own])
    assert (np.linalg.eigvalsh(after.covariance) >= -1e-12).all()


@pytest.mark.parametrize('seed', range(3))
def test_readings_that_wander_without_any_heat_are_no_shell(seed):
    """The battery has the temperature of the air; nothing warms it, and the reading walks at random."""
    belief, drawn, reading_c = placed(), np.random.default_rng(seed), -5.0
    before = belief.weights.sum(axis=0)
    for _ in range(360):
        reading_c += drawn.normal(0.0, 0.08)
        belief = belief.followed(VEHICLE, 10.0, replace(STILL, ambient_temperature_c=-5.0), 0.0, LIMIT_W)
        belief, _ = belief.with_battery(round(reading_c), 1.0, 0.8, 0.01)
    assert (belief.weights.sum(axis=0)[1:] < before[1:]).all()
