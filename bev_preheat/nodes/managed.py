# SPDX-License-Identifier: Apache-2.0
"""The lifecycle services of a node, for stacks with a lifecycle manager."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.task import Future

from bev_preheat.nodes.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

LIFECYCLE = Parameter('lifecycle', False, 'Managed node (rclpy lifecycle): 0 W unless it is active.',
                      read_only=True)
NOT_ACTIVE = 'The node is managed (lifecycle:=true) and not active.'
# From the transition `shutdown` to the end of the process, for the delivery of its response [s].
LINGER_S = 0.2


class ManagedStates(LifecycleNodeMixin):
    """
    Adds the lifecycle services to a node and reports whether it is active.

    The node listens and reports in every state; only `active` allows heat. rclpy's own class would have to be the
    node's base class, whether or not it is managed. `finished` is done soon after the transition `shutdown`; the
    process ends then.
    """

    def __init__(self, node: Node, on_change: Callable[[bool], object]) -> None:
        """Offer the services; `on_change(is_active)` is called at each transition."""
        self._node, self._on_change = node, on_change
        self.finished = Future()
        super().__init__()

    @property
    def handle(self) -> Any:
        """The node's handle, for rclpy."""
        return self._node.handle

    @property
    def default_callback_group(self) -> Any:
        """The node's callback group, for rclpy."""
        return self._node.default_callback_group

    @property
    def _services(self) -> Any:
        return self._node._services

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stay off."""
        return self._become(False)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Allow heat."""
        return self._become(True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Switch off."""
        return self._become(False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stay off."""
        return self._become(False)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Switch off for good, and end the process."""
        self._node.create_timer(LINGER_S, self._finish, clock=Clock(clock_type=ClockType.STEADY_TIME))
        return self._become(False)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Switch off after an exception of a transition."""
        return self._become(False)

    def _finish(self) -> None:
        if not self.finished.done():
            self.finished.set_result(None)

    def _become(self, is_active: bool) -> TransitionCallbackReturn:
        self._on_change(is_active)
        return TransitionCallbackReturn.SUCCESS
