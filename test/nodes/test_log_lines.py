# SPDX-License-Identifier: Apache-2.0
"""rclpy raises if one line of code logs with a second severity; no node may end of that."""

import ast
from pathlib import Path

import pytest
from rclpy.logging import get_logger

import bev_preheat
from bev_preheat.nodes.state_keeper import StateKeeper

PACKAGE = Path(bev_preheat.__file__).parent
SEVERITIES = {'debug', 'info', 'warn', 'warning', 'error', 'fatal'}


def chosen_severities(source):
    """Return the lines that choose a method of a logger and call it elsewhere."""
    return [node.lineno for node in ast.walk(ast.parse(source))
            if isinstance(node, (ast.Assign, ast.IfExp))
            for value in ([node.value] if isinstance(node, ast.Assign) else [node.body, node.orelse])
            if isinstance(value, ast.Attribute) and value.attr in SEVERITIES
            and 'logger' in ast.unparse(value.value)]


def test_a_chosen_severity_is_found():
    assert chosen_severities('log = self.get_logger().info if good else self.get_logger().warning') == [1, 1]
    assert chosen_severities('log = logger.error\nlogger.info(error.problem if error.fatal else text)') == [1]


@pytest.mark.parametrize('room', ['nodes', 'bus', 'monitoring', 'recording', 'vehicle'])
def test_no_line_logs_with_several_severities(room):
    files = sorted((PACKAGE / room).glob('*.py'))
    assert files
    assert {path.name: lines for path in files if (lines := chosen_severities(path.read_text()))} == {}


def test_a_foreign_state_file_and_a_damaged_one_are_logged(tmp_path):
    keeper = StateKeeper(get_logger('test_log_lines'))
    cases = ('notes', 'bread, milk', True), ('state', '{"bev_preheat_state_file": 2}', False)
    for name, contents, is_foreign in cases:
        (tmp_path / name).write_text(contents)
        keeper.attach(str(tmp_path / name), b'a car')
        assert (bool(keeper.report().problem), keeper.report().is_foreign) == (True, is_foreign)
