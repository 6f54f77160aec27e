# SPDX-License-Identifier: Apache-2.0
"""The estimator with simulated cars of `driven_car`: accuracy, honest uncertainty, and robustness."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import log

from driven_car import Commands, DrivenCar, LIMIT_W, observed, START_NS, VEHICLE
import numpy as np
import pytest

from bev_preheat.estimation.estimate import HEAT_CAPACITY, HEATER, SENSOR, TEMPERATURE
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.hypotheses import HEALTHY, Heater, STUCK
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.tunables import (
    LOCAL_DEVIATION_K,
    LONGEST_EXCURSION_S,
    NOMINAL_HEAT_LAG_S,
    NOMINAL_SENSOR_LAG_S,
    UNHEATED_S,
)
from bev_preheat.vehicle.variants import Corrections

pytestmark = pytest.mark.costly

SECONDS = 1500
HEATED = Commands(((400, 1400),))


def followed(car, seconds=SECONDS, each_s=1, watch=None):
    """Drive, and return the Estimator that followed; `watch(car, estimate)` is called after each state."""
    estimator = Estimator.of(VEHICLE)
    for _ in range(seconds // each_s):
        estimator = observed(estimator, car.drive(each_s), car.commands)
        if watch is not None:
            watch(car, estimator.estimate)
    return estimator


def drawn_corrections(seed):
    drawn = np.random.default_rng(1000 + seed)
    return Corrections(*(1.0 + spread * drawn.uniform(-1.0, 1.0)
                         for spread in (0.1, 0.2, 0.2, 0.05)))


def drawn_sensor(seed):
    """Return rise by Joule heat [K/kW], place and lag of the heat [s] of a sensor in the core or on the shell."""
    drawn = np.random.default_rng([7, seed])
    is_on_shell = drawn.random() < 0.3
    rise = np.clip(0.35 + 0.4 * drawn.standard_normal(), 0.0, 1.0)
    # A shell is about a quarter of the battery.
    return (rise, max(2.5, 4.0 + 1.2 * drawn.standard_normal()), 150.0) if is_on_shell else (
        rise, 0.0, NOMINAL_HEAT_LAG_S)


@dataclass(frozen=True)
class HeatedDrive:
    """Temperatures after every other second [deg C], and their deviations [K]."""

    true_c: np.ndarray
    seen_c: np.ndarray
    estimated_c: np.ndarray
    deviation_k: np.ndarray


@cache
def heated_drive(seed):
    """Drive a car as the estimator expects it, with its own sensor position; cached for all tests."""
    estimator = Estimator.of(VEHICLE)
    rise, place, heat_lag_s = drawn_sensor(seed)
    car = DrivenCar(
        drawn_corrections(seed), commands=HEATED, local_k=LOCAL_DEVIATION_K, rise_k_per_kw=rise, place=place,
        heat_lag_s=heat_lag_s, sensor_lag_s=NOMINAL_SENSOR_LAG_S, seed=seed)
    rows = []
    for _ in range(SECONDS // 2):
        measurement = car.drive(2)
        estimator = observed(estimator, measurement, car.commands)
        estimate = estimator.estimate
        rows.append((car.temperature_c, measurement.state.temperature_c, estimate.temperature_c,
                     estimate.temperature_deviation_k))
    return HeatedDrive(*np.array(rows).T)


SEEDS = pytest.mark.parametrize('seeds', [
    range(2), pytest.param(range(2, 16), marks=pytest.mark.deep)], ids=['few', 'many'])


@SEEDS
def test_temperature_is_as_sure_as_it_is_said_to_be(seeds):
    # Sampled every 100 s: spread 1 if the standard deviations are right.
    normalised = [error for drive in map(heated_drive, seeds)
                  for error in ((drive.estimated_c - drive.true_c) / drive.deviation_k)[49::50]]
    assert 0.4 < np.std(normalised) < 1.4
    assert np.mean(np.abs(normalised) < 3.0) > 0.97


@SEEDS
def test_the_estimate_is_better_than_the_sensor(seeds):
    errors_k2 = np.array([
        [np.mean(np.square(own[61:] - drive.true_c[61:])) for own in (drive.estimated_c, drive.seen_c)]
        for drive in map(heated_drive, seeds)])
    estimate_k, sensor_k = np.sqrt(errors_k2.mean(axis=0))
    assert estimate_k < 0.5 * sensor_k


@pytest.mark.parametrize('capacity, efficiency', [
    pytest.param(0.92, 1.0, marks=pytest.mark.deep), pytest.param(1.08, 1.0, marks=pytest.mark.deep),
    (1.08, 0.96)])
def test_how_fast_the_car_warms_up_is_learned(capacity, efficiency):
    # Heat capacity and heater efficiency compensate each other; heating shows their ratio.
    ratios = []
    for seed in range(2):
        car = DrivenCar(Corrections(capacity, 1.0, 1.0, efficiency), commands=HEATED, seed=seed)
        estimate = followed(car, each_s=5).estimate
        ratios.append(estimate.mean[HEATER] - estimate.mean[HEAT_CAPACITY])
    truth = log(efficiency / capacity)
    # Less than half of the initial error, after one heating interval.
    assert abs(np.mean(ratios) - truth) < 0.5 * abs(truth)


FAULTS = {
    Heater.DEAD: lambda second, commanded_w: 0.0 if second > 500 else commanded_w,
    Heater.DERATED: lambda second, commanded_w: (0.4 if second > 500 else 1.0) * commanded_w,
    Heater.STUCK_ON: lambda second, commanded_w: LIMIT_W if second > 500 else commanded_w,
}
# A heater that delivers 40 % is hardest to distinguish from a heavy car.
LATEST_S = {True: {Heater.DEAD: 1000, Heater.DERATED: 1600, Heater.STUCK_ON: 1000},
            False: {Heater.DEAD: 1100, Heater.DERATED: 1600, Heater.STUCK_ON: 1100}}


@pytest.mark.parametrize('with_power', [True, False], ids=['power seen', 'temperature only'])
@pytest.mark.parametrize('fault', FAULTS)
def test_a_heater_fault_is_told(fault, with_power):
    """The heater fails at 500 s, under command or not; traffic power hides some faults for a while."""
    latest_s = LATEST_S[with_power][fault]
    commands = Commands(() if fault is Heater.STUCK_ON else ((300, latest_s + 100),))
    told_s = []

    def watch(car, estimate):
        if estimate.heater.heater is fault:
            told_s.append(car.second)

    car = DrivenCar(commands=commands, heater=FAULTS[fault], seed=1, with_power=with_power,
                    traffic_w=1000.0)
    estimator = followed(car, latest_s + 100, watch=watch)
    assert told_s, estimator.estimate.heater
    assert 500 < told_s[0] <= latest_s
    assert estimator.estimate.heater.heater is fault
    if fault is Heater.DERATED:
        assert estimator.estimate.heater.share == pytest.approx(0.4, abs=0.11)


@pytest.mark.parametrize('with_power, seeds', [
    pytest.param(True, range(1), id='power seen'),
    pytest.param(True, range(1, 10), id='power seen, many', marks=pytest.mark.deep),
    pytest.param(False, range(4), id='temperature only', marks=pytest.mark.deep)])
def test_a_healthy_heater_is_never_accused(with_power, seeds):
    commands = Commands(((300, 500), (700, 900), (1100, 1300)))
    accused = []
    for seed in seeds:
        car = DrivenCar(drawn_corrections(seed), commands=commands, seed=seed,
                        with_power=with_power)
        followed(car, watch=lambda _, estimate: accused.append(
            estimate.heater.heater is not Heater.ANSWERS))
    assert not any(accused)


def test_without_a_command_only_a_heater_that_is_stuck_on_is_told():
    """The heater delivers 60 % while it heats; later traffic warms the battery otherwise than the route says."""
    odds = {}
    car = DrivenCar(commands=Commands(((100, 500),)), heater=lambda second, commanded_w: 0.6 * commanded_w, seed=3,
                    traffic_w=6000.0)
    estimator = Estimator.of(VEHICLE)
    for _ in range(1300):
        estimator = observed(estimator, car.drive(2), car.commands)
        heaters = estimator.belief.weights.sum(axis=1)
        odds[car.second] = heaters[1:STUCK] / heaters[HEALTHY]
    last_s = 500 + UNHEATED_S + 10
    for second, found in odds.items():
        if second >= last_s:
            np.testing.assert_allclose(found, odds[last_s], rtol=1e-9)
    assert np.abs(odds[last_s] / odds[500] - 1.0).max() > 0.1
    car.heater = lambda second, commanded_w: LIMIT_W
    for _ in range(400):
        estimator = observed(estimator, car.drive(2), car.commands)
    assert estimator.estimate.heater.heater is Heater.STUCK_ON


def moved(measurement, temperature_c=0.0, soc=0.0):
    state = measurement.state
    return replace(measurement, state=BatteryState(state.temperature_c + temperature_c, state.soc + soc))


@pytest.mark.parametrize('jump', [{'temperature_c': 15.0}, {'temperature_c': -9.0}, {'soc': -0.3}])
def test_readings_that_stay_far_off_begin_the_estimate_anew_and_a_spike_does_not(jump):
    car = DrivenCar(seed=4)
    estimator = followed(car, 300)
    for lasts_s in (25, 31):
        assert estimator.estimate.resets == 0
        assert estimator.estimate.temperature_c == pytest.approx(car.temperature_c, abs=0.3)
        estimator = observed(estimator, car.drive(), car.commands)
        for _ in range(lasts_s):
            measurement = moved(car.drive(), **jump)
            estimator = observed(estimator, measurement, car.commands)
    estimate = estimator.estimate
    assert estimate.resets == 1
    assert 'battery_state jumped to' in estimate.reset_reason
    assert estimate.reset_at_ns == measurement.stamp_ns
    assert estimate.temperature_c == pytest.approx(measurement.state.temperature_c, abs=0.01)
    # All learned values may belong to another car.
    assert estimate.log_factors.tolist() == [0.0] * 6


@pytest.mark.parametrize('spike_k, lasts_s', [
    (2.0, 30), (-1.5, 120), *(pytest.param(spike_k, lasts_s, marks=pytest.mark.deep)
                              for spike_k, lasts_s in product((1.0, -1.5, 2.0), (30, 60, 120)))])
@pytest.mark.parametrize('with_power', [True, False])
def test_a_spike_accuses_no_heater_and_moves_the_estimate_by_less_than_itself(spike_k, lasts_s, with_power):
    car = DrivenCar(seed=4, step_k=0.5, with_power=with_power, commands=HEATED)
    estimator = followed(car, 300)
    for second in range(1200):
        measurement = car.drive()
        estimator = observed(
            estimator, moved(measurement, temperature_c=spike_k if second < lasts_s else 0.0), car.commands)
        assert estimator.estimate.heater.heater is Heater.ANSWERS
        assert abs(estimator.estimate.temperature_c - car.temperature_c) < abs(spike_k)
    assert estimator.estimate.resets == 0


def test_a_reading_that_stays_where_it_went_is_believed_in_the_end():
    car = DrivenCar(seed=4, commands=HEATED)
    estimator = followed(car, 300)
    for _ in range(round(LONGEST_EXCURSION_S) + 60):
        estimator = observed(estimator, moved(car.drive(), temperature_c=2.0), car.commands)
    assert estimator.estimate.resets == 0
    assert estimator.estimate.ignored_share < 0.7
    ignored = estimator.estimate.ignored_share
    for _ in range(100):
        estimator = observed(estimator, moved(car.drive(), temperature_c=2.0), car.commands)
    assert estimator.estimate.ignored_share < ignored


def test_after_a_long_silence_the_temperature_is_read_anew_and_the_car_remembered():
    car = DrivenCar(Corrections(0.92), commands=HEATED, seed=6)
    estimator = followed(car, each_s=5)
    learned = estimator.estimate.mean[HEAT_CAPACITY]
    assert learned < -0.02
    car.temperature_c += 12.0
    measurement = car.drive(600)
    estimator = observed(estimator, measurement, car.commands)
    estimate = estimator.estimate
    assert estimate.mean[SENSOR] == pytest.approx(measurement.state.temperature_c, abs=0.01)
    # The hypotheses, which are less certain now, differ slightly.
    assert estimate.mean[HEAT_CAPACITY] == pytest.approx(learned, abs=1e-4)
    assert estimate.resets == 0


def test_a_heater_that_heats_on_at_a_stop_has_heat_under_way():
    """Nothing is learned at a stop that the route does not know, but the heater heats as it did before."""
    car = DrivenCar(commands=Commands(((0, 600),)), heat_lag_s=NOMINAL_HEAT_LAG_S, noise_k=0.0, step_k=0.1)
    estimator = followed(car, 300)
    before = estimator.estimate
    for _ in range(120):
        estimator = estimator.held(car.drive(), VEHICLE, LIMIT_W)
    lag_s, capacity_j_per_k = before.heat_lag_s, VEHICLE.pack_heat_capacity_j_per_k
    assert estimator.estimate.under_way_k == pytest.approx(
        lag_s * VEHICLE.hvch.efficiency * LIMIT_W / capacity_j_per_k, rel=0.1)
    assert estimator.estimate.log_factors == pytest.approx(before.log_factors)
    for _ in range(120):
        estimator = estimator.held(car.drive(), VEHICLE, 0.0)
    assert estimator.estimate.under_way_k < 0.05


def test_a_hundred_states_a_second_are_worth_one():
    """They count as one reading per second, because their noise is correlated."""
    slow, fast = Estimator.of(VEHICLE), Estimator.of(VEHICLE)
    car = DrivenCar(seed=8, with_power=False)
    for _ in range(60):
        measurement = car.drive()
        slow = observed(slow, measurement, car.commands)
        for part in range(100):
            stamp_ns = measurement.stamp_ns + part * NS_PER_S // 100
            fast = observed(fast, replace(measurement, stamp_ns=stamp_ns), car.commands)
    assert fast.estimate.temperature_c == pytest.approx(slow.estimate.temperature_c, abs=0.05)
    assert fast.estimate.temperature_deviation_k == pytest.approx(
        slow.estimate.temperature_deviation_k, rel=0.05)


@pytest.mark.parametrize('seed', [
    0, *(pytest.param(seed, marks=pytest.mark.deep) for seed in range(1, 4))])
def test_no_stream_of_numbers_makes_the_estimate_none(seed):
    """Any input that passes the checks: numbers within their ranges, stamps that do not go back."""
    drawn, estimator = np.random.default_rng(seed), Estimator.of(VEHICLE)
    stamp_ns, car = START_NS, DrivenCar()
    template = car.drive()
    for _ in range(600):
        stamp_ns += int(drawn.choice([0, 1, 10**6, 10**9, 10**10, 5 * 10**10, 10**12]))
        voltage_v, current_a = drawn.choice([0.0, 400.0, 1e4]), drawn.choice([-1e4, 0.0, 45.0, 1e4])
        estimator = observed(estimator, replace(
            template, stamp_ns=stamp_ns, voltage_v=drawn.choice([voltage_v, None]),
            current_a=current_a, state=BatteryState(
                float(drawn.choice([-30.0, -5.0, -5.3, 50.0])),
                float(drawn.choice([0.05, 0.8, 0.8012, 1.0])))), Commands(((0, 1e9),)))
        estimate = estimator.estimate
        assert np.isfinite(estimate.mean).all() and np.isfinite(estimate.covariance).all()
        assert 0.0 <= estimate.soc <= 1.0
        assert estimate.covariance[TEMPERATURE, TEMPERATURE] >= 0.0
        assert np.isfinite(list(vars(estimate.corrections).values())).all()
