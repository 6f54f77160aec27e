# SPDX-License-Identifier: Apache-2.0
"""Tables keep every name whole at any terminal width; failing outputs end in one line."""

import io

import pytest
from rich.console import Console

from bev_preheat.commands.terminal import print_figures, print_records, progress_bar

METHODS = ['value_function', 'optimal_switch, driven', 'paper, driven', 'nlp']
STATUSES = ['TARGET_UNREACHABLE', 'NO_CHARGING_PLANNED', 'OUT_OF_CHARGE', 'WAITING']
RECORDS = [
    ('battery_state_drop_out', 'statuses', 'TARGET_UNREACHABLE, SOC_LIMITED',
     'all but TARGET_UNREACHABLE', 'BAD'),
    ('', 'command from 1200 to 1800 s [W]', 'more than 0', 'at most 0', 'BAD'),
    ('[red]stop_in_traffic[/red]', 'arrival error [K]', '-0.5 ... +1', '+0.12', 'good')]


def printed(show, width, *arguments):
    """Return the output on a terminal of a width; no line is wider."""
    console = Console(file=io.StringIO(), width=width, color_system=None)
    show(console, *arguments)
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= width
    assert '…' not in text
    return text


@pytest.mark.parametrize('width', [200, 110, 80, 60])
def test_figures_keep_every_name_whole(width):
    lines = printed(print_figures, width, 'vehicle reference, route alpine_pass', ['', *METHODS], [
        ('Status', *STATUSES), ('Heating starts after', *['49:00 min'] * 4),
        ('Solve time [ms]', '', '', '', '2758.5')]).splitlines()
    for name in [*METHODS, *STATUSES, 'Heating starts after', 'Solve time [ms]']:
        assert any(name in line for line in lines), name


@pytest.mark.parametrize('width', [200, 100, 80, 60, 40])
def test_records_keep_every_word_whole(width):
    text = printed(print_records, width, 'Scenarios',
                   ('scenario', 'what', 'expected', 'seen', ''), RECORDS)
    words = text.replace('│', ' ').split()
    for record in RECORDS:
        for word in ' '.join(record).split():
            assert word in words, word


def test_a_path_longer_than_the_terminal_is_folded_not_cut():
    path = '/srv/' + '/'.join(f'folder_{number}' for number in range(12)) + '/route.csv'
    text = printed(print_figures, 60, None, ['', path], [('Status', 'WAITING')])
    parts = [line.split('┃')[2].strip() for line in text.splitlines() if '┃ ' in line]
    assert ''.join(parts) == path


@pytest.mark.parametrize('is_terminal, kind', [(False, 'xterm'), (True, 'dumb')])
def test_progress_that_nobody_can_see_leaves_no_line(monkeypatch, is_terminal, kind):
    stream = io.StringIO()
    monkeypatch.setattr(stream, 'isatty', lambda: is_terminal, raising=False)
    monkeypatch.setattr('sys.stderr', stream)
    monkeypatch.setenv('TERM', kind)
    with progress_bar() as progress:
        progress.update(progress.add_task('trips', total=2), advance=1)
    assert stream.getvalue() == ''
