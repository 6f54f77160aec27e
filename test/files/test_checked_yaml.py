# SPDX-License-Identifier: Apache-2.0
"""Two YAML parsers, a fast and a slow one: equal contents, equal messages, and no crash."""

from pathlib import Path

import pytest
from refusals import problems_in
import yaml

from bev_preheat.files.checked_yaml import load_checked_yaml
from bev_preheat.files.input_files import configuration_folder

ANYTHING = 'type: object\n'
FILES = sorted(configuration_folder('vehicles').parent.rglob('*.yaml'))


@pytest.fixture
def load(tmp_path):
    schema = tmp_path / 'schema.yaml'
    schema.write_text(ANYTHING)
    return lambda path: load_checked_yaml(path, schema)


@pytest.fixture
def problem_of(load, tmp_path):
    """Return the problem of a file with a text, without its path."""
    def problem(text):
        (path := tmp_path / 'wrong.yaml').write_text(text)
        [found] = problems_in(f'{path}: ', load, path)
        return found
    return problem


@pytest.mark.parametrize('path', FILES, ids=lambda path: f'{path.parent.name}/{path.name}')
def test_a_file_holds_what_the_reference_parser_finds(load, path):
    assert load(path) == yaml.safe_load(Path(path).read_text(encoding='utf-8'))


def test_exponents_need_neither_a_point_nor_a_sign(load, tmp_path):
    (path := tmp_path / 'numbers.yaml').write_text('a: [7e3, 7.0e3, -1E-3, .5e2, e3, 7e, "7e3"]\n')
    assert load(path) == {'a': [7000.0, 7000.0, -0.001, 50.0, 'e3', '7e', '7e3']}


@pytest.mark.parametrize('text, place', [
    ('a: 1\nb: [1, 2\n', 'line 3, column 1: while parsing a flow sequence from line 2'),
    ('a: 1\n b: 2\n', 'line 2, column 3'), ('a: "\\q"\n', 'line 1, column 6'), ('\ta: 1\n', 'line 1, column 1'),
    ('a: *nothing\n', 'line 1, column 4'), ('a: !!python/none x\n', 'line 1, column 4'),
    ('a: 1\nb: 2\na: 3\n', 'line 3, column 1'), ('a: \x07\n', 'character 4, U+0007')],
    ids=['open bracket', 'indentation', 'escape', 'tab', 'alias', 'tag', 'duplicate key', 'bell'])
def test_what_is_wrong_is_told_in_the_same_words_without_the_fast_parser(problem_of, monkeypatch, text, place):
    told = problem_of(text)
    # Read by the fast parser as far as it gets, and by the other one alone.
    monkeypatch.setattr('bev_preheat.files.checked_yaml.HARMLESS_NESTING', 0)
    assert problem_of(text) == told
    assert told.startswith(f'is not YAML: {place}: ')


def test_aliases_that_multiply_are_refused_at_once(problem_of):
    """Nine levels of nine aliases are a billion values."""
    levels = [f'l{level}: &l{level} [{", ".join([f"*l{level - 1}"] * 9)}]' for level in range(1, 10)]
    assert problem_of('\n'.join(['l0: &l0 [x]', *levels])) == (
        'cannot be read: its aliases (*) make more than 1000000 values')


@pytest.mark.parametrize('opening, depth', [
    pytest.param('[', 2_400, marks=pytest.mark.deep), ('- ', 4_900), ('- ', 30_000), ('? ', 4_900), ('? ', 30_000),
    ('{a: ', 2_400), ('{a: ', 30_000)])
def test_nesting_of_any_kind_is_refused(problem_of, opening, depth):
    assert 'nested too deeply' in problem_of(f'a:\n  {opening * depth}')
