# SPDX-License-Identifier: Apache-2.0
"""The base of all nodes: parameters of a table, guarded callbacks, news said once, diagnostics, lifecycle."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
import re
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future

from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.messages.diagnostics import diagnostics
from bev_preheat.nodes.parameters import check, declare, StartParameter, USE_SIM_TIME
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.setup_watch import DIAGNOSTICS_PERIOD_S, SetupWatch

# A method called by ROS.
Callback = Callable[..., Any]
# Values of parameters by name, with the types of the parameter table.
Values = dict[str, Any]

# A sentence is not repeated within this time [s]; at most this many different ones are logged in it.
PERIOD_S = 5.0
MOST_SENTENCES = 10
FIGURE = re.compile(r'[-+]?\d+(\.\d+)?(e[-+]?\d+)?')


class RepetitionFilter:
    """Distinguishes news from repetition: sentences that differ only in figures, such as ages, are the same."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Take a clock [s of real time], because problems also occur while simulated time stands."""
        self._clock_s = clock_s
        self._told_s: dict[str, float] = {}

    def has(self, sentence: str) -> bool:
        """Return whether to log a sentence now; if so, record it as logged."""
        kind, now_s = without_figures(sentence), self._clock_s()
        self._told_s = {told: told_s for told, told_s in self._told_s.items()
                        if now_s - told_s < PERIOD_S}
        if kind in self._told_s or len(self._told_s) >= MOST_SENTENCES:
            return False
        self._told_s[kind] = now_s
        return True


def without_figures(sentence: str) -> str:
    """Return a sentence with `#` in place of each number in it."""
    return FIGURE.sub('#', sentence)


LIFECYCLE = StartParameter('lifecycle', False, 'Managed node (rclpy lifecycle): 0 W unless it is active.')
NOT_ACTIVE = 'The node is managed (lifecycle:=true) and not active.'
# From the transition `shutdown` to the end of the process, for the delivery of its response [s].
LINGER_S = 0.2


def guarded(callback: Callback) -> Callback:
    """Wrap a method called by ROS: an unexpected exception goes to the node's `fail`."""
    @wraps(callback)
    def wrapper(self: Any, *arguments: Any) -> Any:
        try:
            return callback(self, *arguments)
        except Exception as error:
            self.fail(callback.__name__, error)
            # A service's answer, as far as it is filled in.
            return arguments[-1] if arguments else None
    return wrapper


class ProgramNode(LifecycleNodeMixin, Node):
    """
    A node of a NodeProgram: its `values` by name; `hardware` for diagnostics; `finished` ends its process.

    Each constructor raises InvalidInput if a parameter is not allowed.
    """

    def __init__(self, program: NodeProgram) -> None:
        # The mixin's own begins with `manage`.
        super(LifecycleNodeMixin, self).__init__(program.name)
        self.values: Values = declare(self, program.parameters)
        self.finished, self.hardware = Future(), ''
        self._parameters_of_program, self._news = program.parameters, RepetitionFilter()

    def now_ns(self) -> int:
        """Return the instant of the node's clock [ns]."""
        return int(self.get_clock().now().nanoseconds)

    def steady_timer(self, period_s: float, callback: Callback) -> Any:
        """Return a timer in real time: the node's clock may stand or be set."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def tell(self, sentence: str, is_warning: bool = True) -> None:
        """Log a sentence unless it was logged in the last seconds."""
        if not self._news.has(sentence):
            return
        # One call for each severity: rclpy raises if a line of code logs with a second one.
        if is_warning:
            self.get_logger().warning(sentence)
        else:
            self.get_logger().info(sentence)

    def look_regularly(self, period_s: float, where: str, look: Callback) -> Any:
        """Return a timer in real time; an unexpected exception of `look()` is logged, and affects nothing else."""
        def logged() -> None:
            try:
                look()
            except Exception as error:
                self.log_error(where, error)
        return self.steady_timer(period_s, logged)

    def log_error(self, where: str, error: Exception) -> None:
        """Log an unexpected exception."""
        sentence = f'{where}: {type(error).__name__}: {error}'
        if self._news.has(sentence):
            self.get_logger().error(sentence)

    def fail(self, where: str, error: Exception) -> None:
        """Go on after an unexpected exception of a callback."""
        self.log_error(where, error)

    # Diagnostics

    def watch(self, subscribes: Iterable[str], publishes: Iterable[str], single: Iterable[str] = ()) -> None:
        """Begin to watch the topics shared with other nodes, as SetupWatch does, and to report."""
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.setup = SetupWatch(self, subscribes, publishes, single)
        self.steady_timer(DIAGNOSTICS_PERIOD_S, self.report)

    @guarded
    def report(self) -> None:
        """Publish the diagnostics, once in DIAGNOSTICS_PERIOD_S of real time."""
        self.publish_diagnostics()

    def entries(self) -> list[DiagnosticStatus]:
        """Return the node's own entries of the diagnostics by part, besides that of its setup."""
        return []

    def publish_diagnostics(self) -> None:
        """Publish the diagnostics."""
        self._diagnostics_publisher.publish(diagnostics(
            self.get_fully_qualified_name(), self.hardware, self.now_ns(), [*self.entries(), self.setup.entry()]))

    # Parameters

    def follow_parameters(self) -> None:
        """Allow changes at run time: `check_values`, then `take_values`."""
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)

    def check_lock(self, parameters: Sequence[RosParameter]) -> None:
        """Raise InvalidInput if parameters, also those of ROS, must not change."""

    def check_values(self, changed: Values) -> None:
        """Raise InvalidInput if new values, each of which is in its range, do not fit."""

    def take_values(self, changed: Values) -> None:
        """Go on with new values; `values` has them already."""

    def _changed(self, parameters: Sequence[RosParameter]) -> Values:
        return {parameter.name: parameter.value for parameter in parameters if parameter.name in self.values}

    def _check_parameters(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        try:
            self.check_lock(parameters)
            changed = self._changed(parameters)
            check(self._parameters_of_program, changed)
            self.check_values(changed)
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            return SetParametersResult(successful=False, reason=shortened(
                f'cannot be checked: {type(error).__name__}: {error}', LONGEST_PROBLEM))
        return SetParametersResult(successful=True)

    @guarded
    def _take_parameters(self, parameters: Sequence[RosParameter]) -> None:
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME:
                self.get_logger().warning(
                    f'use_sim_time = {str(parameter.value).lower()}: stamps and leases now follow '
                    f'{"/clock; its publisher sets the time" if parameter.value else "the system clock"}.')
        if changed := self._changed(parameters):
            self.values = {**self.values, **changed}
            self.take_values(changed)

    # Lifecycle

    def manage(self, on_change: Callable[[bool], object]) -> None:
        """
        Offer the lifecycle services; `on_change(is_active)` is called at each transition.

        The node listens and reports in every state; only `active` allows heat. `finished` is done soon after the
        transition `shutdown`; the process ends then.
        """
        self._on_change = on_change
        LifecycleNodeMixin.__init__(self)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stay off."""
        self._on_change(False)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Allow heat."""
        self._on_change(True)
        return TransitionCallbackReturn.SUCCESS

    # Off: at once, before configuration, and after an exception of a transition.
    on_deactivate = on_cleanup = on_error = on_configure

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Switch off for good, and end the process."""
        self.steady_timer(LINGER_S, self._end_process)
        return self.on_configure(state)

    def _end_process(self) -> None:
        if not self.finished.done():
            self.finished.set_result(None)
