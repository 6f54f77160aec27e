# SPDX-License-Identifier: Apache-2.0
"""Learned values of a car: stored, restored, and damaged."""

import json

from learned_cars import an_estimate, FACTORS_SEEN, LAG_VARIANCES_SEEN, LAGS_SEEN, some_covariance
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.prior import LAG_BOUNDS
from bev_preheat.estimation.state_file import as_entry, from_entry, learned_from
from bev_preheat.tunables import OVERNIGHT

NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency')


@pytest.fixture
def entry():
    """Return a stored entry after a round trip through JSON."""
    return json.loads(json.dumps(as_entry(learned_from(an_estimate()))))


def test_the_car_is_remembered_and_a_night_makes_it_less_sure(entry):
    learned = from_entry(entry)
    assert learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert learned.covariance[:4, :4] == pytest.approx(
        some_covariance()[:4, :4] + OVERNIGHT**2 * np.eye(4))


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


def test_lags_are_remembered_and_a_night_makes_them_less_sure(entry):
    lags = from_entry(entry).lags
    assert lags.logs == pytest.approx(LAGS_SEEN)
    assert lags.variances == pytest.approx(LAG_VARIANCES_SEEN + OVERNIGHT**2)


@pytest.mark.parametrize('heater', [kind for kind in Heater if kind is not Heater.ANSWERS])
def test_a_heater_that_does_not_obey_tells_nothing_of_lags(heater):
    learned = learned_from(an_estimate(heater=heater))
    assert learned.lags is None
    assert from_entry(json.loads(json.dumps(as_entry(learned)))).lags is None


@pytest.mark.parametrize('key', ['log_lags', 'lag_variances'])
@pytest.mark.parametrize('value', [
    None, 7, [], {}, {'heat': 0.1}, {'heat': 'x', 'sensor': 0.1}, {'heat': [0.1], 'sensor': 0.1},
    {'heat': float('nan'), 'sensor': 0.1}, {'heat': 0.1, 'sensor': float('inf')},
    {'heat': 0.1, 'sensor': -9.0}, {'heat': 10**400, 'sensor': 0.1}])
def test_lags_that_are_none_are_refused(entry, key, value):
    entry[key] = value
    with pytest.raises(InvalidInput, match='log_lags|lag_variances'):
        from_entry(entry)


@pytest.mark.parametrize('at, name', [(0, 'heat'), (1, 'sensor')])
def test_a_lag_at_its_bound_is_allowed_and_beyond_is_not(entry, at, name):
    for bound in LAG_BOUNDS[at].tolist():
        entry['log_lags'][name] = bound
        assert from_entry(entry).lags.logs[at] == bound
        entry['log_lags'][name] = 1.01 * bound
        with pytest.raises(InvalidInput, match=f'log_lags.{name}'):
            from_entry(entry)
