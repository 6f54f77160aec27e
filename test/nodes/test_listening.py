# SPDX-License-Identifier: Apache-2.0
"""A follower receives in its own thread, so that its data do not change while it draws."""

import threading
import time

from node_bench import repeating
import pytest
from rclpy.duration import Duration
from sensor_msgs.msg import BatteryState
from waiting import poll_until, TIME_LIMIT_S

from bev_preheat.nodes.listening import listening


@pytest.fixture
def flood(node):
    """Let another participant publish battery states as fast as it can."""
    publisher = node.create_publisher(BatteryState, 'battery_state', 1)
    with repeating(lambda: publisher.publish(BatteryState(temperature=-7.0, percentage=0.8)), 0.0):
        yield publisher


def test_callbacks_run_in_the_thread_that_listens_and_only_then(flood, domain_id):
    heard_in = []
    with listening('follower', domain_id) as follower:
        follower.node.create_subscription(
            BatteryState, 'battery_state',
            lambda message: heard_in.append(threading.get_ident()), 10)
        poll_until(lambda: follower.listen(0.01) or heard_in, 'a battery state')
        count = len(heard_in)
        # Enough is published meanwhile for another thread to have run the callback.
        flood.wait_for_all_acked(Duration(seconds=0.2))
        time.sleep(0.1)
        assert len(heard_in) == count
    assert set(heard_in) == {threading.get_ident()}


def test_an_exception_of_a_callback_reaches_who_listens(flood, domain_id):
    def fail(message):
        raise ValueError('this state is not for me')

    with listening('follower', domain_id) as follower:
        follower.node.create_subscription(BatteryState, 'battery_state', fail, 1)
        with pytest.raises(ValueError, match='this state is not for me'):
            follower.listen(TIME_LIMIT_S)
