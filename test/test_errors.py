# SPDX-License-Identifier: Apache-2.0
"""What came from outside, in messages: quoted, and never at length."""

import pytest

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.files.configuration import find_configuration


@pytest.mark.parametrize('text, expected', [
    ('home', "'home'"), ("it's\n", '"it\'s\\n"'), ('x' * 60, f"'{'x' * 60}'"),
    ('x' * 61, f"'{'x' * 60}' … (61 characters)")])
def test_a_long_text_is_quoted_by_its_beginning(text, expected):
    assert quoted(text) == expected


def test_a_long_text_keeps_its_ends():
    assert shortened('abcdefghij', 4) == 'ab … ij'
    assert shortened('abcd', 4) == 'abcd'


def test_messages_do_not_grow_with_what_they_are_about():
    error = InvalidInput([f'{"k" * 10_000}: {at} is not allowed' for at in range(1000)])
    assert len(str(error)) < 30_000
    assert (len(error.problems), error.problems[-1]) == (41, '960 more problems')
    assert error.problems[0].endswith('0 is not allowed')


@pytest.mark.parametrize('name', ['x' * 1_000_000, f'/{"x" * 1_000_000}', '/x' * 500_000])
def test_a_file_name_that_no_file_system_has_is_refused_in_few_words(name):
    with pytest.raises(InvalidInput) as refusal:
        find_configuration('vehicles', name, '.yaml')
    assert len(str(refusal.value)) < 1000
