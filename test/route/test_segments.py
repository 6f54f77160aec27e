# SPDX-License-Identifier: Apache-2.0
"""The route: slicing and resampling preserve integrals, bad input gets its message."""

from dataclasses import fields

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest
from refusals import problems_of

from bev_preheat.route import load_route
from bev_preheat.route.segments import make_route, MOST_SEGMENTS, Route
from bev_preheat.simulation.traffic import with_cycles
from bev_preheat.vehicle.description import Defaults

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0, target_battery_temperature_c=21.0)

SEGMENT = st.tuples(
    st.floats(0.5, 400.0), st.floats(0.0, 50.0), st.floats(-8e4, 1.5e5), st.floats(0.0, 9e4),
    st.floats(-30.0, 30.0), st.floats(0.0, 6e3), st.floats(0.0, 3e3))


def route_of(rows):
    """Return the Route of rows as in SEGMENT; the fourth value is the standard deviation."""
    duration, speed, mean, deviation, ambient, cabin, auxiliary = np.array(rows).T
    return make_route({
        'duration_s': duration, 'speed_mps': speed, 'propulsion_power_w': mean,
        'propulsion_power_rms_w': np.hypot(mean, deviation), 'ambient_temperature_c': ambient,
        'cabin_heating_power_w': cabin, 'auxiliary_power_w': auxiliary}, DEFAULTS)


ROUTES = st.lists(SEGMENT, min_size=1, max_size=25).map(route_of)
SHARES = st.floats(0.0, 1.0, exclude_max=True)
STEPS_S = st.floats(0.3, 900.0)


def integrals(route, start_s=0.0, end_s=np.inf):
    """
    Integrals over a span of time, segment by segment: the reference of the tests below.

    Duration, distance, energy, mean square, ambient temperature, cabin and auxiliary energy, mean magnitude.
    """
    total, at_s = np.zeros(8), 0.0
    for duration, speed, mean, rms, ambient, cabin, auxiliary, magnitude in zip(
            *(getattr(route, field.name) for field in fields(Route))):
        inside_s = max(0.0, min(end_s, at_s + duration) - max(start_s, at_s))
        total += inside_s * np.array([1.0, speed, mean, rms**2, ambient, cabin, auxiliary, magnitude])
        at_s += duration
    return total


def tolerance(route):
    """Return the rounding error of the integrals, from their magnitudes."""
    largest = np.array([1.0, 50.0, 1.5e5, 4e10, 30.0, 6e3, 3e3, 2e5])
    return 1e-11 * (1.0 + route.total_duration_s) * largest


@given(ROUTES, SHARES)
def test_after_keeps_what_remains(route, share):
    instant_s = share * route.total_duration_s
    rest = route.after(instant_s)
    assert np.all(np.abs(integrals(rest) - integrals(route, start_s=instant_s)) <= tolerance(route))


@given(ROUTES, SHARES)
def test_the_lowest_ambient_temperature_is_that_of_what_is_ahead(route, share):
    rest = route.after(share * route.total_duration_s)
    assert rest.lowest_ambient_temperature_c == min(rest.ambient_temperature_c)
    assert rest.with_propulsion(1.1).lowest_ambient_temperature_c == min(rest.ambient_temperature_c)
    assert route.lowest_ambient_temperature_c == min(route.ambient_temperature_c)


