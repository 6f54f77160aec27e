# SPDX-License-Identifier: Apache-2.0
"""Sentences on unusual inputs, from messages and instants that are made here."""

from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.estimation.signal_checks import SignalVerdict
from bev_preheat.messages.fields import time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.flight import Given, InputRemarks
from bev_preheat.recording.records import RecordedStep

START_NS = 1_768_197_600 * NS_PER_S


def sentences(steps, delay_s, offset_k, verdicts=()):
    """Return what is said on steps (instant, stamp of a battery state or None) [s]."""
    remarks = InputRemarks()
    state = SimpleNamespace(active_mission=SimpleNamespace(delay_ns=round(delay_s * NS_PER_S)),
                            estimate=SimpleNamespace(sensor_offset_k=offset_k), signal_verdicts=verdicts)
    for now_s, stamp_s in steps:
        message, events = None, ()
        if stamp_s is not None:
            state_message = BatteryState()
            state_message.header.stamp = time_message(START_NS + round(stamp_s * NS_PER_S))
            message, events = ('sensor_msgs/msg/BatteryState', serialize_message(state_message)), (
                {'kind': 'battery_state'},)
        remarks.add(Given(RecordedStep(START_NS + round(now_s * NS_PER_S), events=events), message),
                    SimpleNamespace(state=state))
    return remarks.sentences


@pytest.mark.parametrize('steps, delay_s, offset_k, words', [
    ([(0, None), (1, None), (-19, None)], 0.0, 0.0, 'went back by 20.0 s at 2026-01-12 06:00:01 UTC'),
    ([(0, None), (21, None)], 0.0, 0.0, '0:21 min from 2026-01-12 06:00:00 UTC on'),
    ([(second, second - 2.0) for second in range(100)], 0.0, 0.0, 'arrives 2.0 s old'),
    ([(second, second) for second in range(100) if second % 5], 0.0, 0.0,
     'every 1 s, and is missing 19 times; the longest interval is 2.0 s'),
    ([(0, 0), (0.1, 0.1), (0.3, 0.3), (0.31, 0.2), (0.4, 0.4)], 0.0, 0.0, '1 battery states were overtaken'),
    ([(0, 0)], 240.0, 0.0, '4:00 min behind'), ([(0, 0)], -90.0, 0.0, '1:30 min ahead of'),
    ([(0, 0)], 0.0, 1.2, '1.2 K too warm'), ([(0, 0)], 0.0, -0.8, '0.8 K too cold')])
def test_unusual_inputs_are_named(steps, delay_s, offset_k, words):
    [sentence] = sentences(steps, delay_s, offset_k)
    assert words in sentence


def test_a_signal_in_doubt_is_named_once_with_its_reason():
    verdicts = SignalVerdict('feed', 'it is slow', START_NS), SignalVerdict('voltage', 'it is high', START_NS)
    assert sentences([(0, None), (1, None)], 0.0, 0.0, verdicts) == [
        f'signal in doubt from 2026-01-12 06:00:00 UTC on: {reason}' for reason in ('it is slow', 'it is high')]
