# SPDX-License-Identifier: Apache-2.0
"""The study of the planner's numbers: it finds them with their reasons, moves each where it is used and back."""

import pytest

from bev_preheat.control import forecast_plan, margins
from bev_preheat_studies import tunables as study


def named(name):
    return next(each for each in study.tunables() if each.name == name)


def test_numbers_come_with_the_comment_above_them():
    found = study.tunables()
    assert len({(each.module, each.name) for each in found}) == len(found) > 200
    waits = next(each for each in found if each.name == 'FIRST_WAIT_S')
    assert (waits.module, waits.value) == ('bev_preheat.control.margins', margins.FIRST_WAIT_S)
    assert len(waits.reason) > 20


@pytest.mark.parametrize('value, factor, moved', [
    (10.0, 0.7, 7.0), (10, 1.3, 13), (1, 0.7, 0), (1, 1.3, 2), (2, 1.3, 3)])
def test_whole_numbers_stay_whole_and_move_by_one_at_least(value, factor, moved):
    result = study.Tunable('module', 'NAME', value, '').times(factor)
    assert result == pytest.approx(moved) and type(result) is type(value)


def test_a_number_is_set_wherever_it_is_imported_and_taken_back():
    tunable = named('MOST_REVEALED_K')
    before = study._set(tunable, 99.0)
    assert margins.MOST_REVEALED_K == forecast_plan.MOST_REVEALED_K == 99.0
    for module, value in before:
        setattr(module, tunable.name, value)
    assert margins.MOST_REVEALED_K == forecast_plan.MOST_REVEALED_K == tunable.value


@pytest.mark.costly
def test_a_number_that_matters_moves_something_and_one_that_does_not_moves_nothing():
    """The accuracy of the route's power moves the estimate; no clock is set back on the drive."""
    drives = study._Drives(1, 1, 10.0, True)
    found = [named('POWER_NOISE'), named('CLOCK_RESTART_S')]
    effects = [study.effect_of(drives, drives.figures(), found, number) for number in range(2)]
    assert not effects[0].is_nothing and effects[0].worst_k > 0.0
    assert effects[1].is_nothing
