# SPDX-License-Identifier: Apache-2.0
"""The deadline and the liveliness of `hvch_command`, for a heater's controller that asks for them."""

import os
import signal

import pytest
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSProfile

from bev_preheat_msgs.msg import HvchCommand

LEASE_S = 1.5


class Controller:
    """A heater's controller: its commands, and the DDS events on them."""

    def __init__(self, node, deadline_s, liveliness):
        """Subscribe with a deadline and a liveliness lease of `deadline_s` [s]."""
        self.commands, self.alive, self.missed, self.misfits = [], [], [], []
        within = Duration(seconds=deadline_s)
        node.create_subscription(
            HvchCommand, 'hvch_command', self.commands.append,
            QoSProfile(depth=1, deadline=within, liveliness=liveliness,
                       liveliness_lease_duration=within),
            event_callbacks=SubscriptionEventCallbacks(
                deadline=self.missed.append, incompatible_qos=self.misfits.append,
                liveliness=lambda event: self.alive.append(event.alive_count)))


@pytest.mark.parametrize('liveliness', [
    pytest.param(LivelinessPolicy.AUTOMATIC, marks=pytest.mark.deep), LivelinessPolicy.MANUAL_BY_TOPIC])
def test_a_planner_that_hangs_misses_its_deadline_and_is_not_alive(bench, liveliness):
    controller = Controller(bench.node, LEASE_S, liveliness)
    planner = bench.start('planner', '-p', f'command_lease:={LEASE_S}', '-p', 'command_period:=0.3')
    bench.wait_until(lambda: len(controller.commands) >= 3 and controller.alive, 'commands')
    assert controller.alive[-1] == 1
    os.kill(planner.process_id, signal.SIGSTOP)
    try:
        controller.missed.clear()
        bench.wait_until(lambda: controller.missed, 'a missed deadline')
        bench.wait_until(lambda: controller.alive[-1] == 0, 'the loss of liveliness')
        controller.commands.clear()
    finally:
        os.kill(planner.process_id, signal.SIGCONT)
    bench.wait_until(lambda: controller.commands and controller.alive[-1] == 1, 'its return')


def test_who_asks_for_more_than_the_lease_is_told(bench):
    controller = Controller(bench.node, 0.5 * LEASE_S, LivelinessPolicy.AUTOMATIC)
    bench.start('planner', '-p', f'command_lease:={LEASE_S}')
    bench.wait_until(lambda: controller.misfits, 'the news that the quality of service does not fit')
    assert not controller.commands
