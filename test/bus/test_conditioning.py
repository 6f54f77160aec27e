# SPDX-License-Identifier: Apache-2.0
"""Requests of BatteryConditioning of VSS: goals, refusals and the values reported back."""

from datetime import datetime, UTC

import pytest
from refusals import problems_of

from bev_preheat.bus.conditioning import (
    ConditioningGoal,
    ConditioningRequest,
    DRIVING,
    FAST_CHARGING,
    INACTIVE,
    instant_of_iso,
    MODE,
    TEMPERATURE,
    TIME,
)
from bev_preheat.errors import InvalidInput

READY_AT_S = datetime(2026, 1, 31, 6, 30, tzinfo=UTC).timestamp()


def test_values_that_come_one_by_one_make_one_goal():
    request = ConditioningRequest().after({TEMPERATURE: 25.0}).after({TIME: '2026-01-31T06:30:00Z'})
    assert request.goal() is None
    request = request.after({MODE: DRIVING})
    assert request.goal() == ConditioningGoal(25.0, READY_AT_S)
    assert request.values() == {MODE: DRIVING, TEMPERATURE: 25.0, TIME: '2026-01-31T06:30:00.000Z'}
    assert request.after({MODE: INACTIVE}).goal() is None


def test_only_fast_charging_has_a_target_by_default():
    assert ConditioningRequest().after({MODE: FAST_CHARGING}).goal() == ConditioningGoal(None, 0.0)
    with pytest.raises(InvalidInput, match=f'^{TEMPERATURE}: is not set; {DRIVING} needs it'):
        ConditioningRequest().after({MODE: DRIVING})


@pytest.mark.parametrize('text, expected_s', [
    ('', 0.0), ('  ', 0.0), ('1970-01-01T00:00:00Z', 0.0), (' 2026-01-31T06:30:00 ', READY_AT_S),
    ('2026-01-31T07:30:00+01:00', READY_AT_S)])
def test_an_instant_without_an_offset_is_utc_and_none_is_0(text, expected_s):
    assert instant_of_iso(text) == expected_s


@pytest.mark.parametrize('text', ['tomorrow', '2026-13-01', '1969-12-31T23:59:59Z', '2039-01-01'])
def test_an_instant_that_is_none_is_named(text):
    with pytest.raises(InvalidInput, match=text):
        instant_of_iso(text)


@pytest.mark.parametrize('values, problems', [
    ({MODE: 'WARM'}, [f"{MODE}: 'WARM' is not one of INACTIVE, FAST_CHARGING_PREPARATION, DRIVING_PREPARATION"]),
    ({TEMPERATURE: 80.1}, [f'{TEMPERATURE}: 80.1 is not allowed; it must be -40 ... 80 degC']),
    ({TEMPERATURE: -40.1}, [f'{TEMPERATURE}: -40.1 is not allowed; it must be -40 ... 80 degC']),
    ({TEMPERATURE: float('nan'), TIME: 'soon'}, [
        f'{TEMPERATURE}: nan is not allowed; it must be -40 ... 80 degC',
        f"{TIME}: 'soon' is no instant in ISO 8601, such as 2026-01-31T06:30:00Z"])])
def test_each_value_that_is_not_allowed_is_named(values, problems):
    assert problems_of(ConditioningRequest().after, values) == problems
