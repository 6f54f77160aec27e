# SPDX-License-Identifier: Apache-2.0
"""What a drive is held against, on records written by hand."""

from math import nan

import pytest

from bev_preheat.simulation.evaluation import DriveRecord, evaluate
from bev_preheat.simulation.scenario import Expectations

COMMANDS = [(0.0, 0.0, 'WAITING'), (10.0, 5000.0, 'HEATING'), (20.0, 5000.0, 'HEATING'),
            (30.0, 0.0, 'STALE_INPUT'), (40.0, 3000.0, 'HEATING'), (50.0, 0.0, 'ARRIVED')]


def found(arrival_c=25.3, seen_heater='answers', **expected):
    record = DriveRecord(25.0, list(COMMANDS), {'WAITING', 'HEATING', 'STALE_INPUT', 'ARRIVED'},
                         seen_heater, arrival_c)
    finding, = evaluate(Expectations(**expected), record)
    return finding


@pytest.mark.parametrize('expected, good', [
    ({'arrival_error_k': (-0.5, 1.0)}, True), ({'arrival_error_k': (-0.5, 0.2)}, False),
    ({'arrival_error_k': (0.4, 1.0)}, False),
    ({'most_switch_ons': 2}, True), ({'most_switch_ons': 1}, False),
    ({'statuses': ('WAITING', 'ARRIVED')}, True), ({'statuses': ('WAITING', 'CHARGING')}, False),
    ({'never': ('INTERNAL_ERROR',)}, True), ({'never': ('STALE_INPUT',)}, False),
    ({'off_during': ((30.0, 40.0),)}, True), ({'off_during': ((30.0, 40.1),)}, False),
    ({'heats_during': ((0.0, 11.0),)}, True), ({'heats_during': ((0.0, 10.0),)}, False),
    ({'heater': 'answers'}, True), ({'heater': 'dead'}, False)])
def test_each_expectation_is_held_against_the_drive(expected, good):
    assert found(**expected).good is good


@pytest.mark.parametrize('expected', [{'off_during': ((60.0, 70.0),)},
                                      {'heats_during': ((60.0, 70.0),)}])
def test_where_nothing_was_commanded_nothing_is_good(expected):
    assert not found(**expected).good


def test_a_car_that_never_arrived_missed_its_target():
    assert not found(nan, arrival_error_k=(-100.0, 100.0)).good


def test_what_is_seen_is_said():
    finding = found(arrival_error_k=(-0.5, 0.2))
    assert (finding.expected, finding.seen) == ('-0.5 ... +0.2', '+0.30')
    assert found(statuses=('CHARGING', 'WAITING')).seen == 'all but CHARGING'
    assert found(never=('STALE_INPUT', 'CHARGING')).seen == 'STALE_INPUT'


def test_nothing_expected_nothing_found():
    assert evaluate(Expectations(), DriveRecord(25.0)) == []


def test_switch_ons_count_the_first():
    assert DriveRecord(25.0, [(0.0, 100.0, 'HEATING')]).switch_ons == 1
    assert DriveRecord(25.0).switch_ons == 0
