# SPDX-License-Identifier: Apache-2.0
"""The soak test of the monitor detects each failure."""

import json
import subprocess
import sys

import pytest

from bev_preheat_studies.soak.monitor import judge, Seen
from bev_preheat_studies.soak.terminal import TerminalProcess

LIMIT_S = 240.0


def bad(**changed):
    seen = Seen(**{
        'memory': [(float(t), 85.0) for t in range(600)], 'drives': 9, 'views': 2300,
        'longest_between_views_s': 0.6, 'oldest_shown_s': 4.0,
        'temperatures': {f'{c} degC' for c in range(30)}, 'exit_status': 0,
        'restores_terminal': True, **changed})
    return [item.what for item in judge(seen) if not item.good]


def test_a_steady_run_is_good():
    assert bad() == []


@pytest.mark.parametrize('changed, what', [
    ({'memory': [(float(t), 85.0 + 0.002 * t) for t in range(600)]},
     'resident memory, growth in 10 min'),
    ({'exit_status': 1}, 'monitor'), ({'exit_status': None}, 'monitor'),
    ({'restores_terminal': False}, 'terminal'), ({'said': 'Traceback'}, 'output besides its page'),
    ({'longest_between_views_s': 11.0}, 'longest time between two views'),
    ({'oldest_shown_s': 31.0}, 'oldest battery state shown'),
    ({'temperatures': {'-7.0 degC'}}, 'different temperatures shown'),
    ({'drives': 0}, 'drives that arrived')])
def test_what_is_wrong_is_named(changed, what):
    assert bad(**changed) == [what]


def in_terminal(program, *arguments):
    return TerminalProcess([sys.executable, '-c', program], 40, 10, *arguments)


def test_views_are_counted_and_the_last_whole_one_is_read():
    program = r"print('\x1b[H\x1b[31mone\x1b[0m', '\x1b[Htwo', '\x1b[Hthr', sep='', end='')"
    with in_terminal(program) as process:
        assert process.wait(LIMIT_S) == 0
        assert (process.views, process.view) == (3, 'two')


@pytest.mark.parametrize('written, is_as_before', [
    ('', True), ('\x1b[?25l\x1b[?25h', True), ('\x1b[?25l', False), ('\x1b[?1049h', False),
    ('\x1b[?1049h\x1b[?25l\x1b[?1049l\x1b[?25h', True)])
def test_a_terminal_that_was_not_given_back_is_seen(written, is_as_before):
    with in_terminal(f'print({written!r})') as process:
        assert process.wait(LIMIT_S) == 0
        assert process.has_left_terminal_as_it_was is is_as_before


def test_it_has_the_size_that_it_was_given():
    with in_terminal('import os; print(*os.get_terminal_size())') as process:
        assert process.wait(LIMIT_S) == 0
        assert process.tail == b'40 10\r\n'


@pytest.mark.deep
@pytest.mark.usefixtures('dds')
def test_a_short_soak_test_watches_the_monitor_and_judges_it(tmp_path):
    figures = tmp_path / 'soak.json'
    done = subprocess.run(
        [sys.executable, '-m', 'bev_preheat_studies.soak.monitor', '--minutes', '1.5', '--output',
         str(figures)], capture_output=True, text=True, timeout=300)
    items = {item['what']: item for item in json.loads(figures.read_text())['judgements']}
    # In a minute the memory still fills, and a busy computer does not finish a drive.
    for what in ('resident memory, growth in 10 min', 'drives that arrived'):
        del items[what]
    assert [item for item in items.values() if not item['good']] == [], done.stdout
    assert int(items['views']['value']) > 50
