# SPDX-License-Identifier: Apache-2.0
"""The state file: overwriting, damaged files, and restored contents."""

from itertools import product
import json
import os
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation import state_file as module
from bev_preheat.estimation.before_restart import LastSeen, NO_CHOICES
from bev_preheat.estimation.estimate import Estimate, FACTORS, SIZE, SOC, TEMPERATURE
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.estimation.prior import LAG_BOUNDS, LAGS, nothing_learned, prior_factor_covariance
from bev_preheat.estimation.state_file import (
    as_entry,
    check_state_file,
    from_entry,
    learned_from,
    load_state,
    MOST_CARS,
    save_state,
)
from bev_preheat.tunables import OVERNIGHT

CAR, OTHER = 'a' * 64, 'b' * 64
NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'source_heat')
UNKNOWN = nothing_learned()
FACTORS_SEEN = np.array([0.07, -0.2, 0.11, -0.03, 0.4, 0.09])
LAGS_SEEN, LAG_VARIANCES_SEEN = np.array([0.6, -0.9]), np.array([0.04, 0.2])


def some_covariance():
    """Return a covariance smaller than the prior's, with correlations."""
    deviations = 0.3 * np.sqrt(np.diag(prior_factor_covariance()))
    correlation = 0.25 * np.ones((6, 6)) + 0.75 * np.eye(6)
    return correlation * np.outer(deviations, deviations)


def learned(heater=Heater.ANSWERS):
    """Return the knowledge that an estimate with FACTORS_SEEN and LAGS_SEEN leaves to the next trip."""
    mean, covariance = np.zeros(SIZE), np.eye(SIZE)
    mean[[TEMPERATURE, SOC]], mean[FACTORS], mean[[*LAGS]] = (12.0, 0.7), FACTORS_SEEN, LAGS_SEEN
    covariance[FACTORS, FACTORS] = some_covariance()
    covariance[LAGS, LAGS] = LAG_VARIANCES_SEEN
    return learned_from(Estimate(0, mean, covariance, HeaterReport(heater, 1.0, 1.0), 0.0))


@pytest.fixture
def state_file(tmp_path):
    path = tmp_path / 'deeper' / 'state.json'
    assert save_state(path, CAR, learned()) is None
    return path


def format_1():
    """Return a file as version 0.2.0 wrote it, with indent=1 and the keys in this order."""
    entry = as_entry(learned())
    return {'format': 1, 'vehicle_file_sha256': CAR,
            'log_factors': {name: entry['log_factors'][name] for name in NAMES[:4]},
            'covariance': [row[:4] for row in entry['covariance'][:4]]}


def written_by_version_0_2(contents):
    return json.dumps(contents, indent=1) + '\n'


def refusal(path):
    """Return the refusal of a path, the same for checking, reading and writing."""
    sentences = set()
    for use in (lambda: check_state_file(path), lambda: load_state(path, CAR),
                lambda: save_state(path, CAR, learned())):
        with pytest.raises(InvalidInput) as refused:
            use()
        sentences.add(str(refused.value))
    (sentence,) = sentences
    return sentence


# The entry of a car

@pytest.fixture
def entry():
    """Return a stored entry after a round trip through JSON."""
    return json.loads(json.dumps(as_entry(learned())))


def test_the_car_is_remembered_and_a_night_makes_it_less_sure(entry):
    restored = from_entry(entry)
    assert restored.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert restored.covariance[:4, :4] == pytest.approx(some_covariance()[:4, :4] + OVERNIGHT**2 * np.eye(4))
    assert restored.lags.logs == pytest.approx(LAGS_SEEN)
    assert restored.lags.variances == pytest.approx(LAG_VARIANCES_SEEN + OVERNIGHT**2)


@pytest.mark.parametrize('heater', [kind for kind in Heater if kind is not Heater.ANSWERS])
def test_a_heater_that_does_not_obey_tells_nothing_of_lags(heater):
    without_lags = learned(heater)
    assert without_lags.lags is None
    assert from_entry(json.loads(json.dumps(as_entry(without_lags)))).lags is None


