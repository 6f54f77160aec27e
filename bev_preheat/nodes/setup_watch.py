# SPDX-License-Identifier: Apache-2.0
"""Finds wrong setups around a node: parameters, clock, other nodes that cannot exchange messages with it."""

from __future__ import annotations

from difflib import get_close_matches
from functools import partial
import sys
from typing import TYPE_CHECKING

from rclpy.qos import qos_check_compatible, QoSCompatibility

from bev_preheat.messages.diagnostics import judged
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.nodes.parameters import given_parameters, USE_SIM_TIME
from bev_preheat.numerics import NS_PER_DAY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticStatus
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from bev_preheat.nodes.node import ProgramNode

# rmw's name for an endpoint whose node it has not discovered.
NAMELESS = '_NODE_NAME_UNKNOWN_'
# Prefix of the hash of a message definition (REP 2016).
HASH = 'RIHS01_'
# In real time: while simulated time stands, so do the node's own timers.
SETUP_PERIOD_S = 0.5
# Parameters of ROS itself, and of other nodes in a shared parameter file.
NOT_OURS = (USE_SIM_TIME, 'start_type_description_service', 'qos_overrides./parameter_events',
            'qos_overrides./rosout', 'qos_overrides./clock')
CLOCK_STANDS = 'use_sim_time is set and no /clock has arrived: time stands at 0'
CLOCK_PATIENCE_LOOKS = 4
# Every node reports its diagnostics so often [s].
DIAGNOSTICS_PERIOD_S = 1.0
# A clock that falls back by more has been restarted [s].
RESTART_S = 1.0
LOG_PERIOD_S = 10.0
# Beyond any delay or drift: the two computers run on different clocks.
FAR_NS = NS_PER_DAY


def endpoint_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of the node that a TopicEndpointInfo belongs to."""
    if endpoint.node_name == NAMELESS:
        return 'a node whose name is unknown'
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


class SetupWatch:
    """
    Checks the setup every SETUP_PERIOD_S; logs each problem once and stores them for the diagnostics.

    `problems` are the current sentences, `error` is one that makes the diagnostics ERROR.
    """

    def __init__(self, node: ProgramNode, subscribes: Iterable[str], publishes: Iterable[str],
                 single: Iterable[str] = ()) -> None:
        """
        Begin to check; call it when all parameters are declared.

        `subscribes` and `publishes` are the topics that the node shares with others. Each topic in `single` must
        have one publisher.
        """
        self._node, self.error = node, ''
        self._single = frozenset(map(node.resolve_topic_name, single))
        self._subscribes = list(map(node.resolve_topic_name, subscribes))
        self._publishes = list(map(node.resolve_topic_name, publishes))
        self._unknown = unknown_parameters(node)
        self._logged: set[str] = set()
        self._found: list[str] = []
        self._looks_at_zero = 0
        self._note(self._unknown)
        node.look_regularly(SETUP_PERIOD_S, 'looking around', self._look)

    def _look(self) -> None:
        found, before = self._incompatible(), self._found
        self._found = found
        # A single finding may be half discovered, or about to be fixed.
        problems = [*self._unknown, *(problem for problem in found if problem in before)]
        if self._clock_stands():
            problems.append(CLOCK_STANDS)
        self._note(problems)

    def _incompatible(self) -> list[str]:
        """Return a sentence for each incompatible endpoint."""
        node, problems = self._node, []
        for topic in sorted(self._single):
            publishers = node.get_publishers_info_by_topic(topic)
            if len(publishers) > 1:
                names = ', '.join(sorted(map(endpoint_name, publishers)))
                problems.append(f'{topic} has {len(publishers)} publishers, {names}; it must have one')
        for topic in self._subscribes:
            own = self._own(node.get_subscriptions_info_by_topic(topic))
            for other in node.get_publishers_info_by_topic(topic):
                problems.append(_problem(
                    other, f'publishes {topic}', own, partial(
                        qos_check_compatible, other.qos_profile)))
        for topic in self._publishes:
            own = self._own(node.get_publishers_info_by_topic(topic))
            for other in node.get_subscriptions_info_by_topic(topic):
                problems.append(_problem(
                    other, f'subscribes to {topic}', own, partial(
                        qos_check_compatible, subscription_qos=other.qos_profile)))
        return [problem for problem in problems if problem]

    def _own(self, endpoints: Iterable[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
        own_name = self._node.get_fully_qualified_name()
        return [endpoint for endpoint in endpoints if endpoint_name(endpoint) == own_name]

    def _clock_stands(self) -> bool:
        stands = (self._node.get_parameter(USE_SIM_TIME).value
                  and self._node.get_clock().now().nanoseconds == 0)
        self._looks_at_zero = self._looks_at_zero + 1 if stands else 0
        # Discovering its publishers takes a moment.
        return self._looks_at_zero >= CLOCK_PATIENCE_LOOKS

    def _note(self, problems: Sequence[str]) -> None:
        self.problems = problems
        for problem in problems:
            if problem is CLOCK_STANDS:
                self._node.get_logger().warning(problem, throttle_duration_sec=LOG_PERIOD_S)
            elif problem not in self._logged:
                self._logged.add(problem)
                self._node.get_logger().warning(problem)

    @property
    def clock_stands(self) -> bool:
        """Whether simulated time is set and has not begun."""
        return CLOCK_STANDS in self.problems

    def entry(self) -> DiagnosticStatus:
        """Return the entry `setup` of the diagnostics."""
        return judged('setup', [self.error], self.problems, 'parameters, clock and topics fit')

    def clock_hint(self, stamp: Time, now_ns: int) -> str:
        """Return which clock is likely wrong if a message's stamp is far from an instant [ns]; otherwise ''."""
        stamp_ns = nanoseconds(stamp)
        if not now_ns or not stamp_ns or abs(stamp_ns - now_ns) < FAR_NS:
            return ''
        apart_days = (stamp_ns - now_ns) / NS_PER_DAY
        where = f'{abs(apart_days):.0f} days {"after" if apart_days > 0.0 else "before"}'
        if self._node.get_parameter(USE_SIM_TIME).value:
            return (f"the stamp lies {where} this node's time, which is /clock (use_sim_time is set): "
                    'set use_sim_time:=true at the sender too, or use_sim_time:=false here')
        return (f"the stamp lies {where} this node's time, which is the system's: if the sender is "
                'simulated or replayed, set use_sim_time:=true here; if not, one of the two clocks is '
                'not set')


