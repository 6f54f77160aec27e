# SPDX-License-Identifier: Apache-2.0
"""External input in messages: quoted and shortened."""

import pytest

from bev_preheat.errors import figure, figure_beyond, InvalidInput, quoted


@pytest.mark.parametrize('text, expected', [
    ('home', "'home'"), ("it's\n", '"it\'s\\n"'), ('x' * 60, f"'{'x' * 60}'"),
    ('x' * 61, f"'{'x' * 60}' … (61 characters)")])
def test_a_long_text_is_quoted_by_its_beginning(text, expected):
    assert quoted(text) == expected


def test_messages_do_not_grow_with_what_they_are_about():
    error = InvalidInput([f'{"k" * 10_000}: {at} is not allowed' for at in range(1000)])
    assert len(str(error)) < 2100
    assert (len(error.problems), error.problems[-1]) == (4, '997 more problems')
    assert error.problems[0].endswith('0 is not allowed')


def test_problems_that_differ_are_all_named_until_the_message_is_long():
    words = [f'key_{chr(ord("a") + at)}: {"is not allowed; " * 5}' for at in range(26)]
    assert InvalidInput(words[:20]).problems == words[:20]
    problems = InvalidInput(words * 10).problems
    assert len('; '.join(problems)) < 2100 and problems[-1] == f'{260 - len(problems) + 1} more problems'


@pytest.mark.parametrize('value, text', [
    (2e6, '2000000'), (-2e6, '-2000000'), (86400.0, '86400'), (0.001, '0.001'), (12.3456789, '12.3457'),
    (1e-7, '1e-07'), (3.4e38, '3.4e+38'), (float('inf'), 'inf'), (float('nan'), 'nan')])
def test_a_figure_is_written_as_a_person_writes_it(value, text):
    assert figure(value) == text


@pytest.mark.parametrize('value, text', [
    (2000000.4, '2000000.4'), (5e6, '5000000'), (-1e-9, '-1e-09')])
def test_a_figure_shows_that_it_is_beyond_its_limits(value, text):
    assert figure_beyond(value, 0.0, 2e6) == text
