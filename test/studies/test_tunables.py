# SPDX-License-Identifier: Apache-2.0
"""The study of the step's numbers: it moves each wherever it is used, and back, and writes what that moved."""

import pytest

from bev_preheat import tunables as table
from bev_preheat.control import forecast_plan
from bev_preheat_studies import tunables as study


def named(name):
    return next(each for each in study.tunables() if each.name == name)


@pytest.mark.parametrize('value, factor, moved', [
    (10.0, 0.7, 7.0), (10, 1.3, 13), (1, 0.7, 0), (1, 1.3, 2), (2, 1.3, 3)])
def test_whole_numbers_stay_whole_and_move_by_one_at_least(value, factor, moved):
    result = study.Tunable('NAME', value, '1', '').times(factor)
    assert result == pytest.approx(moved) and type(result) is type(value)


def test_a_number_is_set_wherever_it_is_imported():
    tunable = named('MOST_REVEALED_K')
    try:
        study.set_everywhere(tunable, 99.0)
        assert table.MOST_REVEALED_K == forecast_plan.MOST_REVEALED_K == 99.0
    finally:
        study.set_everywhere(tunable, tunable.value)
    assert table.MOST_REVEALED_K == forecast_plan.MOST_REVEALED_K == tunable.value


def test_effects_are_written_behind_their_rows_and_taken_away():
    text = 'A_K = 1.0   # K | first\n\nB = 2  # n  | second | 0.300 K\nC = 3  # n | third | 1.000 K\n'
    effects = (study.Effect(0, 'A_K', 1.0, 'first', worst_k=0.25), study.Effect(1, 'B', 2, 'second'),
               study.Effect(2, 'C', 3, 'third', switch_ons=1))
    assert study.with_effects(text, effects) == (
        'A_K = 1.0   # K | first | 0.250 K\n\nB = 2  # n  | second\nC = 3  # n | third | 0.000 K\n')


@pytest.mark.costly
def test_a_number_that_matters_moves_something_and_one_that_does_not_moves_nothing():
    """The usual lag of the heat moves the estimate; no goal is set on the drive."""
    drives = study.Drives(1, 1, 10.0, True)
    found = [named('NOMINAL_HEAT_LAG_S'), named('FURTHEST_GOAL_S')]
    effects = [study.effect_of(drives, drives.figures(), found, number) for number in range(2)]
    assert not effects[0].is_nothing and effects[0].worst_k > 0.0
    assert effects[1].is_nothing
