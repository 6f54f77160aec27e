# SPDX-License-Identifier: Apache-2.0
"""Calls that the core declines are counted by function and reason; answers are not."""

from types import SimpleNamespace

import drawn_situations
import pytest

from bev_preheat.native.library import core, DECLINES, Declines
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip


def named(name):
    return SimpleNamespace(__name__=name)


def test_they_are_told_by_function_and_reason():
    declines = Declines()
    assert declines.in_words() == '0'
    for name, status in (('bev_run', -4), ('bev_run', 1), ('bev_plan_paper', -5), ('bev_plan_paper', -5),
                         ('bev_plan_by_values', 2), ('bev_follow', 0)):
        assert declines.note(status, named(name), ()) == status
    assert declines.in_words() == '3: 2 x bev_plan_paper (search not settled), 1 x bev_run (no finite number)'


@pytest.mark.skipif(core() is None, reason='bev_preheat_core is not built')
def test_a_plan_over_limits_is_the_core_s():
    drawn = draw_limit_trip(drawn_situations.car('reference'), 11, 2)
    for method in METHODS:
        before = DECLINES.counts.total()
        plan_preheating(drawn.vehicle, drawn.route, drawn.state, drawn.goal, method)
        assert DECLINES.counts.total() == before
