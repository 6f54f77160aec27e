# SPDX-License-Identifier: Apache-2.0
"""A follower receives in its own thread, so that its data do not change while it draws."""

import threading
import time

import pytest
import rclpy
from rclpy.context import Context
from sensor_msgs.msg import BatteryState
from waiting import poll_until, TIME_LIMIT_S

from bev_preheat.messages.fields import time_message
from bev_preheat.nodes.listening import listening

FIRST_NS = 1_700_000_000_000_000_000
STEP_NS = 1_000_000_000


@pytest.fixture
def flood(domain_id):
    """Let another participant publish battery states as fast as it can."""
    context, enough = Context(), threading.Event()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node('flood', context=context)
    publisher = node.create_publisher(BatteryState, 'battery_state', 1)

    def publish():
        state, stamp_ns = BatteryState(temperature=-7.0, percentage=0.8), FIRST_NS
        while not enough.is_set():
            state.header.stamp = time_message(stamp_ns := stamp_ns + STEP_NS)
            publisher.publish(state)

    thread = threading.Thread(target=publish)
    thread.start()
    yield publisher
    enough.set()
    thread.join()
    node.destroy_node()
    context.try_shutdown()


def test_callbacks_run_in_the_thread_that_listens_and_only_then(flood, domain_id):
    heard_in = []
    with listening('follower', domain_id) as follower:
        follower.node.create_subscription(
            BatteryState, 'battery_state',
            lambda message: heard_in.append(threading.get_ident()), 10)
        poll_until(lambda: follower.listen(0.01) or heard_in, 'a battery state')
        count = len(heard_in)
        # Enough is published meanwhile for another thread to have run the callback.
        flood.wait_for_all_acked(rclpy.duration.Duration(seconds=0.2))
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
