# SPDX-License-Identifier: Apache-2.0
"""Finds the step in which a sensor reports, from what it reports."""

from collections.abc import Sequence

# Steps of temperature signals [K] and of state-of-charge signals (0 ... 1) in use.
TEMPERATURE_STEPS_K = (1.0, 0.5, 0.25, 0.2, 0.1)
SOC_STEPS = (0.01, 0.005, 0.004, 0.0025, 0.002, 0.001)
# Single precision, as messages have it, keeps multiples to this share of the step.
ROUNDING = 1e-3
MOST_REMEMBERED = 50


class Resolution:
    """
    The coarsest of some steps that all values so far are multiples of; 0 where there is none.

    A signal counts as coarse until a value shows that it is finer.
    """

    def __init__(self, steps: Sequence[float]) -> None:
        """Know nothing yet; `steps` fall."""
        self._steps = steps
        self._seen: set[float] = set()
        self.step = steps[0]

    def see(self, value: float) -> None:
        """Take a value into account."""
        if self.step == 0.0 or value in self._seen:
            return
        if len(self._seen) < MOST_REMEMBERED:
            self._seen.add(value)
        # All that was seen before is a multiple of the step so far.
        if not _is_multiple(value, self.step):
            self.step = next((step for step in self._steps if step < self.step and all(
                _is_multiple(seen, step) for seen in (value, *self._seen))), 0.0)


def _is_multiple(value: float, step: float) -> bool:
    return abs(value / step - round(value / step)) <= ROUNDING
