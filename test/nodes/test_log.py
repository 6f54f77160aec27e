# SPDX-License-Identifier: Apache-2.0
"""The log suppresses repetitions and shows everything new."""

import ast
from pathlib import Path

import pytest

import bev_preheat
from bev_preheat.nodes.node import RepetitionFilter


def test_a_sentence_is_news_again_after_5_s():
    now_s, told_s = 100.0, []
    news = RepetitionFilter(lambda: now_s)
    for tenths in range(101):
        now_s = 100.0 + tenths / 10.0
        if news.has('route_plan refused: speed: is empty'):
            told_s.append(now_s)
    assert told_s == [100.0, 105.0, 110.0]


def test_whoever_makes_up_sentences_does_not_fill_the_disk():
    now_s, lines = 100.0, 0
    news = RepetitionFilter(lambda: now_s)
    for number in range(60_000):
        now_s = 100.0 + number / 1000.0
        lines += news.has('route_plan refused: ' + chr(0x4e00 + number % 20_000))
    # 10 in each 5 s.
    assert lines == 120


# Severities

PACKAGE = Path(bev_preheat.__file__).parent
SEVERITIES = {'debug', 'info', 'warn', 'warning', 'error', 'fatal'}


def chosen_severities(source):
    return [node.lineno for node in ast.walk(ast.parse(source))
            if isinstance(node, (ast.Assign, ast.IfExp))
            for value in ([node.value] if isinstance(node, ast.Assign) else [node.body, node.orelse])
            if isinstance(value, ast.Attribute) and value.attr in SEVERITIES
            and 'logger' in ast.unparse(value.value)]


@pytest.mark.parametrize('room', ['nodes', 'bus', 'monitoring', 'recording', 'vehicle'])
def test_no_line_logs_with_several_severities(room):
    files = sorted((PACKAGE / room).glob('*.py'))
    assert files
    assert {path.name: lines for path in files if (lines := chosen_severities(path.read_text()))} == {}
