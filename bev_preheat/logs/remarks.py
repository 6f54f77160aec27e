# SPDX-License-Identifier: Apache-2.0
"""Remarks on a log: one sentence a cause, with the number of its cases and the place of the first."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class _Cause:
    first: str
    noun: str
    count: int


class Remarks:
    """Collects the causes of remarks in the order in which they appear."""

    def __init__(self) -> None:
        """Start without any."""
        self._causes: dict[str, _Cause] = {}

    def add(self, cause: str, first: str, count: int = 1, noun: str = 'sample') -> None:
        """Add `count` cases of a cause; `first` is the sentence on the first case, with its place."""
        if cause in self._causes:
            self._causes[cause].count += count
        elif count:
            self._causes[cause] = _Cause(first, noun, count)

    def add_shared(self, cause: str, first: str, count: int, noun: str) -> None:
        """Add cases of a cause that channels share, such as a faulty line; the largest count is kept."""
        if cause in self._causes:
            self._causes[cause].count = max(self._causes[cause].count, count)
        else:
            self.add(cause, first, count, noun)

    def extend(self, other: Remarks) -> None:
        """Add the causes of others."""
        for cause, found in other._causes.items():
            self.add(cause, found.first, found.count, found.noun)

    def sentences(self) -> tuple[str, ...]:
        """Return a sentence for each cause."""
        return tuple(cause.first if cause.count == 1 else
                     f'{cause.first} (and {cause.count - 1} more {cause.noun}{"s" if cause.count > 2 else ""})'
                     for cause in self._causes.values())