def _problem(other: TopicEndpointInfo, what: str, own: Sequence[TopicEndpointInfo],
             check: Callable[[QoSProfile], tuple[QoSCompatibility, str]]) -> str:
    """Return a sentence on an endpoint that fits none of the node's own; '' if it fits."""
    if not own:
        return ''
    expected, version = own[0].topic_type, str(own[0].topic_type_hash)
    sentence = f'{endpoint_name(other)} {what}'
    if other.topic_type != expected:
        return f'{sentence} as {other.topic_type}; the type must be {expected}'
    other_version = str(other.topic_type_hash)
    # Not every middleware reports it.
    if version != other_version and version.startswith(HASH) and other_version.startswith(HASH):
        return (f'{sentence} as another version of {expected}; build both nodes from the same '
                'message definitions')
    reasons: set[str] = set()
    for endpoint in own:
        compatibility, reason = check(endpoint.qos_profile)
        if compatibility != QoSCompatibility.ERROR:
            return ''
        reasons.update(part.strip().removeprefix('ERROR: ').lower()
                       for part in reason.split(';') if part.strip())
    return f'{sentence} with an incompatible quality of service: {", ".join(sorted(reasons))}'


def unknown_parameters(node: Node) -> list[str]:
    """Return a sentence for each given parameter that the node does not have."""
    given, known = given_parameters(node), list(node.get_parameters_by_prefix(''))
    sentences = []
    for name in given:
        if node.has_parameter(name) or name.startswith(NOT_OURS):
            continue
        nearest = get_close_matches(name, known, 1)
        sentences.append(f'parameter {name!r} is unknown and ignored' + (
            f'; did you mean {nearest[0]!r}?' if nearest else ''))
    # Of `-p NAME:=VALUE` or `-p NODE:NAME:=VALUE`.
    typed = {word.partition(':=')[0].rpartition(':')[2] for word in sys.argv}
    if '--params-file' in sys.argv and typed.issuperset(given):
        sentences.append(f'the parameter file holds nothing for {node.get_fully_qualified_name()}')
    return sentences
