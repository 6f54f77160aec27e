# SPDX-License-Identifier: Apache-2.0
"""
Detects a temperature reading that does not follow the battery.

The model's expected change is integrated since the reading last moved. The heater's heat counts only as
far as its power was measured, because a heater that takes no power explains a cold battery.
"""

from __future__ import annotations

from itertools import dropwhile
from typing import NamedTuple

from bev_preheat.tunables import (
    BELOW_AMBIENT_K,
    LONGEST_GAP_S,
    STUCK_BESIDE_LAGS_K,
    STUCK_K,
    STUCK_LAGS_S,
    STUCK_WITHIN_S,
    UNMOVED_K,
)


class _Expected(NamedTuple):
    """An instant [s], and the change expected until then [K]."""

    instant_s: float
    change_k: float


class StuckTemperature(NamedTuple):
    """
    Whether the temperature follows the battery; `doubt` is the sentence, '' while it does.

    `reading_c` [deg C] is the latest reading, None: the next one does not follow it. `since_s` [s] is the instant
    since which it has not moved, `expected` the course expected since then.
    """

    doubt: str = ''
    reading_c: float | None = None
    since_s: float = 0.0
    expected: tuple[_Expected, ...] = ()
    has_ever_moved: bool = False

    def without_instants(self) -> StuckTemperature:
        """Return the watch that starts again at the next reading, without a doubt."""
        return StuckTemperature(has_ever_moved=self.has_ever_moved)

    def seen(self, instant_s: float, reading_c: float, step_k: float, rate_k_per_s: float,
             ambient_c: float | None) -> StuckTemperature:
        """
        Return the watch after another reading.

        Instant [s], reading and ambient temperature [deg C] (None: unknown), step of the sensor [K],
        rate at which the model expects the temperature to change [K/s].
        """
        before_c, expected = self.reading_c, self.expected
        begun = self._replace(reading_c=reading_c, since_s=instant_s, expected=(_Expected(instant_s, 0.0),))
        if ambient_c is not None and reading_c < ambient_c - BELOW_AMBIENT_K:
            return begun._replace(doubt=(
                f'temperature: {reading_c:.1f} degC is {ambient_c - reading_c:.1f} K below the ambient '
                f'temperature of {ambient_c:.1f} degC; at most {BELOW_AMBIENT_K:g} K are possible; '
                'the field may not be set'))
        if before_c is None:
            return begun._replace(doubt='')
        if abs(reading_c - before_c) > UNMOVED_K:
            return begun._replace(doubt='', has_ever_moved=True)
        elapsed_s = instant_s - expected[-1].instant_s
        if not 0.0 <= elapsed_s <= LONGEST_GAP_S:
            return begun
        expected = tuple(dropwhile(
            lambda each: each.instant_s < instant_s - STUCK_WITHIN_S,
            (*expected, _Expected(instant_s, expected[-1].change_k + rate_k_per_s * elapsed_s))))
        first, last = expected[0], expected[-1]
        change_k, elapsed_s = last.change_k - first.change_k, last.instant_s - first.instant_s
        held_back_k = STUCK_BESIDE_LAGS_K + (STUCK_LAGS_S * abs(change_k) / elapsed_s if elapsed_s > 0.0 else 0.0)
        if abs(change_k) <= max(STUCK_K, held_back_k) + step_k:
            return self._replace(expected=expected)
        still = f'for {instant_s - self.since_s:.0f} s' if self.has_ever_moved else 'since the first state'
        direction = 'warmed' if change_k > 0.0 else 'cooled'
        return self._replace(expected=expected, doubt=(
            f'temperature: has read {reading_c:.2f} degC {still}, while the battery must have '
            f'{direction} by {abs(change_k):.1f} K; the field may not be set'))
