# SPDX-License-Identifier: Apache-2.0
"""Whether the battery's power answers the heater, in drawn traffic."""

from statistics import mean

import numpy as np
import pytest

from bev_preheat.estimation.power_response import APART_S, PowerResponse, RAMP_S, WINDOW_S

HEATER_W = 5300.0
SWITCHED_AT_S = 300


def answers(seed, share, spread_w=800.0, lag_s=0.0, switched_w=HEATER_W, until_s=600,
            step_s=1, odd_step_w=0.0):
    """Answers to one switching, of a heater that gives `share` of its command after `lag_s`."""
    drawn = np.random.default_rng(seed)
    response, found, traffic_w = PowerResponse(), [], 0.0
    for second in range(0, until_s, step_s):
        traffic_w += step_s / 30.0 * (-traffic_w) + spread_w * np.sqrt(
            2 * step_s / 30.0) * drawn.standard_normal()
        command_w = switched_w if second >= SWITCHED_AT_S else 0.0
        ramp = min(1.0, max(0.0, (second - SWITCHED_AT_S) / lag_s)) if lag_s else 1.0
        power_w = 18e3 + traffic_w + share * command_w * ramp
        if second >= SWITCHED_AT_S:
            power_w += odd_step_w
        answer = response.see(float(second), power_w, command_w)
        if answer is not None:
            found.append((second, answer))
    return found


@pytest.mark.parametrize('share', [0.0, 0.4, 1.0])
def test_the_share_is_seen_within_what_it_is_said_to_be_sure(share):
    errors = []
    for seed in range(60):
        (_, answer), = answers(seed, share)
        errors.append((answer.share - share) / answer.deviation)
    # Mean 0, spread 1, within what 60 draws scatter.
    assert abs(mean(errors)) < 0.5
    assert 0.6 < np.std(errors) < 1.5


def test_one_switching_is_answered_once():
    for seed in range(20):
        assert len(answers(seed, 1.0)) == 1


def test_the_answer_comes_within_a_minute():
    (second, _), = answers(1, 1.0)
    assert second - SWITCHED_AT_S <= APART_S + WINDOW_S + 1


def test_a_heater_may_take_its_time():
    (_, answer), = answers(3, 1.0, spread_w=200.0, lag_s=RAMP_S)
    (_, at_once), = answers(3, 1.0, spread_w=200.0)
    assert answer.share == pytest.approx(at_once.share, abs=1e-9)


def test_traffic_makes_it_less_sure():
    (_, calm), = answers(5, 1.0, spread_w=100.0)
    (_, rough), = answers(5, 1.0, spread_w=4000.0)
    assert rough.deviation > 5.0 * calm.deviation
    # 4 kW up and down for each half-minute: one switching of 5.3 kW says next to nothing.
    assert rough.deviation > 0.5


def test_samples_every_ten_seconds_do_not_do():
    # A window of ten seconds must have two.
    assert answers(7, 1.0, step_s=10) == []


@pytest.mark.parametrize('step_s', [2, 5])
def test_samples_every_few_seconds_do(step_s):
    assert len(answers(7, 1.0, step_s=step_s)) == 1


def test_small_switchings_are_none():
    assert answers(9, 1.0, switched_w=600.0) == []


def test_a_gap_begins_the_windows_anew():
    response = PowerResponse()
    seconds = [*range(0, 300), *range(315, 340)]
    command_w = [0.0 if second < 310 else HEATER_W for second in seconds]
    assert [answer for second, power_w in zip(seconds, command_w)
            if (answer := response.see(float(second), 18e3 + power_w, power_w))] == []


def test_nothing_is_answered_before_the_traffic_is_known():
    response = PowerResponse()
    found = [response.see(float(second), 18e3 + HEATER_W * (second >= 60),
                          HEATER_W * (second >= 60)) for second in range(200)]
    assert found[:110] == [None] * 110
