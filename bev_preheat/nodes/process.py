# SPDX-License-Identifier: Apache-2.0
"""The command line and the main loop of all executables: `--help`, one line for each start error, a clean end."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
import os
import re
import signal
import sys
import textwrap
from threading import Thread
from typing import TYPE_CHECKING

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger_level, LoggingSeverity, set_logger_level
from rclpy.qos import InvalidQoSProfileException
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from bev_preheat.errors import InvalidInput

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from typing import NoReturn

    from rclpy.node import Node

    from bev_preheat.nodes.parameters import Parameter

# Raised by rclpy for unusable arguments, names or parameter values.
START_ERRORS = (
    InvalidInput, NameValidationException, ParameterException, InvalidQoSProfileException,
    rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError)
HELP_WIDTH = 98
# DDSI-RTPS 2.5, 9.6.2.3: port 7400 + 250 x domain id, plus an offset for each participant.
MOST_DOMAIN_ID = 232
RCL_LOGGER = 'rcl'
END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# For the delivery of a node's last message: a subscriber that hangs must not keep the process from ending.
LAST_WORDS_TIME = Duration(seconds=1)


@dataclass(frozen=True)
class NodeProgram:
    """The contents of an executable's `--help`; topics, services and actions are (name, explanation)."""

    name: str
    description: str
    parameters: tuple[Parameter, ...]
    subscribes: tuple[tuple[str, str], ...] = ()
    publishes: tuple[tuple[str, str], ...] = ()
    services: tuple[tuple[str, str], ...] = ()
    actions: tuple[tuple[str, str], ...] = ()

    def check_arguments(self, arguments: Sequence[str]) -> None:
        """
        Print the help and exit with status 0 if requested; refuse arguments unknown to ROS.

        `arguments` are those of the process, its name first. ROS parses everything between --ros-args
        and --.
        """
        parser = _Parser(
            prog=self.name, description=self.description, epilog=self._epilog(),
            usage='%(prog)s [--help] [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...]',
            formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.parse_args(_without_ros_arguments(arguments[1:]))

    def _epilog(self) -> str:
        example = self.parameters[0]
        lines = [
            'set a parameter:',
            f'  {self.name} --ros-args -p {example.name}:={example.default or "VALUE"}',
            f'  {self.name} --ros-args --params-file FILE.yaml',
            *([] if all(parameter.read_only for parameter in self.parameters) else
              [f'  ros2 param set /{self.name} NAME VALUE']), '', 'parameters:']
        for parameter in self.parameters:
            lines.append(f'  {parameter.name} (default: {parameter.default_text()})')
            lines += textwrap.wrap(parameter.help_text(), HELP_WIDTH, initial_indent='      ',
                                   subsequent_indent='      ')
        for title, items in (('subscribes to', self.subscribes), ('publishes', self.publishes),
                             ('services', self.services), ('actions', self.actions)):
            if items:
                width = max(len(name) for name, _ in items)
                lines += ['', f'{title}:', *(f'  {name:{width}}  {what}' for name, what in items)]
        return '\n'.join(lines)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: error: {message}; see {self.prog} --help\n')


def _without_ros_arguments(arguments: Iterable[str]) -> list[str]:
    """Return the arguments outside of --ros-args sections, which end at --, or at the end."""
    others, is_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            is_ros = True
        elif is_ros and argument == '--':
            is_ros = False
        elif not is_ros:
            others.append(argument)
    return others


def print_error(error: Exception | str, program: NodeProgram | None = None) -> None:
    """Print an exception of START_ERRORS as one line on standard error."""
    name = program.name if program else sys.argv[0].rpartition('/')[2]
    print(f'{name}: error: {_sentence(error)}', file=sys.stderr)


def _sentence(error: Exception | str) -> str:
    if isinstance(error, rclpy_implementation.UnknownROSArgsError):
        return f'unknown ROS arguments: {error}'
    # rcl adds its own source lines, one for each function in the chain.
    text = re.sub(r',? at \S+\.c(pp)?:\d+', '', ' '.join(str(error).split()))
    text = text.replace('failed to initialize rcl: ', '').replace('error not set', 'no value')
    rule_match = re.search(r"parse (parameter override|remap) rule: '(.*?)'\.", text)
    if rule_match:
        kind, rule = rule_match.groups()
        form = 'NAME:=VALUE' if kind.startswith('param') else 'FROM:=TO, with valid ROS names'
        return f'{rule}: cannot be read; it must be {form}'
    file_match = re.search(r"'--params-file (.*?)'\. Error: (.*)", text)
    if file_match:
        path, problem = file_match.groups()
        try:
            with open(path, encoding='utf-8'):
                pass
        except OSError as unreadable:
            problem = f'cannot be read: {unreadable.strerror}'
        return f'parameter file {path}: {problem}'
    return text


def join_graph(name: str) -> Node | None:
    """
    Join the ROS graph with a hidden node `_<name>_loads`, before the modules of the real node are loaded.

    DDS announces a new participant five times within half a second, then every 3 s. Loading the planner takes
    longer, so it misses the announcements of processes that start at the same time. Median from process start
    to first command (`bev_preheat_studies cost --only process`): 0.85 s with this node, 3.7 s without.
    Against processes that have been up for seconds it makes no difference (2.7 s and 2.6 s).

    Return the node for `run_node`, which destroys it; None if `run_node` has to report an error or print the help.
    """
    if _without_ros_arguments(sys.argv[1:]):
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
        finished.add_done_callback(lambda _: executor.create_task(lambda: None))
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
    domain_id = os.environ.get('ROS_DOMAIN_ID', '')
    # It would end the process in some middlewares.
    if domain_id.isdecimal() and int(domain_id) > MOST_DOMAIN_ID:
        raise InvalidInput(f'ROS_DOMAIN_ID: {domain_id} is not allowed; it must be 0 ... {MOST_DOMAIN_ID}')
    # `print_error` reports the problem that rcl would log.
    set_logger_level(RCL_LOGGER, LoggingSeverity.FATAL)
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    finally:
        # Unless the command line asked for a level.
        if get_logger_level(RCL_LOGGER) == LoggingSeverity.FATAL:
            set_logger_level(RCL_LOGGER, LoggingSeverity.UNSET)


def _pipe_of_signals() -> int:
    """Return a descriptor that gets a byte at each end signal, at once; a Python handler may run much later."""
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