NO_NUMBERS = [float('nan'), float('inf'), -9.0, None, 'x', [1.0], pytest.param(
    10**400, id='more than a float holds')]


@pytest.mark.parametrize('key, name', [
    *(('log_factors', name) for name in NAMES),
    *((key, name) for key in ('log_lags', 'lag_variances') for name in ('heat', 'sensor'))])
@pytest.mark.parametrize('value', NO_NUMBERS)
def test_a_value_that_is_no_number_or_out_of_bounds_is_refused(entry, key, name, value):
    entry[key][name] = value
    with pytest.raises(InvalidInput, match=key):
        from_entry(entry)


NO_COVARIANCE = {
    'empty': [], 'none': None, 'text': 'x', 'shape': [[1e-4] * 4] * 3, 'nan': [[float('nan')] * 4] * 4,
    'negative': (-1e-4 * np.eye(4)).tolist(), 'too large': (10.0 * np.eye(4)).tolist(),
    'not symmetric': np.diag([1e-4] * 3, 1).tolist(),
    'not positive': (1e-6 * np.eye(4) + 1e-4 * (np.ones((4, 4)) - np.eye(4))).tolist()}


@pytest.mark.parametrize('key, value', [
    *product(('log_factors', 'log_lags', 'lag_variances'), (None, 7, [], {}, {'heat': 0.1})),
    *(pytest.param('covariance', value, id=f'covariance, {name}') for name, value in NO_COVARIANCE.items())])
def test_what_holds_no_values_is_refused(entry, key, value):
    entry[key] = value
    with pytest.raises(InvalidInput, match=key):
        from_entry(entry)


@pytest.mark.parametrize('at, name', [(0, 'heat'), (1, 'sensor')])
def test_a_lag_at_its_bound_is_allowed_and_beyond_is_not(entry, at, name):
    for bound in LAG_BOUNDS[at].tolist():
        entry['log_lags'][name] = bound
        assert from_entry(entry).lags.logs[at] == bound
        entry['log_lags'][name] = 1.01 * bound
        with pytest.raises(InvalidInput, match=f'log_lags.{name}'):
            from_entry(entry)


# Restored contents

def test_what_was_learned_with_another_vehicle_file_is_kept_and_not_taken_over(state_file):
    before = json.loads(state_file.read_text())['cars'][CAR]
    assert load_state(state_file, OTHER).learned is None
    for _ in range(3):
        save_state(state_file, OTHER, UNKNOWN)
    assert load_state(state_file, OTHER).learned.factors.tolist() == [0.0] * 6
    assert json.loads(state_file.read_text())['cars'][CAR] == before
    recalled = load_state(state_file, CAR)
    assert recalled.learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert recalled.learned.lags.logs == pytest.approx(LAGS_SEEN)
    assert recalled.damage == ''


@pytest.mark.costly
def test_the_car_that_was_written_longest_ago_gives_way(state_file):
    for number in range(MOST_CARS - 1):
        save_state(state_file, f'{number:064x}', UNKNOWN)
    assert load_state(state_file, CAR).learned is not None
    assert len(state_file.read_bytes()) < module.LARGEST_STATE_FILE_BYTES / 2
    save_state(state_file, f'{0:064x}', UNKNOWN)
    save_state(state_file, OTHER, UNKNOWN)
    assert load_state(state_file, CAR).learned is None
    assert load_state(state_file, f'{0:064x}').learned is not None
    assert load_state(state_file, f'{1:064x}').learned is not None


@pytest.mark.parametrize('as_text', [
    written_by_version_0_2, json.dumps, lambda contents: json.dumps(contents, sort_keys=True)],
    ids=['as it was', 'on one line', 'sorted'])
def test_a_file_of_format_1_is_read_and_becomes_one_of_the_present_format(tmp_path, as_text):
    path = tmp_path / 'state.json'
    path.write_text(as_text(format_1()))
    assert load_state(path, CAR).learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert load_state(path, OTHER).learned is None
    save_state(path, OTHER, UNKNOWN)
    assert load_state(path, CAR).learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert set(json.loads(path.read_text())['cars']) == {CAR, OTHER}


