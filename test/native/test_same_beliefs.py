# SPDX-License-Identifier: Apache-2.0
"""The estimation with and without the native core: the same beliefs and sensitivities, to rounding."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.estimation import belief as belief_module
from bev_preheat.estimation.belief import Belief, TERMS
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.forecast import arrival_deviation_k
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.estimation.state import SIZE
from bev_preheat.native.beliefs import arrival_variance, NativeBelief
from bev_preheat.native.library import core, Declined, without_core
from bev_preheat.planning.core_engine import vehicle_in_core
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.uncertain_car import DriveInputs

VEHICLES = {'formulas': load_vehicle('reference'), 'tables': load_vehicle('small_car'),
            'logarithm': load_vehicle('mid_size_lfp'),
            'coolant': replace(load_vehicle('large_suv'), heat_path=HeatPath(45.0, 15e3, 300.0, 30.0))}
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


def believed(vehicle, seed, is_in_core):
    """Return a belief's weights, means and covariances after each of many drawn updates."""
    drawn, belief, course = np.random.default_rng(seed), Belief.of(vehicle).placed(-5.0, 0.2, 0.7, 1e-5), []
    with nullcontext() if is_in_core else without_core():
        for _ in range(60):
            duration_s = drawn.choice([1.0, 4.0, 10.0])
            drive = drawn_drive(drawn)
            belief = belief.predicted(vehicle, duration_s, None if drawn.uniform() < 0.1 else drive,
                                      drawn.choice([0.0, LIMIT_W]), LIMIT_W)
            if drive.terminal_power_w is not None:
                belief = belief.with_propulsion_power(
                    drive.propulsion_power_w * drawn.uniform(0.5, 1.5), drive.propulsion_power_w, duration_s)
            belief = belief.with_temperature(drawn.normal(-5.0, 0.7), drawn.choice([0.0, 0.5, 1.0])).with_soc(
                drawn.normal(0.7, 0.004), drawn.choice([0.0, 0.005]))
            course.append((belief.weights, belief.mean, belief.covariance, *belief.expected()))
    return course


@pytest.mark.parametrize('name', [
    pytest.param(name, marks=[pytest.mark.deep] * (name != 'coolant')) for name in VEHICLES])
def test_beliefs_are_the_same(name):
    assert core() is not None
    vehicle = VEHICLES[name]
    for with_core, without in zip(believed(vehicle, 7, True), believed(vehicle, 7, False)):
        deviations = np.sqrt(np.diagonal(without[2], axis1=-2, axis2=-1))
        scales = (1.0, deviations, deviations[..., np.newaxis] * deviations[..., np.newaxis, :])
        for mine, theirs, scale in zip(with_core, without, scales):
            assert np.abs(mine - theirs).max() < np.inf
            assert (np.abs(mine - theirs) / scale).max() < 1e-6
        # Mean and covariance over all hypotheses.
        assert with_core[3] == pytest.approx(without[3], rel=1e-7, abs=1e-9)
        assert with_core[4] == pytest.approx(without[4], rel=1e-5, abs=1e-9)


def updated(vehicle, is_in_one_call, lost=(), seen_w=None):
    """
    Return a belief after each of many updates, in a single call each or part by part.

    `lost` are the updates before which a filter is spoiled, (update, element); `seen_w` [W] is a power seen.
    """
    drawn, belief, course = np.random.default_rng(11), Belief.of(vehicle).placed(-5.0, 0.2, 0.7, 1e-5), []
    for number in range(40):
        drive, duration_s = drawn_drive(drawn), drawn.choice([1.0, 4.0])
        commanded_w, propulsion_w = drawn.choice([0.0, LIMIT_W]), drawn.normal(drive.propulsion_power_w, 2e3)
        propulsion_w = propulsion_w if seen_w is None else seen_w
        temperature_c, soc = drawn.normal(-5.0, 0.7), drawn.normal(0.7, 0.004)
        if is_in_one_call:
            belief = belief.followed(vehicle, duration_s, drive, commanded_w, LIMIT_W, propulsion_w)
        else:
            belief = belief.predicted(vehicle, duration_s, drive, commanded_w, LIMIT_W)
            if drive.terminal_power_w is not None:
                belief = belief.with_propulsion_power(propulsion_w, drive.propulsion_power_w, duration_s)
        for _, element in filter(lambda spoiled: spoiled[0] == number, lost):
            belief = spoiled(belief, (2, 0, element), 3.0 * belief_module.MOST_APART_K)
        if is_in_one_call:
            belief, expected = belief.with_battery(temperature_c, 1.0, soc, 0.005)
        else:
            belief = belief.with_temperature(temperature_c, 1.0).with_soc(soc, 0.005)
            expected = belief.expected()
        course.append((belief.weights, belief.mean, belief.covariance, *expected))
    return course


