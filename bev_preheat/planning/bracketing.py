# SPDX-License-Identifier: Apache-2.0
"""
Searches between two values, one too high and one too low, and for the least of several minima.

Each trial is a simulated drive or step, so the number of trials is the cost of a search.
(Planning never loads SciPy, whose solvers return the value but not the outcome of its trial.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from operator import attrgetter
from typing import Generic, TypeVar

from bev_preheat.tunables import HALVINGS, MOST_TRIALS, REFINED_MINIMA

Outcome = TypeVar('Outcome')
# Each trial of the golden section reduces the bracket to this share.
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class Trial(Generic[Outcome]):
    """A trial value, its outcome, and its excess over the requirement."""

    value: float
    excess: float
    outcome: Outcome


def halve(enough: float, too_little: float, is_enough: Callable[[float], bool],
          halvings: int = HALVINGS) -> float:
    """
    Return the value nearest to `too_little` that is still enough, to 2^-halvings of the bracket.

    `enough` is known to be enough and `too_little` not; values in between are unknown.
    """
    for _ in range(halvings):
        middle = 0.5 * (enough + too_little)
        if is_enough(middle):
            enough = middle
        else:
            too_little = middle
    return enough


def close_in(enough: Trial[Outcome], too_little: Trial[Outcome],
             attempt: Callable[[float], Trial[Outcome]], tolerance: float, most_trials: int) -> Trial[Outcome]:
    """
    Return the Trial that is just enough: its excess is in 0 ... `tolerance`, unless `most_trials` are too few.

    For an excess that is almost proportional to the value: the next value is where the straight line between both
    ends has half the tolerance as its excess. If one end stays for a second trial, its excess is scaled down by
    the decrease of the other end's (Anderson and Bjorck), because otherwise the other end would creep.
    """
    aim = 0.5 * tolerance
    more, less = enough.excess - aim, too_little.excess - aim
    was_enough: bool | None = None
    for _ in range(most_trials):
        if enough.excess <= tolerance:
            break
        trial = attempt(too_little.value + less / (less - more) * (enough.value - too_little.value))
        excess, is_enough = trial.excess - aim, trial.excess >= 0.0
        if is_enough:
            less *= _left(excess, more) if was_enough is True else 1.0
            enough, more = trial, excess
        else:
            more *= _left(excess, less) if was_enough is False else 1.0
            too_little, less = trial, excess
        was_enough = is_enough
    return enough


def _left(excess: float, before: float) -> float:
    """Return the factor for the excess of the end that stays, from the other end's excess now and before."""
    left = 1.0 - excess / before if before != 0.0 else 0.0
    return left if left > 0.0 else 0.5


def follow_slope(most: float, least: float, first: Trial[Outcome], slope: float,
                 attempt: Callable[[float], Trial[Outcome]], tolerance: float,
                 resolution: float = 0.0) -> Trial[Outcome]:
    """
    Return the Trial whose excess is within `tolerance` of 0, from a first one and its slope.

    For a smooth excess that is greatest at the value `most` and falls towards `least`: a secant, kept within the
    bracket. If even `most` is not enough, its Trial is returned. The search also ends when values differ by no
    more than `resolution`, and after MOST_TRIALS.
    """
    direction = 1.0 if most > least else -1.0
    enough, too_little, trial = most, least, first
    for _ in range(MOST_TRIALS):
        if abs(trial.excess) <= tolerance or (trial.value == most and trial.excess < 0.0):
            break
        if trial.excess > 0.0:
            enough = trial.value
        else:
            too_little = trial.value
        following = trial.value - trial.excess / slope if slope * direction > 0.0 else math.nan
        if enough == most and (following - most) * direction >= 0.0:
            # Whether the utmost is enough is unknown until it is tried.
            following = most
        elif not min(enough, too_little) < following < max(enough, too_little):
            following = 0.5 * (enough + too_little)
        if abs(following - trial.value) <= resolution:
            break
        before, trial = trial, attempt(following)
        slope = (trial.excess - before.excess) / (trial.value - before.value)
    return trial


def least_of(low: float, high: float, attempt: Callable[[float], Trial[Outcome]],
             resolution: float) -> Trial[Outcome]:
    """Return the Trial of least excess between two values to a resolution: golden section, for one minimum."""
    nearer, further = (attempt(low + share * (high - low)) for share in (1.0 - GOLDEN, GOLDEN))
    by_excess = attrgetter('excess')
    best = min(nearer, further, key=by_excess)
    while high - low > resolution:
        if nearer.excess <= further.excess:
            high, further = further.value, nearer
            nearer = following = attempt(low + (1.0 - GOLDEN) * (high - low))
        else:
            low, nearer = nearer.value, further
            further = following = attempt(low + GOLDEN * (high - low))
        best = min(best, following, key=by_excess)
    # The minimum may be at an end, which the section only approaches.
    for end in (low, high):
        best = min(best, attempt(end), key=by_excess)
    return best


def scan(grid: Sequence[float], cost_at: Callable[[float], float], resolution: float) -> None:
    """Try the values of a grid, then those around its lowest minima, to a resolution."""
    for place in minima([cost_at(value) for value in grid])[:REFINED_MINIMA]:
        refine(grid, place, cost_at, resolution)


def minima(costs: Sequence[float]) -> list[int]:
    """Return the places of the local minima of a sequence, the lowest first; infinite values do not count."""
    places, before = [], math.inf
    for place, cost in enumerate(costs):
        # A plateau counts once, at its beginning.
        after = next((other for other in costs[place + 1:] if other != cost), math.inf)
        if cost < before and cost < after:
            places.append(place)
        before = cost
    return sorted(places, key=lambda place: costs[place])


def refine(grid: Sequence[float], place: int, cost_at: Callable[[float], float], resolution: float) -> None:
    """Try values on both sides of a grid point, to a resolution of the lowest cost between."""
    low, high = grid[max(place - 1, 0)], grid[min(place + 1, len(grid) - 1)]
    if high > low:
        least_of(low, high, lambda value: Trial(value, cost_at(value), None), resolution)
