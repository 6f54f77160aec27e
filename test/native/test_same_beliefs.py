# SPDX-License-Identifier: Apache-2.0
"""The estimation with and without the native core: the same beliefs and sensitivities, to rounding."""

from dataclasses import replace

from drawn_situations import in_both
import numpy as np
import pytest

from bev_preheat.estimation.belief import Belief, terms_of
from bev_preheat.estimation.estimate import Estimate, SENSOR, SIZE, TEMPERATURE, UNDER_WAY
from bev_preheat.estimation.forecast import arrival_deviation_k
from bev_preheat.estimation.hypotheses import Heater, HeaterReport, PLACES
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.tunables import MOST_APART_K
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_calls import arrival_variance, Elapsing, NativeBelief, ReadingNoise, vehicle_in_core
from bev_preheat.vehicle.core_library import core, Declined
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.variants import DriveInputs, with_shell

VEHICLES = {'formulas': load_vehicle('reference'), 'tables': load_vehicle('small_car'),
            'logarithm': load_vehicle('mid_size_lfp'),
            'coolant': replace(load_vehicle('large_suv'), heat_path=HeatPath(45.0, 15e3, 300.0, 30.0)),
            'shell': with_shell(load_vehicle('large_suv'), 0.2, 250.0, 'shell')}
LIMIT_W = 5000.0


def drawn_drive(drawn):
    propulsion_w = drawn.uniform(-40e3, 60e3)
    seen = {} if drawn.uniform() < 0.3 else {
        'terminal_power_w': propulsion_w + drawn.normal(2e3, 2e3), 'hidden_variance_w2': drawn.choice([0.0, 3e7])}
    return DriveInputs(
        drawn.uniform(0.0, 40.0), drawn.uniform(-25.0, 15.0), propulsion_w, drawn.choice([0.0, 2e7, 9e8]),
        abs(propulsion_w) + drawn.uniform(0.0, 5e3), 1300.0, 450.0, 0.0, **seen)


def spoiled(belief, element, by, name='mean'):
    """Return a Belief with an element of an array larger by a number."""
    array = getattr(belief, name).copy()
    array[element] += by
    return replace(belief, **{name: array})


def believed(vehicle, seed, lost=(), seen_w=None):
    """
    Return a belief's weights, means and covariances after each of many drawn updates, and those expected.

    `lost` are the updates before which a filter is spoiled, (update, element); `seen_w` [W] is a power seen.
    """
    drawn, belief, course = np.random.default_rng(seed), Belief.of(vehicle).placed(-5.0, 0.2, 0.7, 1e-5), []
    for number in range(60):
        duration_s, drive = drawn.choice([1.0, 4.0, 10.0]), drawn_drive(drawn)
        commanded_w = drawn.choice([0.0, LIMIT_W])
        propulsion_w = drive.propulsion_power_w * drawn.uniform(0.5, 1.5)
        belief = belief.after_unknown(duration_s) if drawn.uniform() < 0.1 else belief.followed(
            vehicle, duration_s, drive, commanded_w, LIMIT_W, propulsion_w if seen_w is None else seen_w)
        for _, element in filter(lambda each: each[0] == number, lost):
            belief = spoiled(belief, (2, 0, element), 3.0 * MOST_APART_K)
        belief, expected = belief.with_battery(
            drawn.normal(-5.0, 0.7), drawn.choice([0.0, 0.5, 1.0]), drawn.normal(0.7, 0.004),
            drawn.choice([0.0, 0.005]))
        course.append((belief.weights, belief.mean, belief.covariance, *expected))
    return course


@pytest.mark.parametrize('name, how', [
    ('coolant', {}),
    *(pytest.param(name, {}, marks=pytest.mark.deep) for name in ('formulas', 'tables', 'logarithm')),
    ('tables', {'lost': ((3, UNDER_WAY), (8, TEMPERATURE), (9, SENSOR))}), ('tables', {'seen_w': np.inf})],
    ids=['coolant', 'formulas', 'tables', 'logarithm', 'lost filters', 'power that the core refuses'])
