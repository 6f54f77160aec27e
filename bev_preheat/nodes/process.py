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
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from bev_preheat.nodes.command_line import print_error, silent_rcl, START_ERRORS
from bev_preheat.nodes.executor import PromptExecutor

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from bev_preheat.nodes.command_line import Program

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def run_node(make_node: Callable[[], Node], program: Program | None = None) -> int:
    """
    Make a node, spin it until SIGINT, SIGTERM or its own `finished` future, and end it.

    `program` (a command_line.Program) checks the process's arguments and answers --help. The node's
    `last_words()`, if it has any, are called while it can still publish. Returns the exit status: 0
    after a clean end, 2 where arguments or parameters made a start impossible.
    """
    if program is not None:
        program.check_arguments(sys.argv)
    # rclpy's own handlers would take the context down before the last command is out.
    told_to_end = _pipe_of_signals()
    try:
        try:
            with silent_rcl():
                rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            node = make_node()
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
