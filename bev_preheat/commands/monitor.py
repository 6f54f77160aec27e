# SPDX-License-Identifier: Apache-2.0
"""`preheat monitor`: a live view of a running planner in a terminal."""

from __future__ import annotations

import errno
import os
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile
from bev_preheat.monitoring.end_signals import EndSignals
from bev_preheat.optional_packages import require_ros

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from bev_preheat.commands.parser import Subparsers

# --once waits this long for all topics [s].
ONCE_LIMIT_S = 15.0


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'monitor', help='live view of a running planner in a terminal',
        description='Shows the measurements, predictions, plans and commands of a running planner, until '
        'Ctrl-C. If the output is not a terminal, prints a line every 15 s.')
    add_planner_arguments(parser)
    parser.add_argument('--seconds', type=float, metavar='S', help='end after this time [s]')
    parser.add_argument('--once', action='store_true',
                        help='show it once, when every message has come; exit status 1 if '
                        f'that takes more than {ONCE_LIMIT_S:g} s')
    parser.add_argument('--picture', metavar='FILE', help='write the last view as SVG')
    parser.set_defaults(run=run)


def add_planner_arguments(parser: ArgumentParser) -> None:
    """Add `--namespace` and `--node`."""
    parser.add_argument('--namespace', default='/', help='namespace of the planner (default: %(default)s)')
    parser.add_argument('--node', default='planner', metavar='NAME',
                        help='node name of the planner (default: %(default)s)')


def planner_of(arguments: Namespace) -> str:
    """Return the full name of the planner's node."""
    prefix = arguments.namespace.strip('/')
    return f'/{prefix}/{arguments.node}' if prefix else f'/{arguments.node}'


def run(arguments: Namespace) -> int:
    """Listen and show the view; returns the exit status."""
    if arguments.seconds is not None and not 0.0 < arguments.seconds < 1e9:
        raise InvalidInput(f'--seconds: {arguments.seconds:g} is not allowed; it must be above 0')
    check_outputs([OutputFile('--picture', arguments.picture, ('.svg',))])
    try:
        # Handle signals from here on, because importing ROS is slow, too.
        with EndSignals() as signals:
            return _listen(arguments, signals)
    except KeyboardInterrupt:
        return 0
    except OSError as error:
        if error.errno == errno.EIO:
            # The terminal was closed.
            raise BrokenPipeError from error
        raise


def _listen(arguments: Namespace, signals: EndSignals) -> int:
    """Show the received data until a signal comes; return the exit status."""
    require_ros()
    from rich.console import Console

    from bev_preheat.monitoring.terminal_page import LiveView
    from bev_preheat.nodes.listening import listening
    with listening(f'monitor_{os.getpid()}', namespace=arguments.namespace) as listener:
        watch = LiveView(listener, planner_of(arguments), Console(highlight=False), signals,
                         arguments.seconds or (ONCE_LIMIT_S if arguments.once else None))
        try:
            if arguments.once:
                return int(not watch.show_once())
            watch.show()
        finally:
            if arguments.picture:
                watch.write_picture(arguments.picture)
    return 0
