# SPDX-License-Identifier: Apache-2.0
"""The exceptions that the package raises on purpose, and how they quote what came from outside."""

from collections import Counter
from collections.abc import Iterable
import re

# Messages go to logs, diagnostics and topics: none grows with the input that it is about.
LONGEST_PROBLEM = 600
LONGEST_MESSAGE = 2000
# At most this many sentences are kept that differ in numbers and quotations only.
MOST_ALIKE = 3
DETAILS = re.compile(r"'[^']*'|[0-9]+")
LONGEST_QUOTE = 60
# From here on a number is written with an exponent.
MOST_WRITTEN_OUT = 1e12


class InvalidInput(ValueError):
    """Input that was refused at the door; the message names field, value and what is allowed."""

    def __init__(self, problems: str | Iterable[str]) -> None:
        """
        Take one sentence, or several; long ones are shortened.

        The first few of many are kept, and a last sentence gives the number of the others.
        """
        problems = [problems] if isinstance(problems, str) else list(problems)
        self.problems = _first_of(problems)
        others = len(problems) - len(self.problems)
        if others:
            self.problems.append(f'{others} more problem{"s" if others > 1 else ""}')
        super().__init__('; '.join(self.problems))


def _first_of(problems: Iterable[str]) -> list[str]:
    """Return the first few of each kind, shortened, up to LONGEST_MESSAGE."""
    kept, alike, length = [], Counter[str](), 0
    for problem in problems:
        sentence = shortened(problem, LONGEST_PROBLEM)
        kind = DETAILS.sub('', sentence)
        alike[kind] += 1
        if alike[kind] > MOST_ALIKE or length + len(sentence) > LONGEST_MESSAGE:
            continue
        length += len(sentence) + len('; ')
        kept.append(sentence)
    return kept


class PlanningFailure(ArithmeticError):
    """The model left the range of numbers: no plan can be made from this input."""


def shortened(text: str, longest: int) -> str:
    """Return a text with its middle left out where it has more than `longest` characters."""
    if len(text) <= longest:
        return text
    kept = longest // 2
    return f'{text[:kept]} … {text[-kept:]}'


def figure(value: float, digits: int = 6) -> str:
    """Return a number with so many digits as a person writes it: 2000000, not 2e+06."""
    text = f'{value:.{digits}g}'
    return f'{value:.0f}' if 'e+' in text and abs(value) < MOST_WRITTEN_OUT else text


def figure_beyond(value: float, low: float, high: float) -> str:
    """Return a number that is not within `low` and `high` with six digits, or more until that shows."""
    for digits in (6, 9, 12):
        text = figure(value, digits)
        if not low <= float(text) <= high:
            return text
    return repr(value)


def age_beyond(age_s: float, ahead_s: float, oldest_s: float) -> str:
    """Return in words an age [s] that is not within -`ahead_s` and `oldest_s`, and what is allowed."""
    if age_s < 0.0:
        return (f'{figure_beyond(-age_s, 0.0, ahead_s)} s ahead of the clock; at most {ahead_s:g} s are '
                'allowed')
    return f'{figure_beyond(age_s, 0.0, oldest_s)} s old; at most {oldest_s:g} s are allowed'


def quoted(text: str) -> str:
    """Return a text from outside in quotes; of a long one only the beginning, and its length."""
    if len(text) <= LONGEST_QUOTE:
        return repr(text)
    return f'{text[:LONGEST_QUOTE]!r} … ({len(text)} characters)'