def test_beliefs_are_the_same(name, how):
    assert core() is not None
    for with_core, without in zip(*in_both(lambda: believed(VEHICLES[name], 7, **how))):
        deviations = np.sqrt(np.diagonal(without[2], axis1=-2, axis2=-1))
        scales = (1.0, deviations, deviations[..., np.newaxis] * deviations[..., np.newaxis, :])
        for mine, theirs, scale in zip(with_core, without, scales):
            assert np.abs(mine - theirs).max() < np.inf
            assert (np.abs(mine - theirs) / scale).max() < 1e-6
        # Mean and covariance over all hypotheses.
        assert with_core[3] == pytest.approx(without[3], rel=1e-7, abs=1e-9)
        assert with_core[4] == pytest.approx(without[4], rel=1e-5, abs=1e-9)


@pytest.mark.parametrize('name', ['formulas', 'tables'])
def test_deviations_on_arrival_are_the_same(name):
    vehicle = VEHICLES[name]
    route = load_route('alpine_pass', vehicle.defaults)
    trip, plan = make_trip(vehicle, route), plan_preheating(vehicle, route, BatteryState(-9.0, 0.8), Goal(15.0))
    assert 0 < np.count_nonzero(plan.hvch_battery_power_w) < len(route)
    drawn = np.random.default_rng(4)
    # Only traffic, each element by itself, and all elements.
    covariances = [np.zeros((SIZE, SIZE)), *(np.diag(row) for row in np.eye(SIZE))]
    for _ in range(20):
        roots = drawn.normal(size=(SIZE, SIZE))
        covariances.append(roots @ roots.T)
    for number, covariance in enumerate(covariances):
        estimate = Estimate(0, np.zeros(SIZE), covariance, HeaterReport(Heater.ANSWERS, 1.0, 1.0), 0.0)
        found, expected = in_both(lambda: arrival_deviation_k(trip, plan, estimate))
        assert found == pytest.approx(expected, rel=1e-7), number
    assert found > 1.0


def test_a_covariance_that_is_not_finite_is_left_to_python():
    vehicle = VEHICLES['formulas']
    trip = make_trip(vehicle, load_route('reference', vehicle.defaults))
    count, native = len(trip.route), vehicle_in_core(vehicle)
    course = (native, terms_of(vehicle.heat_path), vehicle.battery.leakage, np.ones((8, count)),
              *np.ones((2, count)), *np.ones((2, count + 1)))
    assert arrival_variance(*course, np.eye(SIZE)) > 0.0
    with pytest.raises(Declined):
        arrival_variance(*course, np.full((SIZE, SIZE), np.nan))


def in_core(native, drive, low_c=-6.0, seen_w=0.0):
    """Follow a drive in the core, and take a reading from `low_c` [deg C] on."""
    vehicle = VEHICLES['formulas']
    noise = ReadingNoise(np.full(len(PLACES), 0.1), np.full(len(PLACES), 1e-6))
    terms = terms_of(vehicle.heat_path)
    native.follow(vehicle_in_core(vehicle), terms, Elapsing(1.0, np.eye(5), np.zeros(SIZE)), drive,
                  vehicle.battery.leakage, ([0.0] * 5, [0.0] * 5), 0.0, (seen_w, 1e4, 1e6, 1e4))
    native.take_reading(terms, noise, (low_c, 1.0), (0.69, 0.71))


@pytest.mark.parametrize('spoil, how', [
    ('mean', {}), ('weights', {}), (None, {'low_c': np.nan}), (None, {'seen_w': np.inf})],
    ids=['state', 'weights', 'reading', 'power'])
def test_what_is_not_finite_is_left_to_python(spoil, how):
    belief = Belief.of(VEHICLES['formulas']).placed(-5.0, 0.2, 0.7, 1e-5)
    drive = replace(drawn_drive(np.random.default_rng(1)), terminal_power_w=2e4)
    native = NativeBelief(belief.weights, belief.mean, belief.covariance)
    in_core(native, drive)
    if spoil:
        belief = spoiled(belief, ..., np.nan, spoil)
    with pytest.raises(Declined):
        in_core(NativeBelief(belief.weights, belief.mean, belief.covariance), drive, **how)
