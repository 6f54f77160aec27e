# SPDX-License-Identifier: Apache-2.0
"""Finds planners in the ROS graph by the types of their topics, whatever these are called."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from rclpy.node import NodeNameNonExistentError

from bev_preheat.dashboard.health import Surroundings

if TYPE_CHECKING:
    from rclpy.node import Node

PLAN, COMMAND, ROUTE, ANSWER = (
    f'bev_preheat_msgs/msg/{name}' for name in ('PreheatPlan', 'HvchCommand', 'RoutePlan', 'HvchStatus'))
BATTERY = 'sensor_msgs/msg/BatteryState'
CLOCK = '/clock'


class PlannerFound(NamedTuple):
    """A planner by the full name of its node, and the full names of its topics; '' if it has none."""

    name: str
    plan_topic: str
    command_topic: str
    battery_topic: str
    route_topic: str
    answer_topic: str = ''


def find_planners(node: Node, known: dict[str, PlannerFound]) -> dict[str, PlannerFound]:
    """Return the planners that are there, by name; those in `known` are not examined again."""
    found: dict[str, PlannerFound] = {}
    for topic, types in node.get_topic_names_and_types():
        if PLAN not in types:
            continue
        for endpoint in node.get_publishers_info_by_topic(topic):
            if endpoint.topic_type != PLAN or endpoint.node_name.startswith('_'):
                continue
            name = f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
            earlier = known.get(name)
            if earlier is not None and earlier.plan_topic == topic:
                found[name] = earlier
                continue
            planner = _examine(node, name, endpoint.node_name, endpoint.node_namespace, topic)
            if planner is not None:
                found[name] = planner
    return found


def _examine(node: Node, full_name: str, name: str, namespace: str, plan_topic: str) -> PlannerFound | None:
    try:
        out = node.get_publisher_names_and_types_by_node(name, namespace)
        into = node.get_subscriber_names_and_types_by_node(name, namespace)
    except NodeNameNonExistentError:
        # Its endpoints are known before its name.
        return None
    command, battery, route, answer = (
        next((topic for topic, types in topics if kind in types), '')
        for topics, kind in ((out, COMMAND), (into, BATTERY), (into, ROUTE), (into, ANSWER)))
    # Half discovered.
    return PlannerFound(full_name, plan_topic, command, battery, route, answer) if command and battery else None


def surroundings_of(node: Node, planner: str, is_there: bool) -> Surroundings:
    """Return the Surroundings of a planner."""
    followers = {f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
                 for endpoint in node.get_subscriptions_info_by_topic(CLOCK)}
    return Surroundings(is_there, planner in followers, node.count_publishers(CLOCK) > 0)