@pytest.mark.parametrize('instant_s', [-0.001, 18.0, 1e9, np.nan])
def test_after_refuses_instants_that_are_not_on_the_route(instant_s):
    route = route_of([(7.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (11.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)])
    with pytest.raises(ValueError, match=f'instant {instant_s} s is not on this route of 18.0 s'):
        route.after(instant_s)


@given(ROUTES, STEPS_S, SHARES)
def test_resampled_steps_are_equally_long_but_for_the_last_and_have_their_integrals(route, step_s, share):
    assume(route.total_duration_s / step_s < 3000)
    steps = route.resampled(step_s)
    np.testing.assert_allclose(steps.duration_s[:-1], step_s, rtol=1e-9)
    assert 0.0 < steps.duration_s[-1] <= step_s * (1.0 + 1e-8)
    index = int(share * len(steps))
    start_s, end_s = steps.time_s[index], steps.time_s[index + 1]
    of_step = integrals(steps, start_s, end_s)
    assert np.all(np.abs(of_step - integrals(route, start_s, end_s)) <= 10.0 * tolerance(route))


@pytest.mark.parametrize('step_s', [0.0, -30.0, np.nan, np.inf])
def test_resampling_refuses_steps_that_are_none(step_s):
    with pytest.raises(ValueError, match=f'step {step_s} s must be above 0 and finite'):
        route_of([(7.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]).resampled(step_s)


# Accepted and refused input of make_route ------------------------------------------------------

def columns(**changes):
    """Return the columns of a valid route of three segments, with changes; None removes a column."""
    valid = {
        'duration_s': [30.0, 20.0, 10.0],
        'speed_mps': [10.0, 20.0, 30.0],
        'propulsion_power_w': [5e3, -4e3, 3e3],
        'propulsion_power_rms_w': [6e3, 5e3, 4e3],
        'ambient_temperature_c': [-7.0, -8.0, -9.0],
        'cabin_heating_power_w': [1500.0, 1600.0, 1700.0],
        'auxiliary_power_w': [300.0, 400.0, 500.0],
        'propulsion_power_magnitude_w': [5.5e3, 4.5e3, 3.5e3],
    }
    valid.update(changes)
    return {name: values for name, values in valid.items() if values is not None}


def problems_with(**changes):
    return problems_of(make_route, columns(**changes), DEFAULTS)


@pytest.mark.parametrize('missing', [None, []])
def test_defaults_hold_where_optional_columns_say_nothing(missing):
    route = make_route(columns(propulsion_power_rms_w=missing, cabin_heating_power_w=missing,
                               auxiliary_power_w=missing,
                               propulsion_power_magnitude_w=missing), DEFAULTS)
    assert route.propulsion_power_rms_w.tolist() == [5e3, 4e3, 3e3]
    assert route.cabin_heating_power_w.tolist() == [1111.0] * 3
    assert route.auxiliary_power_w.tolist() == [222.0] * 3


@pytest.mark.parametrize('changes, problem', [
    ({'duration_s': None, 'ambient_temperature_c': []}, 'missing or empty: duration_s, ambient_temperature_c'),
    ({'speed_mps': [1.0, 2.0]}, 'speed_mps: has 2 values; it must have 1 or 3, the length of the longest array'),
    ({'speed_mps': [[1.0, 2.0, 3.0]]}, 'speed_mps: has 2 dimensions; it must be a plain list'),
    ({'propulsion_power_rms_w': [6e3, 3e3, 4e3]},
     'propulsion_power_rms_w[1]: 3000 is below the magnitude of the mean, 4000'),
    ({'propulsion_power_magnitude_w': [5.5e3, 3.9e3, 3.5e3]},
     'propulsion_power_magnitude_w[1]: 3900 is below the magnitude of the mean, 4000'),
    ({'propulsion_power_magnitude_w': [5.5e3, 4.5e3, 4.1e3]},
     'propulsion_power_rms_w[2]: 4000 is below the mean magnitude, 4100'),
    ({'duration_s': [43200.0, 43200.0, 1.0]},
     'duration_s: the route lasts 86401 s; at most 86400 s are planned')],
    ids=['missing', 'lengths', 'table', 'rms below mean', 'magnitude below mean', 'rms below magnitude', 'days'])
def test_columns_that_do_not_make_a_route_are_refused(changes, problem):
    assert problems_with(**changes) == [problem]


def test_root_mean_square_below_the_mean_by_rounding_is_lifted():
    route = make_route(columns(propulsion_power_rms_w=[6e3, 4e3 * (1.0 - 1e-9), 4e3],
                               propulsion_power_magnitude_w=None), DEFAULTS)
    assert route.propulsion_power_rms_w[1] == 4e3


def test_too_many_segments_are_refused():
    others = {name: values[:1] for name, values in columns().items() if name != 'duration_s'}
    assert problems_with(**others, duration_s=np.full(MOST_SEGMENTS + 1, 0.1)) == [
        'has 200001 segments; at most 200000 are planned']


# Cycles within segments


@pytest.mark.parametrize('name', ['city_stop_and_go', 'alpine_pass', 'motorway_3h'])
def test_each_segment_keeps_its_mean_its_square_and_its_magnitude(name):
    route = load_route(name, None)
    driven = with_cycles(route)
    at = np.searchsorted(route.time_s[1:-1], driven.time_s[:-1] + 0.5 * driven.duration_s, 'right')
    for power_w, expected_w in (
            (driven.propulsion_power_w, route.propulsion_power_w),
            (driven.propulsion_power_w**2, route.propulsion_power_rms_w**2),
            (np.abs(driven.propulsion_power_w), route.propulsion_power_magnitude_w)):
        sums = np.bincount(at, driven.duration_s * power_w, len(route))
        assert sums / route.duration_s == pytest.approx(expected_w, rel=1e-9, abs=1e-6)
    assert driven.total_duration_s == pytest.approx(route.total_duration_s, rel=1e-12)
    assert driven.distance_m == pytest.approx(route.distance_m, rel=1e-12)
