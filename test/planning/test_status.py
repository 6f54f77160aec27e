# SPDX-License-Identifier: Apache-2.0
"""The table of statuses: complete, and without contradictions."""


import pytest

from bev_preheat.planning.status import Level, Status


@pytest.mark.parametrize('status', Status, ids=lambda status: status.name)
def test_a_meaning_is_whole_and_contradicts_nothing(status):
    meaning = status.meaning
    assert meaning.word and meaning.look in ('off', 'wait', 'heat', 'good', 'warn')
    # What needs a look is shown as such, and says what would help and what was missing.
    assert (meaning.look == 'warn') >= (meaning.level is Level.ERROR or meaning.is_alarm or meaning.is_doubt)
    assert bool(meaning.otherwise and meaning.obstacle) >= (meaning.is_alarm or meaning.is_doubt)
    # A doubt interrupts any plan; after the end of a trip there is none.
    assert meaning.is_doubt + meaning.is_of_plan + meaning.is_over <= 1
    assert bool(meaning.cause) <= meaning.is_doubt
    assert not (meaning.is_doubt and meaning.ends_by_plan)
    assert not meaning.otherwise or meaning.otherwise.endswith('.')
    assert not meaning.obstacle.endswith('.') and not meaning.cause.endswith('.')
