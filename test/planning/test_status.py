# SPDX-License-Identifier: Apache-2.0
"""The table of statuses: complete, and without contradictions."""

from pathlib import Path
import re

import pytest

from bev_preheat.planning.status import Level, Status

MESSAGES = Path(__file__).parents[2] / 'msg_defs' / 'msg'


@pytest.mark.parametrize('message', ['HvchCommand', 'PreheatPlan'])
def test_statuses_are_those_of_the_messages(message):
    text = (MESSAGES / f'{message}.msg').read_text()
    told = {name: int(number) for name, number in re.findall(r'^uint8 (\w+)=(\d+)', text, re.MULTILINE)}
    assert {status.name: int(status) for status in Status if status.name in told}.items() <= told.items()
    assert {status.name for status in Status} <= set(told)


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
