# SPDX-License-Identifier: Apache-2.0
"""The problems that a function refuses its input for."""

import pytest

from bev_preheat.errors import InvalidInput


def problems_of(function, *arguments, **named):
    """Return the problems of the InvalidInput that a call raises."""
    with pytest.raises(InvalidInput) as refusal:
        function(*arguments, **named)
    return refusal.value.problems


def problems_in(path, function, *arguments, **named):
    """Return the problems of the InvalidInput that a call on a file raises, without the path that begins each."""
    problems = problems_of(function, *arguments, **named)
    assert all(problem.startswith(str(path)) for problem in problems), problems
    return [problem.removeprefix(str(path)) for problem in problems]
