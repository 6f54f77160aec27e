# SPDX-License-Identifier: Apache-2.0
"""The package's own exceptions, and how messages quote external input."""

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
import math
import re

# Messages go to logs, diagnostics and topics; their length does not grow with the input.
LONGEST_PROBLEM = 600
LONGEST_MESSAGE = 2000
# Largest number of sentences that differ only in numbers and quotations.
MOST_ALIKE = 3
DETAILS = re.compile(r"'[^']*'|[0-9]+")
LONGEST_QUOTE = 60
# Numbers from here on have an exponent.
MOST_WRITTEN_OUT = 1e12
# A share from this value on is probably in per cent.
LEAST_PERCENT = 5.0


class InvalidInput(ValueError):
    """Refused input; the message names field, value and allowed range."""

    def __init__(self, problems: str | Iterable[str]) -> None:
        """
        Take one sentence, or several; long ones are shortened.

        The first few are included, and a last sentence gives the number of the others.
        """
        problems = [problems] if isinstance(problems, str) else list(problems)
        self.problems = _first_of(problems)
        others = len(problems) - len(self.problems)
        if others:
            self.problems.append(f'{others} more problem{"s" if others > 1 else ""}')
        super().__init__('; '.join(self.problems))


@contextmanager
def located(where: object) -> Iterator[None]:
    """Name a file, field or option in each problem of an InvalidInput."""
    try:
        yield
    except InvalidInput as error:
        raise type(error)([f'{where}: {problem}' for problem in error.problems]) from error


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
    """The model gives infinite or undefined numbers, so no plan can be made from this input."""


def shortened(text: str, longest: int) -> str:
    """Return a text, with its middle omitted if it has more than `longest` characters."""
    if len(text) <= longest:
        return text
    kept = longest // 2
    return f'{text[:kept]} … {text[-kept:]}'


def figure(value: float, digits: int = 6) -> str:
    """Return a number with `digits` significant digits, without an exponent: 2000000, not 2e+06."""
    text = f'{value:.{digits}g}'
    return f'{value:.0f}' if 'e+' in text and abs(value) < MOST_WRITTEN_OUT else text


def figure_beyond(value: float, low: float, high: float) -> str:
    """Return a number outside `low` ... `high` with six digits, or more if needed to show that."""
    for digits in (6, 9, 12):
        text = figure(value, digits)
        if not low <= float(text) <= high:
            return text
    return repr(value)


def range_problem(name: str, value: float, low: float, high: float, unit: str = '', more: str = '') -> str:
    """Return the sentence on a value outside `low` ... `high` (inf: no upper limit), followed by `more`."""
    allowed = f'at least {figure(low)}' if high == math.inf else f'{figure(low)} ... {figure(high)}'
    return f'{name}: {figure_beyond(value, low, high)} is not allowed; it must be {allowed} {unit}'.rstrip() + more


def share_hint(value: float) -> str:
    """Return a question on a share of 0 ... 1 that seems to be in per cent, '' for any other value."""
    return f'; {value / 100.0:g}?' if LEAST_PERCENT <= value <= 100.0 else ''


def age_beyond(age_s: float, ahead_s: float, oldest_s: float) -> str:
    """Return a sentence on an age [s] outside -`ahead_s` ... `oldest_s`, with the allowed range."""
    if age_s < 0.0:
        return (f'{figure_beyond(-age_s, 0.0, ahead_s)} s ahead of the clock; at most {ahead_s:g} s are allowed')
    return f'{figure_beyond(age_s, 0.0, oldest_s)} s old; at most {oldest_s:g} s are allowed'


def quoted(text: str) -> str:
    """Return external text in quotes; long text is cut, with its length."""
    if len(text) <= LONGEST_QUOTE:
        return repr(text)
    return f'{text[:LONGEST_QUOTE]!r} … ({len(text)} characters)'


def one_line(text: str) -> str:
    """Return a text with line breaks and other control characters escaped as in Python."""
    return ''.join(character if character.isprintable() or character == ' ' else
                   character.encode('unicode_escape', 'surrogatepass').decode()
                   for character in text)
