# SPDX-License-Identifier: Apache-2.0
"""
The action ~/prepare_battery: goals in, feedback and results out.

A goal lasts for hours. In rclpy, a function would block for that time, and a coroutine would keep the executor
busy. So a goal is only recorded here, and `PrepareAction.finish` gives its result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from bev_preheat.control.departures import GridPrices
from bev_preheat.control.events import Event, PreparationEnded, PreparationWanted
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal, PreparationOutcome
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.prepare_battery import feedback_message, preparation_goal_of, result_message
from bev_preheat_msgs.action import PrepareBattery

PREPARE = '~/prepare_battery'
# Turns of the executor that a shutdown gives to each client.
LAST_TURNS = 8


class _LastingServer(ActionServer):
    """An ActionServer whose goals run from `execute()` to `give_result()`."""

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: object) -> None:
        """Do nothing: a goal outlasts any function call."""

    def give_result(self, goal_handle: ServerGoalHandle,
                    end: Callable[[ServerGoalHandle], PrepareBattery.Result]) -> None:
        """Let the executor call `end`, which ends the goal and returns its result."""
        super().notify_execute(goal_handle, end)


class PrepareAction:
    """Passes goals to a Supervisor, and its progress and outcomes to their clients."""

    def __init__(self, node: Node, step: Callable[[Event], object], supervisor: Supervisor,
                 fail: Callable[[str, Exception], object],
                 prices: Callable[[], GridPrices | None] = lambda: None) -> None:
        """
        Offer the action.

        `step(event)` runs a step of the Supervisor and passes its outcomes to `finish`; `fail(where, error)`
        handles unexpected exceptions; `prices()` returns those of energy from the grid.
        """
        self._node, self._step, self._supervisor, self._fail = node, step, supervisor, fail
        self._prices = prices
        self._goals: dict[PreparationGoal, ServerGoalHandle] = {}
        self._server = _LastingServer(
            node, PrepareBattery, PREPARE, self._never_called,
            handle_accepted_callback=self._on_goal, cancel_callback=self._on_cancel)

    @staticmethod
    def _never_called(goal_handle: ServerGoalHandle) -> PrepareBattery.Result:
        raise NotImplementedError('results are given by finish()')

    def _on_goal(self, goal_handle: ServerGoalHandle) -> None:
        # A rejection carries no reason, so each goal is accepted, and a bad one ends at once.
        goal_handle.execute()
        try:
            self._begin(goal_handle)
        except Exception as error:
            self._fail('prepare_battery', error)

    def _begin(self, goal_handle: ServerGoalHandle) -> None:
        try:
            preparation_goal = replace(preparation_goal_of(goal_handle.request), prices=self._prices())
        except InvalidInput as error:
            self._node.get_logger().error(f'prepare_battery refused: {error}')
            self._give_result(goal_handle, PreparationOutcome(
                PreparationGoal(), PreparationEnding.REFUSED, f'The goal was refused: {error}.'))
            return
        self._goals[preparation_goal] = goal_handle
        self._step(PreparationWanted(preparation_goal))

    def _on_cancel(self, goal_handle: ServerGoalHandle) -> CancelResponse:
        preparation_goal = next((goal for goal, handle in self._goals.items() if handle == goal_handle), None)
        if preparation_goal is None:
            # The goal has ended already.
            return CancelResponse.REJECT
        try:
            self._step(PreparationEnded(preparation_goal, PreparationEnding.CANCELED, 'The goal was cancelled.'))
        except Exception as error:
            self._fail('prepare_battery', error)
        return CancelResponse.ACCEPT

    def finish(self, outcome: PreparationOutcome) -> None:
        """Give a goal its result."""
        if outcome.ending is not PreparationEnding.REFUSED:
            # Already logged as an error.
            self._node.get_logger().info(
                f'prepare_battery: {outcome.ending.name}: {outcome.explanation}')
        goal_handle = self._goals.pop(outcome.preparation_goal, None)
        if goal_handle is not None:
            self._give_result(goal_handle, outcome)

    def _give_result(self, goal_handle: ServerGoalHandle, outcome: PreparationOutcome) -> None:
        def end(goal_handle: ServerGoalHandle) -> PrepareBattery.Result:
            if outcome.ending is PreparationEnding.REACHED:
                goal_handle.succeed()
            elif goal_handle.is_cancel_requested:
                goal_handle.canceled()
            else:
                goal_handle.abort()
            return result_message(outcome)

        self._server.give_result(goal_handle, end)

    def publish_feedback(self, now_ns: int) -> None:
        """Publish the preparation progress to the client of the active goal."""
        preparation_goal = self._supervisor.state.preparation_goal
        goal_handle = None if preparation_goal is None else self._goals.get(preparation_goal)
        if goal_handle is not None:
            goal_handle.publish_feedback(feedback_message(self._supervisor.state, now_ns))

    def shut_down(self) -> None:
        """Give every goal its result before the process ends."""
        temperature_c = self._supervisor.state.temperature_c
        for preparation_goal in list(self._goals):
            self.finish(PreparationOutcome(
                preparation_goal, PreparationEnding.SHUTTING_DOWN, 'The planner shuts down.',
                temperature_c=math.nan if temperature_c is None else temperature_c))
            for _ in range(LAST_TURNS):
                self._node.executor.spin_once(timeout_sec=0.0)
