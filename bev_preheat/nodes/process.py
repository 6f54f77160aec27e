# SPDX-License-Identifier: Apache-2.0
"""The main loop that the executables share: clean start, clean end."""

from __future__ import annotations

import os
import signal
import sys
import threading
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import get_default_context

from bev_preheat.nodes.command_line import (
    check_domain_id,
    has_other_than_ros_arguments,
    print_error,
    silent_rcl,
    START_ERRORS,
)
from bev_preheat.nodes.executor import PromptExecutor

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from bev_preheat.nodes.command_line import NodeProgram

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Herald:
    """
    A hidden node without a publisher or anything else: it keeps the participant of its process in the graph.

    rclpy's Node has publishers. DDS announces those, and what is announced and gone again at once, while the
    processes find each other, holds up all announcements after it for some 0.8 s: nine of 120 starts.
    """

    def __init__(self, name: str) -> None:
        """Appear as `_<name>_loads`; raises START_ERRORS."""
        context = get_default_context()
        with context.handle:
            self._handle = rclpy_implementation.Node(f'_{name}_loads', '/', context.handle, None, False, False)

    def destroy(self) -> None:
        """Disappear; the participant stays if there is another node."""
        self._handle.destroy_when_not_in_use()


def join_graph(name: str) -> Herald | None:
    """
    Join the ROS graph before the node is loaded that is to run, so that others find it meanwhile.

    Returns the Herald for `run_node`, which destroys it once it has made the node. Returns None where
    `run_node` is to say what is wrong, or to print the help.
    """
    if has_other_than_ros_arguments(sys.argv):
        return None
    try:
        _init()
        return Herald(name)
    except START_ERRORS:
        rclpy.try_shutdown()
        return None


def run_node(make_node: Callable[[], Node], program: NodeProgram | None = None,
             herald: Herald | None = None) -> int:
    """
    Make a node, spin it until SIGINT, SIGTERM or its own `finished` future, and end it.

    `program` (a command_line.Program) checks the process's arguments and answers --help; `herald` is what
    `join_graph` returned. The node's `last_words()`, if it has any, are called while it can still publish.
    Returns the exit status: 0 after a clean end, 2 where arguments or parameters made a start impossible.
    """
    if program is not None:
        program.check_arguments(sys.argv)
    # rclpy's own handlers would take the context down before the last command is out.
    told_to_end = _pipe_of_signals()
    try:
        try:
            if herald is None:
                _init()
            node = make_node()
            if herald is not None:
                herald.destroy()
        except START_ERRORS as error:
            print_error(error, program)
            return 2
        finished = getattr(node, 'finished', None) or Future()
        executor = PromptExecutor()
        executor.add_node(node)
        threading.Thread(target=_wait_for_signal, args=(told_to_end, finished), daemon=True).start()
        try:
            finished.add_done_callback(lambda _: executor.wake())
            executor.run(finished.done)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        finally:
            if rclpy.ok() and hasattr(node, 'last_words'):
                node.last_words()
            executor.shutdown()
            node.destroy_node()
        return 0
    finally:
        rclpy.try_shutdown()


def _init() -> None:
    check_domain_id()
    with silent_rcl():
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)


def _pipe_of_signals() -> int:
    """
    Return a file descriptor on which a byte appears for each end signal.

    A handler in Python runs only when the main thread comes back to the interpreter, which may be
    long while it waits for messages; the pipe is written at once.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in END_SIGNALS:
        signal.signal(number, lambda number, frame: None)
    return reader


def _wait_for_signal(told_to_end: int, finished: Future) -> None:
    os.read(told_to_end, 1)
    if not finished.done():
        finished.set_result(None)