def test_a_file_of_format_2_is_read_and_becomes_one_of_the_present_format(tmp_path):
    path = tmp_path / 'state.json'
    path.write_text(WHOLE)
    recalled = load_state(path, CAR)
    assert (recalled.last_seen, recalled.choices, recalled.damage) == (None, NO_CHOICES, '')
    assert recalled.learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    save_state(path, OTHER, None, LastSeen(11.5, 0.375, 1_700_000_000_000_000_001))
    assert json.loads(path.read_text())['bev_preheat_state_file'] == 3
    assert load_state(path, CAR).learned is not None


# Files of others

FOREIGN = {
    'list': '[]', 'null': 'null', 'number': '7', 'text': '"text"', 'no JSON': '{',
    'nothing in it': '{}', 'a format': '{"format": 1}', 'another format': '{"format": 1, "x": {}}',
    'factors of others': '{"log_factors": {"leakage": 0.1}, "covariance": [[0.1]]}',
    'our mark within': '{"notes": {"bev_preheat_state_file": 2}}',
    'our mark in a list': '[{"bev_preheat_state_file": 2}]',
    'our mark behind damage': '?{"bev_preheat_state_file": 2, "cars": {}}',
    'not UTF-8': b'\xff\xfe\x00', 'deep': '[' * 50_000, 'large': ' ' * 200_000}


@pytest.mark.parametrize('contents', FOREIGN.values(), ids=FOREIGN)
def test_a_file_that_is_not_recognised_is_not_written_over(tmp_path, contents):
    path = tmp_path / 'theirs.json'
    contents = contents if isinstance(contents, bytes) else contents.encode()
    path.write_bytes(contents)
    assert refusal(path) == (f'{path}: is not a state file of this planner, and stays as it is; name '
                             'another file')
    assert path.read_bytes() == contents
    assert os.listdir(tmp_path) == ['theirs.json']


def test_an_empty_file_becomes_a_state_file(tmp_path):
    path = tmp_path / 'state.json'
    path.touch()
    check_state_file(path)
    assert load_state(path, CAR).damage == ''
    save_state(path, CAR, learned())
    assert load_state(path, CAR).learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert os.listdir(tmp_path) == ['state.json']


def test_a_file_of_a_later_version_is_not_written_over(state_file):
    contents = {**json.loads(state_file.read_text()), 'bev_preheat_state_file': 4, 'new': [1]}
    state_file.write_text(json.dumps(contents))
    assert refusal(state_file) == (f'{state_file}: has format 4 of a later version; this '
                                   'version reads 1 to 3; name another file')
    assert json.loads(state_file.read_text()) == contents


def what_is_there(path):
    """Return everything that a change would alter; reading a link changes its access time."""
    found = path.lstat()
    return found.st_ino, found.st_mode, found.st_size, found.st_mtime_ns, found.st_ctime_ns


# Others: test/files/test_output_files.py.
@pytest.mark.parametrize('make, problem', [
    (os.mkfifo, 'is a named pipe; only a regular file can be written'),
    (lambda path: path.symlink_to('none'), 'is a link to {folder}/none, which does not exist; '
     'name that file itself')], ids=['pipe', 'dangling link'])
def test_what_is_no_file_is_refused(tmp_path, make, problem):
    path = tmp_path / 'theirs'
    make(path)
    before = what_is_there(path)
    assert refusal(path) == f'{path}: {problem.format(folder=os.path.realpath(tmp_path))}'
    assert what_is_there(path) == before
    assert os.listdir(tmp_path) == ['theirs']


def test_a_file_that_cannot_be_read_is_refused(state_file, monkeypatch):
    """The test raises the error itself, because root may read everything."""
    before = state_file.read_bytes()

    def forbid(path, *arguments):
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(module.os, 'open', forbid)
    assert refusal(state_file) == f'{state_file}: cannot be read: Permission denied'
    monkeypatch.undo()
    assert state_file.read_bytes() == before


