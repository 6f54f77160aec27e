# SPDX-License-Identifier: Apache-2.0
"""What was learned of a car: what is kept of it, what comes back, and what damage does."""

import json

from learned_cars import an_estimate, FACTORS_SEEN, some_covariance
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.belief import FACTOR_BOUNDS, prior_factor_covariance
from bev_preheat.estimation.memory import as_entry, from_entry, learned_from, OVERNIGHT
from bev_preheat.estimation.state import FACTORS

NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency')


@pytest.fixture
def entry():
    """What a file would hold: JSON, and back."""
    return json.loads(json.dumps(as_entry(learned_from(an_estimate()))))


def test_the_car_is_remembered_and_a_night_makes_it_less_sure(entry):
    learned = from_entry(entry)
    assert learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert learned.covariance[:4, :4] == pytest.approx(
        some_covariance()[:4, :4] + OVERNIGHT**2 * np.eye(4))


def test_the_routes_consumption_is_forgotten(entry):
    learned = from_entry(entry)
    assert learned.factors[4] == 0.0
    assert learned.covariance[4].tolist() == prior_factor_covariance()[4].tolist()


def test_nothing_is_learned_less_than_the_prior():
    learned = learned_from(an_estimate(9.0 * prior_factor_covariance()))
    assert np.diag(learned.covariance) == pytest.approx(np.diag(prior_factor_covariance()))


def test_a_mean_that_is_rounded_beyond_a_bound_can_be_remembered():
    estimate = an_estimate()
    bounds = [FACTOR_BOUNDS[FACTORS.start + index] for index in range(5)]
    estimate.mean[FACTORS] = np.nextafter(bounds, 1.0)
    assert from_entry(as_entry(learned_from(estimate))).factors[:4].tolist() == bounds[:4]


@pytest.mark.parametrize('entry', [None, 7, 'text', [], {}, {'log_factors': {}},
                                   {'log_factors': [], 'covariance': []}])
def test_what_is_no_entry_is_refused(entry):
    with pytest.raises(InvalidInput, match='log_factors or covariance is damaged'):
        from_entry(entry)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize(
    'value', [float('nan'), float('inf'), -9.0, None, 'x', [1.0], pytest.param(
        10**400, id='more than a float holds')])
def test_a_factor_out_of_bounds_is_refused(entry, name, value):
    entry['log_factors'][name] = value
    with pytest.raises(InvalidInput, match='log_factors'):
        from_entry(entry)


@pytest.mark.parametrize('index', range(4))
def test_a_factor_at_its_bound_is_allowed_and_beyond_is_not(entry, index):
    bound = FACTOR_BOUNDS[FACTORS.start + index]
    for value in (bound, -bound):
        entry['log_factors'][NAMES[index]] = value
        assert from_entry(entry).factors[index] == value
    entry['log_factors'][NAMES[index]] = 1.01 * bound
    with pytest.raises(InvalidInput, match=f'log_factors.{NAMES[index]}'):
        from_entry(entry)


@pytest.mark.parametrize('covariance', [
    [], None, 'x', [[1e-4] * 4] * 3, [[float('nan')] * 4] * 4, (-1e-4 * np.eye(4)).tolist(),
    (10.0 * np.eye(4)).tolist(), np.diag([1e-4] * 3, 1).tolist(),
    (1e-6 * np.eye(4) + 1e-4 * (np.ones((4, 4)) - np.eye(4))).tolist()],
    ids=['empty', 'none', 'text', 'shape', 'nan', 'negative', 'too large', 'not symmetric',
         'not positive'])
def test_a_covariance_that_is_none_is_refused(entry, covariance):
    entry['covariance'] = covariance
    with pytest.raises(InvalidInput, match='covariance'):
        from_entry(entry)
