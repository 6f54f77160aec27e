# SPDX-License-Identifier: Apache-2.0
"""`preheat monitor` in a terminal: small, resized, interrupted, closed."""

import os
import signal
import sys

import pytest
from terminal_process import CTRL_C, TerminalProcess
from waiting import poll_until, TIME_LIMIT_S

from bev_preheat.nodes.installed_drive import reserved_domain_id

MONITOR = [sys.executable, '-m', 'bev_preheat', 'monitor']


@pytest.fixture
def terminal(dds):
    """Return `terminal(columns, rows)`, which starts a monitor in a ROS domain without a planner."""
    started = []
    with reserved_domain_id() as domain_id:
        def start(columns, rows):
            started.append(TerminalProcess(MONITOR, columns, rows, {
                'ROS_DOMAIN_ID': str(domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}))
            return started[-1]

        yield start
        for process in started:
            process.__exit__()


def wait_for_view(process, condition):
    """Return the first view from now on that satisfies condition(lines)."""
    views = process.views

    def comes():
        process.read(0.05)
        assert process.exit_status is None, process.tail
        lines = process.view.split('\n')
        return lines if process.views > views + 1 and condition(lines) else None

    return poll_until(comes, 'the view')


def has_size(columns, rows):
    """Return the condition that a view fills a terminal of this size exactly."""
    return lambda lines: len(lines) == rows and {len(line) for line in lines} == {columns}


def test_it_fills_any_terminal_follows_its_size_and_gives_it_back_on_ctrl_c(terminal):
    process = terminal(80, 24)
    lines = wait_for_view(process, has_size(80, 24))
    assert 'planner' in lines[0]
    for size in ((40, 10), (132, 50), (1, 1), (100, 24)):
        process.resize(*size)
        wait_for_view(process, has_size(*size))
    process.type(CTRL_C)
    assert process.wait(TIME_LIMIT_S) == 0, process.tail
    assert process.has_left_terminal_as_it_was
    assert b'Traceback' not in process.tail


@pytest.mark.parametrize('number', [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.deep)])
def test_a_signal_ends_it_and_the_terminal_is_as_before(terminal, number):
    process = terminal(80, 24)
    wait_for_view(process, has_size(80, 24))
    os.kill(process.process_id, number)
    assert process.wait(TIME_LIMIT_S) == 0, process.tail
    assert process.has_left_terminal_as_it_was
    assert b'Traceback' not in process.tail


def test_it_ends_when_its_terminal_is_closed(terminal):
    process = terminal(80, 24)
    wait_for_view(process, has_size(80, 24))
    process.close()
    poll_until(lambda: process.exit_status is not None, 'the end')
    assert process.exit_status == 0
