# SPDX-License-Identifier: Apache-2.0
"""Publish the messages of the tutorial by_hand.md: `python3 by_hand.py WORD` with drive, cancel, off or on."""

from argparse import ArgumentParser
import signal
import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat_msgs.msg import RoutePlan

parser = ArgumentParser(description=__doc__)
parser.add_argument('word', choices=['drive', 'cancel', 'off', 'on'])
wanted = parser.parse_args().word
rclpy.init()
# Ctrl-C ends it without a traceback.
signal.signal(signal.SIGINT, signal.SIG_DFL)
node = Node('by_hand')


def send(publisher, message):
    """Publish a message, with the time as its stamp, once somebody listens."""
    message.header.stamp = node.get_clock().now().to_msg()
    while publisher.get_subscription_count() == 0:
        time.sleep(0.1)
    publisher.publish(message)


if wanted in ('off', 'on'):
    client = node.create_client(SetBool, 'planner/enable')
    client.wait_for_service()
    answer = client.call_async(SetBool.Request(data=wanted == 'on'))
    rclpy.spin_until_future_complete(node, answer)
    print(answer.result().message)
else:
    route = RoutePlan(charging_planned=False) if wanted == 'cancel' else RoutePlan(
        segment_duration=[1800.0], speed=[20.0], propulsion_power=[15000.0], ambient_temperature=[-7.0],
        charging_planned=True)
    send(node.create_publisher(RoutePlan, 'route_plan', 1), route)
    states = node.create_publisher(BatteryState, 'battery_state', 1)
    while wanted == 'drive':
        # float, because rclpy takes no integer for a field of type float.
        send(states, BatteryState(temperature=float(1), percentage=0.8))
        time.sleep(1.0)
    # A message may still be under way.
    time.sleep(1.0)
