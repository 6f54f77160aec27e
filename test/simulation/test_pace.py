# SPDX-License-Identifier: Apache-2.0
"""Simulated time over real time."""

import pytest

from bev_preheat.simulation.pace import CLOCK_LAG_S, LONGEST_LOOK_S, MOST_AHEAD_S, Pace, Patience, SILENT_PLANNER_S


def test_time_starts_with_the_first_call():
    assert Pace(40.0).follow(1234.5) == 0.0


def test_time_follows_at_the_speed_asked_for():
    pace = Pace(40.0)
    for tick in range(101):
        elapsed_s = pace.follow(700.0 + 0.01 * tick)
    assert elapsed_s == pytest.approx(40.0)
    assert pace.lost_s == 0.0


def test_speed_may_change_on_the_way():
    pace = Pace(40.0)
    pace.follow(700.0)
    pace.follow(700.02)
    pace.speed_up = 10.0
    assert pace.follow(700.07) == pytest.approx(0.8 + 0.5)


def test_late_call_slows_time_down_and_is_counted():
    pace = Pace(40.0)
    pace.follow(700.0)
    assert pace.follow(703.0) == pytest.approx(1.0)
    assert pace.lost_s == pytest.approx(119.0)
    assert pace.follow(703.01) == pytest.approx(1.4)


@pytest.mark.parametrize('speed_up, tick_s', [(1.0, 0.01), (60.0, 0.5 / 60.0), (1000.0, 0.0005)])
def test_ticks_resolve_half_a_simulated_second(speed_up, tick_s):
    assert Pace(speed_up).real_tick_s == pytest.approx(tick_s)


def test_time_that_stands_is_counted_and_not_made_up_for():
    pace = Pace(40.0)
    pace.follow(700.0)
    pace.stand(700.5)
    assert pace.lost_s == pytest.approx(20.0)
    assert pace.follow(700.51) == pytest.approx(0.4)


def test_where_nothing_was_told_nobody_is_waited_for():
    assert Patience().lets_go_on(500.0, 7.0)


def test_a_planner_that_does_not_answer_is_waited_for():
    patience = Patience()
    patience.tell(20.0)
    assert patience.lets_go_on(20.0 + MOST_AHEAD_S, 7.0)
    # The next state does not answer the first one.
    patience.tell(21.0)
    assert not patience.lets_go_on(20.1 + MOST_AHEAD_S, 7.0)
    # A command for an instant long past is no answer; one from a clock that lags slightly is.
    patience.hear(20.0 - 2.0 * CLOCK_LAG_S)
    assert not patience.lets_go_on(20.1 + MOST_AHEAD_S, 7.01)
    patience.hear(20.0 - 0.5 * CLOCK_LAG_S)
    assert patience.lets_go_on(20.1 + MOST_AHEAD_S, 7.02)


def test_an_answered_planner_is_not_waited_for_however_rare_the_states_are():
    patience = Patience()
    patience.tell(20.0)
    patience.hear(20.0)
    assert patience.lets_go_on(80.0, 7.0)


def test_a_planner_that_is_silent_is_waited_for_no_more_until_it_commands_again():
    patience = Patience()
    patience.tell(20.0)
    looks_s = [7.0 + 0.01 * look for look in range(301)]
    answers = [patience.lets_go_on(30.0 + look_s, look_s) for look_s in looks_s]
    assert looks_s[answers.index(True)] == pytest.approx(7.0 + SILENT_PLANNER_S, abs=0.011)
    assert all(answers[answers.index(True):])
    patience.hear(31.0)
    patience.tell(34.0)
    assert not patience.lets_go_on(36.0, 13.0)


def test_a_busy_computer_delays_looks_and_planner_alike():
    patience = Patience()
    patience.tell(20.0)
    # Three seconds pass between two looks.
    answers = [patience.lets_go_on(30.0, 7.0 + 3.0 * look) for look in range(100)]
    assert answers.index(True) == pytest.approx(SILENT_PLANNER_S / LONGEST_LOOK_S, abs=1)


def test_a_clock_that_jumps_forward_waits_for_an_answer():
    patience = Patience()
    patience.tell(20.0)
    assert not patience.lets_go_on(3620.0, 7.0)
    patience.hear(3620.0)
    assert patience.lets_go_on(3620.5, 7.1)


def test_a_clock_that_was_set_back_is_followed():
    patience = Patience()
    patience.tell(3620.0)
    patience.tell(20.0)
    assert not patience.lets_go_on(20.1 + MOST_AHEAD_S, 7.0)
    patience.hear(20.0)
    assert patience.lets_go_on(20.1 + MOST_AHEAD_S, 7.1)
