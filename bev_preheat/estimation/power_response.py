# SPDX-License-Identifier: Apache-2.0
"""
Whether the battery's power answers when the heater is switched.

A single look at the power says little, as traffic moves it too. So the step at each switching is held
against the steps that the same windows see while nothing is switched: how far those scatter is how
far this one may be wrong. Heaters ramp up, so the second window begins a while after the switching.
"""

from collections import deque
import math
from typing import NamedTuple

# Windows before and after a switching [s], and how far apart their ends are.
WINDOW_S = 10.0
APART_S = 30.0
# A heater may take so long to come to the power that is commanded, and is not looked at meanwhile.
RAMP_S = 10.0
# Samples that each window must have, and quiet steps that must have been seen.
LEAST_SAMPLES = 2
LEAST_STEPS = 8
# Steps of the command below this are no switching [W].
LEAST_SWITCHED_W = 1000.0
# What the sensors and other consumers make uncertain in any case [W].
FLOOR_W = 150.0
# Quiet steps are forgotten at this rate.
FORGETTING = 0.03
# Instant [s], power [W], command [W].
Sample = tuple[float, float, float]


class Answer(NamedTuple):
    """Share of a switched power that was seen in the battery's, and its standard deviation."""

    share: float
    deviation: float


class PowerResponse:
    """Watches the battery's terminal power and the heater's command."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._samples: deque[Sample] = deque()
        self._variance_w2, self._steps = 0.0, 0
        self._next_s = -math.inf

    def see(self, instant_s: float, power_w: float, command_w: float) -> Answer | None:
        """
        Take a sample in; return an Answer where one is due, else None.

        Instants [s] rise. Every window is looked at once, so an answer is given once.
        """
        samples = self._samples
        if samples and instant_s - samples[-1][0] > WINDOW_S:
            samples.clear()
        samples.append((instant_s, power_w, command_w))
        while samples and samples[0][0] < instant_s - APART_S - WINDOW_S:
            samples.popleft()
        if (instant_s < self._next_s
                or samples[0][0] > instant_s - APART_S - 0.5 * WINDOW_S):
            return None
        before = [sample for sample in samples if sample[0] <= instant_s - APART_S]
        after = [sample for sample in samples if sample[0] > instant_s - WINDOW_S]
        if min(len(before), len(after)) < LEAST_SAMPLES:
            return None
        settled = [sample for sample in samples if sample[0] > instant_s - WINDOW_S - RAMP_S]
        commands_w = [{sample[2] for sample in window} for window in (before, settled)]
        if any(max(window) - min(window) > FLOOR_W for window in commands_w):
            return None
        step_w = _mean(before, after, 1)
        switched_w = _mean(before, after, 2)
        self._next_s = instant_s + WINDOW_S
        if abs(switched_w) < LEAST_SWITCHED_W:
            self._steps += 1
            share = max(FORGETTING, 1.0 / self._steps)
            self._variance_w2 += share * (step_w**2 - self._variance_w2)
            return None
        if self._steps < LEAST_STEPS:
            return None
        # The same switching must not be answered by the next windows.
        self._next_s = instant_s + APART_S + WINDOW_S
        deviation_w = math.sqrt(self._variance_w2 + FLOOR_W**2)
        return Answer(step_w / switched_w, deviation_w / abs(switched_w))


def _mean(before: list[Sample], after: list[Sample], column: int) -> float:
    """Mean of a column after minus before."""
    return (sum(sample[column] for sample in after) / len(after)
            - sum(sample[column] for sample in before) / len(before))
