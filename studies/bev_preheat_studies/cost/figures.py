# SPDX-License-Identifier: Apache-2.0
"""A measured figure, and medians of repeated timings."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any


@dataclass(frozen=True)
class Figure:
    """A measured value; `bound` is its required bound, `sense` is '<=' or '>='."""

    what: str
    value: float
    unit: str
    bound: float | None = None
    sense: str = '<='

    @property
    def within(self) -> bool | None:
        """Return whether the bound is met; None without a bound."""
        if self.bound is None:
            return None
        return self.value <= self.bound if self.sense == '<=' else self.value >= self.bound

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {'what': self.what, 'value': self.value, 'unit': self.unit,
                'bound': self.bound, 'sense': self.sense, 'within': self.within}


def median_time_s(function: Callable[[], object], repetitions: int) -> float:
    """Return the median duration of a call [s]; a first call does not count."""
    function()
    durations_s = []
    for _ in range(repetitions):
        started = perf_counter()
        function()
        durations_s.append(perf_counter() - started)
    return median(durations_s)


def turns_s(first: Callable[[], object], second: Callable[[], object],
            rounds: int) -> tuple[float, float]:
    """Return the median durations of two alternating calls [s]; the first pair does not count."""
    durations_s: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds + 1):
        for call, own_s in zip((first, second), durations_s):
            started = perf_counter()
            call()
            own_s.append(perf_counter() - started)
    first_s, second_s = (median(own_s[1:]) for own_s in durations_s)
    return first_s, second_s
