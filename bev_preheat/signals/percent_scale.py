# SPDX-License-Identifier: Apache-2.0
"""
Detects a state of charge in per cent: near empty its values lie within 0 ... 1.

Values above 1 are refused. A value below 1 that follows them has the same scale, unless it continues the
last valid value.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# A value has the scale of the one before if they are at most this far apart [s].
FOLLOWS_WITHIN_S = 600.0
# A value this near to the last valid one continues it.
GOES_ON_WITHIN = 0.1


class PercentScale:
    """Remembers the latest percentages, including refused ones."""

    def __init__(self) -> None:
        """Start without values."""
        self._latest: float | None = None
        self._latest_s = 0.0
        self._valid: float | None = None

    def note_refused(self, instant_s: float, percentage: float) -> None:
        """Note a percentage that was refused at an instant [s]; one above 1 is on a scale of 100."""
        if 1.0 < percentage <= 100.0:
            self._latest, self._latest_s = percentage, instant_s

    def doubt(self, instant_s: float, soc: float, is_vouched_for: Callable[[], bool]) -> str:
        """
        Return the sentence on a state of charge that is on a scale of 100; '' if it is not.

        `is_vouched_for()`: the voltage fits the value better than a hundredth of this value.
        """
        before = self._latest
        goes_on = self._valid is not None and abs(soc - self._valid) <= GOES_ON_WITHIN
        if (before is None or goes_on or soc == 0.0
                or not 0.0 <= instant_s - self._latest_s <= FOLLOWS_WITHIN_S or is_vouched_for()):
            self._latest, self._valid = None, soc
            return ''
        self._latest_s = instant_s
        return (f'percentage: {soc:g} follows {before:g}, which is on a scale of 100; expected 0 ... 1: '
                f'{soc / 100:g}?')
