# SPDX-License-Identifier: Apache-2.0
"""The state file: what comes back of it, what a crash leaves, and what damage does."""

import json
import os

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation import memory
from bev_preheat.estimation.belief import FACTOR_BOUNDS, prior_factor_covariance
from bev_preheat.estimation.estimator import Estimate
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.estimation.memory import (
    Learned, learned_from, load_learned, OVERNIGHT, save_learned)
from bev_preheat.estimation.state import FACTORS, SIZE

FINGERPRINT = 'a' * 64
FACTORS_SEEN = np.array([0.07, -0.2, 0.11, -0.03, 0.4])


def some_covariance():
    """A covariance that is less than the prior's, with correlations."""
    deviations = 0.3 * np.sqrt(np.diag(prior_factor_covariance()))
    correlation = 0.25 * np.ones((5, 5)) + 0.75 * np.eye(5)
    return correlation * np.outer(deviations, deviations)


def an_estimate(covariance=None):
    whole = np.eye(SIZE)
    whole[FACTORS, FACTORS] = some_covariance() if covariance is None else covariance
    return Estimate(0, np.concatenate(([12.0, 0.7], FACTORS_SEEN)), whole,
                    HeaterReport(Heater.ANSWERS, 1.0, 1.0), 0.0)


@pytest.fixture
def state_file(tmp_path):
    path = tmp_path / 'deeper' / 'state.json'
    save_learned(path, FINGERPRINT, learned_from(an_estimate()))
    return path


def changed(path, **changes):
    contents = json.loads(path.read_text())
    contents.update(changes)
    path.write_text(json.dumps(contents))
    return path


def test_the_car_is_remembered_and_a_night_makes_it_less_sure(state_file):
    learned = load_learned(state_file, FINGERPRINT)
    assert learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert learned.covariance[:4, :4] == pytest.approx(
        some_covariance()[:4, :4] + OVERNIGHT**2 * np.eye(4))


def test_the_routes_consumption_is_forgotten(state_file):
    learned = load_learned(state_file, FINGERPRINT)
    assert learned.factors[4] == 0.0
    assert learned.covariance[4].tolist() == prior_factor_covariance()[4].tolist()


def test_nothing_is_learned_less_than_the_prior():
    learned = learned_from(an_estimate(9.0 * prior_factor_covariance()))
    assert np.diag(learned.covariance) == pytest.approx(np.diag(prior_factor_covariance()))


def test_a_mean_that_is_rounded_beyond_a_bound_can_be_remembered(tmp_path):
    estimate = an_estimate()
    estimate.mean[FACTORS] = [np.nextafter(FACTOR_BOUNDS[FACTORS.start + index], 1.0)
                              for index in range(5)]
    save_learned(tmp_path / 'state.json', FINGERPRINT, learned_from(estimate))
    assert load_learned(tmp_path / 'state.json', FINGERPRINT) is not None


def test_no_file_is_nothing_learned(tmp_path):
    assert load_learned(tmp_path / 'none.json', FINGERPRINT) is None


def test_what_was_learned_of_another_vehicle_file_is_not_taken_over(state_file):
    with pytest.raises(InvalidInput, match='another vehicle file'):
        load_learned(state_file, 'b' * 64)