# Damaged state files

def with_entry(**changes):
    return json.dumps({'bev_preheat_state_file': 2,
                       'cars': {CAR: {**as_entry(learned()), **changes}}})


def format_1_with(**changes):
    return written_by_version_0_2({**format_1(), **changes})


WHOLE = json.dumps({'bev_preheat_state_file': 2, 'cars': {CAR: as_entry(learned())}}, indent=1)
DAMAGED = {
    'cut off early': (WHOLE[:40], 'it cannot be read: '),
    'cut off late': (WHOLE[:-3], 'it cannot be read: '),
    'zeros at its end': (WHOLE[:200] + '\0' * 200, 'it cannot be read: '),
    'much behind its end': (WHOLE + '?' * 200_000, 'it is larger than 100000 bytes'),
    'no format': ('{"bev_preheat_state_file": null, "cars": {}}', 'its format or'),
    'no cars': ('{"bev_preheat_state_file": 2}', 'its format or its list of cars is damaged'),
    'list of cars': ('{"bev_preheat_state_file": 2, "cars": []}', 'its format or'),
    'no entry': ('{"bev_preheat_state_file": 2, "cars": {"c": 7}}', 'car c: log_factors or'),
    'lag out of bounds': (with_entry(log_lags={'heat': 9.0, 'sensor': 0.0}),
                          'car aaaaaaaaaaaa: log_lags.heat: 9 is not allowed'),
    'no covariance': (with_entry(covariance='x' * 10_000), 'car aaaaaaaaaaaa: log_factors or'),
    'seen too warm': (with_entry(last_seen={'temperature_c': 1e3, 'soc': 0.5, 'stamp_ns': 1}),
                      "car aaaaaaaaaaaa: last_seen.temperature_c: '1000.0' is not allowed; it must be "
                      '-100 ... 150'),
    'seen too full': (with_entry(last_seen={'temperature_c': 1.0, 'soc': float('nan'), 'stamp_ns': 1}),
                      "car aaaaaaaaaaaa: last_seen.soc: 'nan' is not allowed; it must be 0 ... 1"),
    'seen at no instant': (with_entry(last_seen={'temperature_c': 1.0, 'soc': 0.5, 'stamp_ns': 1.5}),
                           "car aaaaaaaaaaaa: last_seen.stamp_ns: '1.5' is not allowed; it must be a "
                           'whole number, 0 ... 9223372036854775807'),
    'nothing seen': (with_entry(last_seen=None), 'car aaaaaaaaaaaa: last_seen: must have'),
    'no driver': ('{"bev_preheat_state_file": 3, "cars": {}, "driver": 7}', 'driver: must have'),
    'off at no instant': ('{"bev_preheat_state_file": 3, "cars": {}, "driver": {"switched_off_ns": true}}',
                          "driver.switched_off_ns: 'True' is not allowed"),
    'no trip': ('{"bev_preheat_state_file": 3, "cars": {}, "driver": {"cancelled_trip": {}}}',
                'driver.cancelled_trip: must have route_id'),
    'format 1, cut off': (written_by_version_0_2(format_1())[:100], 'it cannot be read: '),
    'format 1, covariance': (format_1_with(covariance=[]), 'car aaaaaaaaaaaa: covariance: must'),
    'format 1, fingerprint': (format_1_with(vehicle_file_sha256=[1]), 'its format or its list')}


