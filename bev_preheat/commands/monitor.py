# SPDX-License-Identifier: Apache-2.0
"""`preheat monitor`: a running planner, watched in a terminal."""

import io
import os
import signal
import time

from rich.console import Console
from rich.live import Live

from bev_preheat.errors import InvalidInput
from bev_preheat.output_files import check_outputs, Output, write_whole

REFRESH_S = 0.25
LINE_PERIOD_S = 15.0
# --once waits this long for all topics [s]. What is missing is said after so long a silence [s].
ONCE_LIMIT_S = 15.0
SILENCE_S = 3.0
LEAST_WIDTH, MOST_WIDTH = 60, 110


def add_parser(subparsers):
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'monitor', help='a running planner, watched in a terminal',
        description='Shows what a running planner measures, predicts, plans and commands, until '
        'Ctrl-C. Where the output is no terminal, a line every 15 s.')
    parser.add_argument('--namespace', default='/', help='of the planner (default: %(default)s)')
    parser.add_argument('--node', default='planner', metavar='NAME',
                        help='its name (default: %(default)s)')
    parser.add_argument('--seconds', type=float, metavar='S', help='end after so long')
    parser.add_argument('--once', action='store_true',
                        help='show it once, when every topic has been heard; exit status 1 where '
                        f'that takes more than {ONCE_LIMIT_S:g} s')
    parser.add_argument('--picture', metavar='FILE', help='write the last view as SVG')
    parser.set_defaults(run=run)


def run(arguments):
    """Listen and show; returns the exit status."""
    if arguments.seconds is not None and not 0.0 < arguments.seconds < 1e9:
        raise InvalidInput(f'--seconds: {arguments.seconds:g} is not allowed; it must be above 0')
    check_outputs([Output('--picture', arguments.picture, ('.svg',))])
    from rclpy.exceptions import InvalidNamespaceException

    from bev_preheat.monitoring.heard import Heard, subscribe
    from bev_preheat.nodes.listening import spun_node
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    prefix = arguments.namespace.strip('/')
    heard = Heard(f'{prefix}/{arguments.node}' if prefix else arguments.node)
    try:
        with spun_node(f'monitor_{os.getpid()}', namespace=arguments.namespace) as node:
            subscribe(node, heard)
            return _show(arguments, heard, node, Console(highlight=False, record=True))
    except InvalidNamespaceException as error:
        raise InvalidInput(f'--namespace: {arguments.namespace!r}: {error}') from error
    except KeyboardInterrupt:
        return 0


def _interrupt(number, frame):
    raise KeyboardInterrupt


def _show(arguments, heard, node, console):
    from bev_preheat.monitoring.view import line, page, waiting
    width = min(max(console.width, LEAST_WIDTH), MOST_WIDTH)
    started_s = time.monotonic()

    def ends():
        elapsed_s = time.monotonic() - started_s
        if arguments.once:
            return not heard.silent_topics or elapsed_s > (arguments.seconds or ONCE_LIMIT_S)
        return arguments.seconds is not None and elapsed_s >= arguments.seconds

    def view():
        if not heard.latest and time.monotonic() - started_s > SILENCE_S:
            return waiting(heard, node.count_publishers, os.environ.get('ROS_DOMAIN_ID', '0'))
        return page(heard, width)

    try:
        if arguments.once:
            while not ends():
                time.sleep(REFRESH_S)
        elif console.is_terminal:
            with Live(console=console, auto_refresh=False, transient=True) as live:
                while not ends():
                    live.update(view(), refresh=True)
                    time.sleep(REFRESH_S)
        else:
            _lines(ends, console, lambda: line(heard) if heard.latest else waiting(
                heard, node.count_publishers, os.environ.get('ROS_DOMAIN_ID', '0')))
            return 0
    finally:
        if arguments.once or arguments.picture:
            _last_view(arguments, heard, page(heard, width), console)
    if heard.silent_topics:
        console.print(waiting(heard, node.count_publishers,
                              os.environ.get('ROS_DOMAIN_ID', '0')), markup=False)
    return int(arguments.once and bool(heard.silent_topics))


def _lines(ends, console, text):
    next_s = time.monotonic() + min(SILENCE_S, LINE_PERIOD_S)
    while not ends():
        if time.monotonic() >= next_s:
            console.print(text(), markup=False, soft_wrap=True)
            next_s += LINE_PERIOD_S
        time.sleep(REFRESH_S)


def _last_view(arguments, heard, view, console):
    if not arguments.picture:
        console.print(view)
        return
    recorder = Console(record=True, width=MOST_WIDTH, file=io.StringIO(), force_terminal=True,
                       color_system='truecolor')
    recorder.print(view)
    write_whole(arguments.picture, recorder.export_svg(title='preheat monitor'))
