# SPDX-License-Identifier: Apache-2.0
"""The verdict on an identified car and what to record next, for each situation that recordings may leave."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from bev_preheat.identification.result import Coverage, Estimated, missing_recordings, verdict_of
from bev_preheat.identification.structures import graded, LeftOut, StructureResult

WHOLE = Coverage(
    trips=12, drives=9, nights=2, charging_sessions=1, heated_trips=4, unheated_drives=5, hours=20.0,
    battery_c=(-14.0, 30.0), ambient_c=(-15.0, 20.0), soc=(0.2, 0.9), speed_mps=(0.0, 36.0),
    resistance_from_c=-12.0, resistance_to_c=28.0, coldest_trip='', coldest_c=-12.0, telling_nights=1)
MEASURED, UNMEASURED = SimpleNamespace(used=('a', 'b')), SimpleNamespace(used=())
NAMES = ('heat_capacity', 'leakage', 'drivetrain_heat')


def estimates(*unknown):
    return [Estimated(name, name.replace('_', ' '), '', 1.0, 1.0, 0.9, 1.1, 0.5, 1.5, name not in unknown, 0.1, '',
                      name) for name in NAMES]


def structure(name, *errors_k, misfit=0.0):
    return StructureResult(name, 0.0, (misfit, 0.0), errors_k)


def result(left_out, *structures, baselines=(), **changes):
    """Return the parts of an Identification that its sentences are about."""
    return SimpleNamespace(**{
        'estimates': estimates(), 'left_out': left_out, 'structures': structures, 'structure': 'one mass',
        'baselines': {each.structure: each for each in baselines}, 'coverage': WHOLE, 'together': (),
        'electrical': MEASURED, **changes})


def verdict(errors_k=(0.3, -0.4), deviation_k=1.0, others=(), unknown=(), **changes):
    left_out = [LeftOut(f'trip {number}', error_k, deviation_k) for number, error_k in enumerate(errors_k)]
    return list(verdict_of(result(left_out, structure('one mass', *errors_k), *others,
                                  **{'estimates': estimates(*unknown), **changes})))


def changed(**values):
    return Coverage(**{**WHOLE.as_dictionary(), 'battery_c': WHOLE.battery_c, **values})


@pytest.mark.parametrize('error_k, grade', [
    (0.59, 'The file can be trusted for drives like the recorded ones'), (0.61, 'The file can be used with care'),
    (1.49, 'The file can be used with care'), (1.51, 'The file should not be trusted yet')])
def test_the_error_of_trips_left_out_grades_the_file(error_k, grade):
    first, *_ = verdict((error_k, -error_k))
    assert first.startswith(f'{grade}: ') and f'RMSE of {error_k:.2f} K' in first


@pytest.mark.parametrize('changes, words', [
    ({'estimate': 1.6, 'high': 1.7}, 'heater efficiency: 1.6 is outside 0.5 … 1.5 (as sold): either START or a '),
    ({'estimate': 0.4, 'low': 0.3}, 'heater efficiency: 0.4 is outside 0.5 … 1.5'),
    ({'bound': 1.0}, 'heater efficiency: 1 lies at its bound: either START'),
    ({'estimate': 0.4, 'can_be_0': True}, ''), ({'estimate': 0.0, 'bound': 0.0, 'can_be_0': True}, ''),
    ({'bound': 1.0, 'can_be_0': True}, 'lies at its bound'),
    ({'estimate': 1.6, 'is_identified': False}, ''), ({'estimate': 1.6, 'name': 'heat_lag'}, '')])
def test_an_estimate_outside_its_prior_or_at_its_bound_is_no_file_to_trust(changes, words):
    item = replace(estimates()[0], label='heater efficiency', prior='as sold', **changes)
    first, *others = verdict((0.2,), estimates=[item])
    assert first.startswith('The file should not be trusted yet' if words else 'The file can be trusted')
    assert bool(words) is ('yet, because of its heater efficiency (see below): ' in first)
    assert bool(words) is any('either START or a signal' in sentence for sentence in others)
    assert words in ' '.join(others)


def test_the_only_night_does_not_grade_a_file():
    drives = [LeftOut(f'drive {number}', error_k, 1.0) for number, error_k in enumerate((0.3, -0.3))]
    lonely = LeftOut('night', -4.8, 1.0, 'night at stand')
    assert graded([*drives, lonely]) == drives
    twice = [*drives, lonely, replace(lonely, name='another')]
    assert graded(twice) == twice and graded([lonely]) == [lonely]
    first, second, *_ = verdict_of(result([*drives, lonely], structure('one mass', 0.3)))
    assert first.startswith('The file can be trusted') and 'RMSE of 0.30 K' in first
    assert second == ('night is the only night at stand: without it the others miss it by -4.80 K; no other '
                      'log tests its part of the file.')


def test_a_structure_that_diverges_is_named_without_its_digits():
    other = structure('two masses', 1e82, -0.1)
    assert other.diverges and not structure('one mass', 199.0).diverges
    assert structure('one mass', float('nan')).diverges
    found = verdict(others=(other,))
    assert found[-1] == 'On these trips the fit diverges: two masses.'
    assert max(map(len, found)) < 400


def test_the_worst_trip_and_those_outside_their_interval_are_named():
    # The 90 % interval of a standard deviation of 0.2 K ends at 0.33 K.
    first, second, *_ = verdict((0.3, -0.4, 0.1), 0.2)
    assert 'worst -0.40 K, trip 1' in first
    assert second == 'Outside its 90 % interval: trip 1 of 3 trips.'


@pytest.mark.parametrize('error_k, consequence', [
    (0.5, 'these trips are too alike to test the file for others'), (1.0, 'the fit has no value yet')])
def test_a_baseline_that_does_better_is_told(error_k, consequence):
    worse, better = structure('constant temperature', 2.0), structure('mean rise', 0.1)
    found = verdict((error_k,), baselines=(worse, better))
    assert f'A mean rise does better on these trips (0.10 K): {consequence}.' in found
    assert not any('constant temperature' in sentence for sentence in found)


@pytest.mark.parametrize('coverage, electrical, expected', [
    (WHOLE, UNMEASURED, ["No log has voltage and current that change: resistance keeps START's value, and heat "
                         'capacity is known only as far as that value is right.']),
    (changed(resistance_from_c=None, resistance_to_c=None, coldest_trip='night'), MEASURED,
     ['Resistance rests on one log only (night).']),
    (changed(coldest_c=-14.0, coldest_trip='frost'), MEASURED,
     ['Resistance below -12 degC is extrapolated: down to -14 degC it rests on one trip (frost), below that on '
      'the prior alone.', 'Resistance above 28 degC is extrapolated.']),
    (WHOLE, MEASURED, ['Resistance below -12 degC is extrapolated: it rests on the prior alone.',
                       'Resistance above 28 degC is extrapolated.'])])
def test_where_the_resistance_is_known(coverage, electrical, expected):
    assert [sentence for sentence in verdict(coverage=coverage, electrical=electrical)
            if 'esistance' in sentence] == expected


def test_what_the_logs_do_not_tell_is_named():
    found = verdict(coverage=changed(heated_trips=0), unknown=('leakage', 'drivetrain_heat'), together=[
        ('heat_capacity', 'leakage', -0.97), ('heat_capacity', 'of another fit', 0.99)])
    assert "Not told by these logs, so START's value stays: leakage, drivetrain heat." in found
    assert 'Without any use of the battery heater its efficiency is unknown.' in found
    assert [sentence for sentence in found if sentence.startswith('Known only together')] == [
        'Known only together (correlation -0.97): heat capacity and leakage.']


def test_the_structure_is_one_sentence_with_its_evidence():
    first, other = structure('one mass', 0.4, misfit=20.0), structure('two masses', 0.1, misfit=7.5)
    left_out = [LeftOut('trip', 0.1, 1.0), LeftOut('another', 0.1, 1.0)]
    *_, kept = verdict_of(result(left_out, first, other))
    assert kept.endswith('no other structure explains unseen trips clearly better.')
    *_, chosen = verdict_of(result(left_out, first, other, structure='two masses'))
    assert chosen.startswith('Structure: two masses (RMSE 0.10 K') and 'by 12.5 in the log-likelihood' in chosen


@pytest.mark.parametrize('coverage, electrical, unknown, advice', [
    (WHOLE, MEASURED, (), []),
    (WHOLE, UNMEASURED, (), ['Voltage and current of the battery']),
    (changed(heated_trips=0), MEASURED, (), ['3 more drives with the battery heater on']),
    (changed(heated_trips=2), MEASURED, (), ['1 more drive with the battery heater on']),
    (changed(heated_trips=3), MEASURED, (), []),
    (changed(unheated_drives=0), MEASURED, (), ['Two drives without battery heating']),
    (changed(telling_nights=0), MEASURED, (), []),
    (changed(telling_nights=0), MEASURED, ('leakage',), ['A night at stand']),
    (changed(battery_c=(-3.0, 30.0)), MEASURED, (), ['A drive with a battery below -10 degC']),
    (changed(battery_c=(-8.0, 30.0)), MEASURED, (), ['A drive with a battery below -13 degC']),
    (changed(coldest_c=-13.5), MEASURED, (), ['A second drive below -12 degC']),
    (changed(drives=2), MEASURED, (), ['4 more drives of at least 20 min']),
    (WHOLE, MEASURED, ('drivetrain_heat',), ['A drive on a motorway and one in a town'])])
def test_each_recording_is_advised_that_is_lacking_and_no_other(coverage, electrical, unknown, advice):
    found = list(missing_recordings(result(
        (), estimates=estimates(*unknown), coverage=coverage, electrical=electrical)))
    assert len(found) == len(advice)
    assert all(sentence.startswith(beginning) for sentence, beginning in zip(found, advice))
