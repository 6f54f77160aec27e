# SPDX-License-Identifier: Apache-2.0
"""Detection of a sensor's step from its readings."""

from collections.abc import Sequence

# Steps of temperature signals [K] and of state-of-charge signals (0 ... 1) in use.
TEMPERATURE_STEPS_K = (1.0, 0.5, 0.25, 0.2, 0.1)
SOC_STEPS = (0.01, 0.005, 0.004, 0.0025, 0.002, 0.001)
# Single precision, as in messages, preserves multiples to this share of the step.
ROUNDING = 1e-3
MOST_REMEMBERED = 50


class Resolution:
    """
    The coarsest step that divides all values so far; 0 if no step does.

    A signal counts as coarse until a value shows that it is finer.
    """

    def __init__(self, steps: Sequence[float]) -> None:
        """Start without values; `steps` are in descending order."""
        self._steps = steps
        self._seen: set[float] = set()
        self.step = steps[0]

    def see(self, value: float) -> None:
        """Update with a value."""
        if self.step == 0.0 or value in self._seen:
            return
        if len(self._seen) < MOST_REMEMBERED:
            self._seen.add(value)
        # All earlier values are multiples of the current step.
        if not _is_multiple(value, self.step):
            self.step = next((step for step in self._steps if step < self.step and all(
                _is_multiple(seen, step) for seen in (value, *self._seen))), 0.0)


def _is_multiple(value: float, step: float) -> bool:
    return abs(value / step - round(value / step)) <= ROUNDING
