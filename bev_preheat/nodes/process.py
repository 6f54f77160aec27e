# SPDX-License-Identifier: Apache-2.0
"""The main loop of all executables: clean start, clean end."""

from __future__ import annotations

import os
import signal
import sys
from threading import Thread
from typing import TYPE_CHECKING

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from bev_preheat.nodes.command_line import (
    check_domain_id,
    has_other_than_ros_arguments,
    print_error,
    silent_rcl,
    START_ERRORS,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from bev_preheat.nodes.command_line import NodeProgram

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# For the delivery of a node's last message: a subscriber that hangs must not keep the process from ending.
LAST_WORDS_TIME = Duration(seconds=1)


def join_graph(name: str) -> Node | None:
    """
    Join the ROS graph with a hidden node `_<name>_loads`, before the modules of the real node are loaded.

    DDS announces a new participant five times within half a second, then every 3 s. Loading the planner takes
    longer, so it misses the announcements of processes that start at the same time. Median from process start
    to first command (`bev_preheat_studies cost --only process`): 0.85 s with this node, 3.7 s without.
    Against processes that have been up for seconds it makes no difference (2.7 s and 2.6 s).

    Return the node for `run_node`, which destroys it; None if `run_node` has to report an error or print the help.
    """
    if has_other_than_ros_arguments(sys.argv):
        return None
    try:
        _init()
        return rclpy.create_node(f'_{name}_loads', use_global_arguments=False, enable_rosout=False,
                                 start_parameter_services=False)
    except START_ERRORS:
        rclpy.try_shutdown()
        return None


def run_node(make_node: Callable[[], Node], program: NodeProgram | None = None,
             loading_node: Node | None = None) -> int:
    """
    Make a node, spin it until SIGINT, SIGTERM or its own `finished` future, and destroy it.

    `program` checks the command line and answers --help; `loading_node` comes from `join_graph`.
    The node's `last_words()`, if it has any, is called while it can still publish, after an exception of a
    callback too. Return the exit status: 0 after a clean end, or the node's `exit_status`; 2 if arguments or
    parameters forbid a start.
    """
    if program is not None:
        program.check_arguments(sys.argv)
    # rclpy's own handlers would shut the context down before the last command is published.
    signal_pipe = _pipe_of_signals()
    try:
        try:
            if loading_node is None:
                _init()
            node = make_node()
            if loading_node is not None:
                loading_node.destroy_node()
        except START_ERRORS as error:
            print_error(error, program)
            return 2
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        finished = getattr(node, 'finished', None) or Future()
        # A task ends the executor's wait; its spin_until_future_complete would add a callback to the future
        # in every turn and never remove it.
        finished.add_done_callback(lambda _: executor.create_task(_do_nothing))
        Thread(target=_wait_for_signal, args=(signal_pipe, finished), daemon=True).start()
        try:
            while rclpy.ok() and not finished.done():
                executor.spin_once()
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        finally:
            if rclpy.ok() and hasattr(node, 'last_words'):
                node.last_words()
            executor.shutdown()
            node.destroy_node()
        return int(getattr(node, 'exit_status', 0))
    finally:
        rclpy.try_shutdown()


def _init() -> None:
    check_domain_id()
    with silent_rcl():
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)


def _do_nothing() -> None:
    pass


def _pipe_of_signals() -> int:
    """
    Return a file descriptor that receives a byte for each end signal.

    A Python handler runs only when the main thread returns to the interpreter, which may take long while it
    waits for messages; the pipe is written at once.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in END_SIGNALS:
        signal.signal(number, lambda number, frame: None)
    return reader


def _wait_for_signal(signal_pipe: int, finished: Future) -> None:
    os.read(signal_pipe, 1)
    if not finished.done():
        finished.set_result(None)