@pytest.mark.parametrize('context', [nullcontext, without_core])
@pytest.mark.parametrize('spoiled', [
    {}, {'lost': ((3, belief_module.UNDER_WAY), (8, belief_module.TEMPERATURE), (9, belief_module.SENSOR))},
    {'seen_w': np.inf}], ids=['as_usual', 'lost_filters', 'power_that_the_core_refuses'])
def test_an_update_in_one_call_is_its_parts_one_after_the_other(context, spoiled):
    vehicle = VEHICLES['tables']
    with context():
        for together, apart in zip(updated(vehicle, True, **spoiled), updated(vehicle, False, **spoiled)):
            for mine, theirs in zip(together, apart):
                np.testing.assert_array_equal(mine, theirs)


def test_filters_that_are_lost_are_found_again():
    beliefs = []
    for context in (nullcontext, without_core):
        with context():
            belief = Belief.of(VEHICLES['formulas']).placed(-5.0, 0.2, 0.7, 1e-5)
            beliefs.append(spoiled(
                belief, (1, 0, belief_module.TEMPERATURE), 2.0 * belief_module.MOST_APART_K).with_soc(0.7, 0.005))
    assert beliefs[0].mean == pytest.approx(beliefs[1].mean, rel=1e-9)
    assert beliefs[0].mean[1, 0, belief_module.TEMPERATURE] == pytest.approx(-5.0)


@pytest.mark.parametrize('name', ['formulas', 'tables'])
def test_deviations_on_arrival_are_the_same(name):
    vehicle = VEHICLES[name]
    trip = make_trip(vehicle, load_route('alpine_pass', vehicle.defaults))
    heater_w = np.where(np.arange(len(trip.route)) % 3, 0.0, 2500.0)
    soc, temperature_c = run_forward(trip, make_runge_kutta_4, 0.8, -9.0, heater_w)
    plan = Plan.__new__(Plan)
    for field, value in {'soc': soc, 'battery_temperature_c': temperature_c,
                         'hvch_battery_power_w': heater_w}.items():
        object.__setattr__(plan, field, value)
    drawn = np.random.default_rng(4)
    # Only traffic, each element by itself, and all elements.
    covariances = [np.zeros((SIZE, SIZE)), *(np.diag(row) for row in np.eye(SIZE))]
    for _ in range(20):
        roots = drawn.normal(size=(SIZE, SIZE))
        covariances.append(roots @ roots.T)
    for number, covariance in enumerate(covariances):
        estimate = Estimate(0, np.zeros(SIZE), covariance, HeaterReport(Heater.ANSWERS, 1.0, 1.0), 0.0)
        found = arrival_deviation_k(trip, plan, estimate)
        with without_core():
            assert found == pytest.approx(arrival_deviation_k(trip, plan, estimate), rel=1e-7), number
    assert found > 1.0


def test_a_covariance_that_is_not_finite_is_left_to_python():
    vehicle = VEHICLES['formulas']
    trip = make_trip(vehicle, load_route('reference', vehicle.defaults))
    count, native = len(trip.route), vehicle_in_core(vehicle)
    course = (native, TERMS, vehicle.battery.leakage, np.ones((8, count)), np.ones(count),
              np.ones(count + 1), np.ones(count + 1))
    assert arrival_variance(*course, np.eye(SIZE)) > 0.0
    with pytest.raises(Declined):
        arrival_variance(*course, np.full((SIZE, SIZE), np.nan))


@pytest.mark.parametrize('spoil, call', [
    ('mean', lambda native: native.see_interval(TERMS, 0, np.full(1, 0.1), -1.0, 1.0, True)),
    ('mean', lambda native: native.move(
        vehicle_in_core(VEHICLES['formulas']), TERMS, drawn_drive(np.random.default_rng(1)),
        VEHICLES['formulas'].battery.leakage, 1.0, np.zeros(5), np.zeros(SIZE), 0.0)),
    ('weights', lambda native: native.mix(np.eye(5))),
    (None, lambda native: native.see_interval(TERMS, 0, np.full(1, 0.1), np.nan, 1.0, True)),
    (None, lambda native: native.see_interval(TERMS, SIZE, np.full(1, 0.1), -1.0, 1.0, True)),
    (None, lambda native: native.see_propulsion_power(TERMS, np.inf, 1e4, 1e6, 1e4))],
    ids=['state', 'state that moves', 'weights', 'reading', 'element', 'power'])
def test_what_is_not_finite_is_left_to_python_and_nothing_is_changed(spoil, call):
    belief = Belief.of(VEHICLES['formulas']).placed(-5.0, 0.2, 0.7, 1e-5)
    if spoil:
        belief = spoiled(belief, ..., np.nan, spoil)
    native = NativeBelief(belief.weights, belief.mean, belief.covariance)
    with pytest.raises(Declined):
        call(native)
    for name in ('weights', 'mean', 'covariance'):
        np.testing.assert_array_equal(getattr(native, name), getattr(belief, name))
