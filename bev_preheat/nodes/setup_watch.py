# SPDX-License-Identifier: Apache-2.0
"""Finds wrong setups around a node: parameters, clock, incompatible publishers and subscriptions."""

from __future__ import annotations

from difflib import get_close_matches
import sys
from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType

from bev_preheat.messages.diagnostics import judged
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.nodes.news import logging_errors
from bev_preheat.nodes.parameters import given_parameters
from bev_preheat.nodes.surroundings import Surroundings
from bev_preheat.numerics.factors import NS_PER_DAY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticStatus
    from rclpy.node import Node

# In real time: while simulated time stands, so do the node's own timers.
SETUP_PERIOD_S = 0.5
# Parameters of ROS itself, and of other nodes in a shared parameter file.
NOT_OURS = ('use_sim_time', 'start_type_description_service', 'qos_overrides./parameter_events',
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


class SetupWatch:
    """
    Checks the setup every SETUP_PERIOD_S; logs each problem once and stores them for the diagnostics.

    `problems` are the current sentences.
    """

    def __init__(self, node: Node, subscribes: Iterable[str], publishes: Iterable[str],
                 also: Sequence[Callable[[], object]] = (), single: Iterable[str] = ()) -> None:
        """
        Begin to check; call it when all parameters are declared.

        `subscribes` and `publishes` are the topics that the node shares with others; `also` are
        functions called at each check. Each topic in `single` must have one publisher.
        """
        self._node, self._also = node, also
        self._surroundings = Surroundings(node, subscribes, publishes, single)
        self._unknown = unknown_parameters(node)
        self._logged: set[str] = set()
        self._found: list[str] = []
        self._looks_at_zero = 0
        self._note(self._unknown)
        node.create_timer(SETUP_PERIOD_S, logging_errors(node, 'looking around', self._look),
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        found, before = self._surroundings.problems(), self._found
        self._found = found
        # A single finding may be half discovered, or about to be fixed.
        problems = [*self._unknown, *(problem for problem in found if problem in before)]
        if self._clock_stands():
            problems.append(CLOCK_STANDS)
        self._note(problems)
        for function in self._also:
            function()

    def _clock_stands(self) -> bool:
        stands = (self._node.get_parameter('use_sim_time').value
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

    def entry(self, hardware: str, error: str = '') -> DiagnosticStatus:
        """Return the DiagnosticStatus `NODE: setup`; `error` is a sentence that makes it ERROR."""
        return judged(self._node.get_fully_qualified_name(), 'setup', hardware, [error] if error else [],
                      self.problems, 'parameters, clock and topics fit')

    def clock_hint(self, stamp: Time, now_ns: int) -> str:
        """Return a hint about wrong clocks for a message's stamp at an instant [ns]; '' if they agree."""
        stamp_ns = nanoseconds(stamp)
        # Called with every battery state, so look the parameter up only if needed.
        if abs(stamp_ns - now_ns) < FAR_NS:
            return ''
        return clock_hint(self._node.get_parameter('use_sim_time').value, now_ns, stamp_ns)


def clock_hint(uses_sim_time: bool, now_ns: int, stamp_ns: int) -> str:
    """Return the clock that is likely wrong if now and a stamp [ns] are far apart; otherwise ''."""
    if not now_ns or not stamp_ns or abs(stamp_ns - now_ns) < FAR_NS:
        return ''
    apart_days = (stamp_ns - now_ns) / NS_PER_DAY
    where = f'{abs(apart_days):.0f} days {"after" if apart_days > 0.0 else "before"}'
    if uses_sim_time:
        return (f"the stamp lies {where} this node's time, which is /clock (use_sim_time is set): "
                'set use_sim_time:=true at the sender too, or use_sim_time:=false here')
    return (f"the stamp lies {where} this node's time, which is the system's: if the sender is "
            'simulated or replayed, set use_sim_time:=true here; if not, one of the two clocks is '
            'not set')


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
    if not given and '--params-file' in sys.argv:
        sentences.append('the parameter file holds nothing for '
                         f'{node.get_fully_qualified_name()}; all parameters have their defaults')
    return sentences