def test_a_crash_before_the_end_leaves_the_file_before(state_file, monkeypatch):
    before = state_file.read_bytes()

    def crash(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(memory.os, 'replace', crash)
    with pytest.raises(KeyboardInterrupt):
        save_learned(state_file, FINGERPRINT, Learned(np.zeros(5), prior_factor_covariance()))
    assert state_file.read_bytes() == before
    assert os.listdir(state_file.parent) == [state_file.name]


def test_what_is_written_is_on_the_disk_before_it_takes_the_place(state_file, monkeypatch):
    order = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(memory.os, 'fsync', lambda file: (order.append('fsync'), fsync(file)))
    monkeypatch.setattr(
        memory.os, 'replace', lambda *names: (order.append('replace'), replace(*names)))
    save_learned(state_file, FINGERPRINT, Learned(np.zeros(5), prior_factor_covariance()))
    assert order == ['fsync', 'replace']
    assert load_learned(state_file, FINGERPRINT).factors.tolist() == [0.0] * 5


@pytest.mark.parametrize('contents', [
    b'', b'{', b'[]', b'null', b'7', b'"text"', b'{"format": 1}', b'\xff\xfe\x00', b'[' * 50_000,
    b' ' * 200_000], ids=['empty', 'cut off', 'list', 'null', 'number', 'text', 'nothing in it',
                          'not UTF-8', 'deep', 'long'])
def test_damage_is_told_with_the_files_name(state_file, contents):
    state_file.write_bytes(contents)
    with pytest.raises(InvalidInput, match='state.json: '):
        load_learned(state_file, FINGERPRINT)


def test_a_folder_is_no_state_file(tmp_path):
    with pytest.raises(InvalidInput, match='cannot be read'):
        load_learned(tmp_path, FINGERPRINT)


@pytest.mark.parametrize('share', [0.1, 0.5, 0.9, 0.99])
def test_a_file_that_was_cut_off_is_damaged(state_file, share):
    whole = state_file.read_bytes()
    state_file.write_bytes(whole[:int(share * len(whole))])
    with pytest.raises(InvalidInput, match='state.json: cannot be read'):
        load_learned(state_file, FINGERPRINT)


NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency')


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('value', [float('nan'), float('inf'), -9.0, None, 'x', [1.0]])
def test_a_factor_out_of_bounds_is_refused(state_file, name, value):
    logs = json.loads(state_file.read_text())['log_factors']
    with pytest.raises(InvalidInput, match='log_factors'):
        load_learned(changed(state_file, log_factors={**logs, name: value}), FINGERPRINT)


@pytest.mark.parametrize('index', range(4))
def test_a_factor_at_its_bound_is_allowed_and_beyond_is_not(state_file, index):
    logs = json.loads(state_file.read_text())['log_factors']
    bound = FACTOR_BOUNDS[FACTORS.start + index]
    for value in (bound, -bound):
        changed(state_file, log_factors={**logs, NAMES[index]: value})
        assert load_learned(state_file, FINGERPRINT).factors[index] == value
    with pytest.raises(InvalidInput, match=f'log_factors.{NAMES[index]}'):
        load_learned(changed(state_file, log_factors={**logs, NAMES[index]: 1.01 * bound}),
                     FINGERPRINT)


@pytest.mark.parametrize('covariance', [
    [], None, 'x', [[1e-4] * 4] * 3, [[float('nan')] * 4] * 4, (-1e-4 * np.eye(4)).tolist(),
    (10.0 * np.eye(4)).tolist(), np.diag([1e-4] * 3, 1).tolist(),
    (1e-6 * np.eye(4) + 1e-4 * (np.ones((4, 4)) - np.eye(4))).tolist()],
    ids=['empty', 'none', 'text', 'shape', 'nan', 'negative', 'too large', 'not symmetric',
         'not positive'])
def test_a_covariance_that_is_none_is_refused(state_file, covariance):
    with pytest.raises(InvalidInput, match='covariance'):
        load_learned(changed(state_file, covariance=covariance), FINGERPRINT)


@pytest.mark.parametrize('format_', [0, 2, '1', None])
def test_another_format_is_refused(state_file, format_):
    with pytest.raises(InvalidInput, match='format 1'):
        load_learned(changed(state_file, format=format_), FINGERPRINT)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(
        st.sampled_from(NAMES), inner, max_size=4), max_leaves=30)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(contents=st.one_of(
    st.binary(max_size=200),
    st.fixed_dictionaries({
        'format': st.just(1), 'vehicle_file_sha256': st.just(FINGERPRINT), 'log_factors': JSON,
        'covariance': JSON | st.lists(st.lists(st.floats(), min_size=4, max_size=4),
                                      min_size=4, max_size=4)}).map(
        lambda value: json.dumps(value).encode())))
def test_whatever_stands_in_it_is_refused_or_is_a_car(tmp_path_factory, contents):
    path = tmp_path_factory.getbasetemp() / 'any.json'
    path.write_bytes(contents)
    try:
        learned = load_learned(path, FINGERPRINT)
    except InvalidInput:
        return
    assert np.isfinite(learned.factors).all()
    assert (np.linalg.eigvalsh(learned.covariance) > -1e-12).all()