@pytest.mark.parametrize('contents, damage', DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_file_of_ours_is_kept_aside_and_a_new_one_begun(tmp_path, contents, damage):
    path = tmp_path / 'state.json'
    path.write_text(contents)
    check_state_file(path)
    recalled = load_state(path, CAR)
    assert recalled.learned is None
    assert recalled.damage.startswith(damage) and len(recalled.damage) <= 300
    assert os.listdir(tmp_path) == ['state.json'] and path.read_text() == contents
    assert save_state(path, CAR, learned()) == os.path.realpath(f'{path}.damaged')
    assert Path(f'{path}.damaged').read_text() == contents
    assert load_state(path, CAR).learned is not None
    assert load_state(path, CAR).damage == ''
    assert sorted(os.listdir(tmp_path)) == ['state.json', 'state.json.damaged']


def test_files_that_were_kept_aside_before_stay(tmp_path):
    path = tmp_path / 'state.json'
    for number in range(3):
        path.write_text(WHOLE[:50 + number])
        save_state(path, CAR, learned())
    kept = {name: (tmp_path / name).read_text() for name in os.listdir(tmp_path)}
    del kept['state.json']
    assert kept == {'state.json.damaged': WHOLE[:50], 'state.json.damaged.2': WHOLE[:51],
                    'state.json.damaged.3': WHOLE[:52]}


def test_what_is_sound_in_a_damaged_file_goes_on(tmp_path):
    path = tmp_path / 'state.json'
    path.write_text(json.dumps({'bev_preheat_state_file': 2, 'cars': {
        CAR: as_entry(learned()), OTHER: {'log_factors': None}}}))
    recalled = load_state(path, CAR)
    assert recalled.learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])
    assert recalled.damage.startswith('car bbbbbbbbbbbb: log_factors or covariance is damaged')
    save_state(path, OTHER, UNKNOWN)
    assert load_state(path, CAR).learned.factors[:4] == pytest.approx(FACTORS_SEEN[:4])


def test_a_damaged_file_stays_in_its_place_where_no_new_one_can_be_written(tmp_path, monkeypatch):
    path = tmp_path / 'state.json'
    path.write_text(WHOLE[:50])

    def fail(*_, **__):
        raise InvalidInput('no space left')

    monkeypatch.setattr(module, 'write_whole', fail)
    with pytest.raises(InvalidInput, match='no space left'):
        save_state(path, CAR, learned())
    assert path.read_text() == WHOLE[:50]
    assert os.listdir(tmp_path) == ['state.json']


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(
        st.sampled_from(NAMES), inner, max_size=4), max_leaves=30)
ENTRY = st.fixed_dictionaries({'log_factors': JSON, 'covariance': JSON | st.lists(
    st.lists(st.floats(), min_size=4, max_size=4), min_size=4, max_size=4)}, optional={
        'last_seen': st.fixed_dictionaries({'temperature_c': JSON, 'soc': JSON, 'stamp_ns': JSON})})
DRIVER = st.fixed_dictionaries({}, optional={
    'switched_off_ns': JSON, 'cancelled_trip': st.fixed_dictionaries(
        {'route_id': JSON, 'route_stamp_ns': JSON, 'cancelled_ns': JSON})})


@given(contents=st.one_of(
    st.binary(max_size=200),
    st.fixed_dictionaries({'bev_preheat_state_file': st.sampled_from([2, 3]),
                           'cars': st.dictionaries(st.just(CAR), ENTRY | JSON)},
                          optional={'driver': DRIVER | JSON}).map(
        lambda value: json.dumps(value).encode()),
    st.integers(0, len(WHOLE)).map(lambda length: WHOLE[:length].encode())))
def test_whatever_stands_in_it_is_refused_or_kept(tmp_path_factory, contents):
    """No byte is lost: the file is unchanged, moved aside, or was sound."""
    folder = tmp_path_factory.mktemp('any')
    path = folder / 'any.json'
    path.write_bytes(contents)
    try:
        recalled = load_state(path, CAR)
    except InvalidInput:
        with pytest.raises(InvalidInput):
            save_state(path, OTHER, UNKNOWN)
        assert path.read_bytes() == contents
        return
    save_state(path, OTHER, UNKNOWN)
    if recalled.damage:
        assert (folder / 'any.json.damaged').read_bytes() == contents
    else:
        cars = json.loads(contents)['cars'] if contents else {}
        assert {name: entry for name, entry in json.loads(path.read_bytes())['cars'].items()
                if name != OTHER} == cars
    if recalled.learned is not None:
        assert np.isfinite(recalled.learned.factors).all()
        assert (np.linalg.eigvalsh(recalled.learned.covariance) > -1e-12).all()
