# SPDX-License-Identifier: Apache-2.0
"""The steps of the sensors, and the plausibility of the battery readings: when the estimate begins again."""

from __future__ import annotations

from enum import Enum
from itertools import dropwhile
import math
from typing import NamedTuple, Protocol, TYPE_CHECKING

from bev_preheat.numerics import NS_PER_S
from bev_preheat.tunables import (
    COUNTED_READINGS,
    EXCURSION_DEVIATIONS,
    IMPLAUSIBLE_DEVIATIONS,
    LARGEST_EXCURSION_K,
    LEAST_SOC_DEVIATION,
    LONGEST_EXCURSION_S,
    LONGEST_SPIKE_S,
    READING_NOISE_K,
    RETURN_DEVIATIONS,
    SINGLE_PRECISION,
)

if TYPE_CHECKING:
    from bev_preheat.planning.situation import BatteryState

# Steps of temperature signals [K] and of state-of-charge signals (0 ... 1) in use.
TEMPERATURE_STEPS_K = (1.0, 0.5, 0.25, 0.2, 0.1)
SOC_STEPS = (0.01, 0.005, 0.004, 0.0025, 0.002, 0.001)
MOST_REMEMBERED = 50
# Reading, step of the signal, least standard deviation.
Look = tuple[float, float, float]
# Mean and variance of an expected reading.
Expected = tuple[float, float]


class Resolution(NamedTuple):
    """
    The coarsest step that divides all values so far; 0 if no step does.

    A signal counts as coarse until a value shows that it is finer. `steps` are those that are left, in descending
    order; `values` are values so far.
    """

    steps: tuple[float, ...]
    values: tuple[float, ...] = ()

    @property
    def step(self) -> float:
        """The step; 0 for none."""
        return self.steps[0] if self.steps else 0.0

    def seen(self, value: float) -> Resolution:
        """Return the Resolution with another value."""
        steps, values = self.steps, self.values
        if not steps or value in values:
            return self
        if len(values) < MOST_REMEMBERED:
            values = (*values, value)
        # All earlier values are multiples of the current step.
        if not _is_multiple(value, steps[0]):
            steps = tuple(dropwhile(lambda step: not all(
                _is_multiple(seen, step) for seen in (value, *values)), steps[1:]))
        return Resolution(steps, values)


def _is_multiple(value: float, step: float) -> bool:
    return abs(value / step - round(value / step)) <= SINGLE_PRECISION


class MeasuredState(Protocol):
    """A measurement at an instant [ns]; `power_w` is None if it was not measured."""

    @property
    def stamp_ns(self) -> int:
        """Instant of the measurement [ns]."""

    @property
    def state(self) -> BatteryState:
        """Temperature and state of charge."""

    @property
    def power_w(self) -> float | None:
        """Terminal power of the battery [W]."""


class Verdict(Enum):
    """Result of checking a reading."""

    BELIEVED = 'is what is expected'
    EXCURSION = 'is a temperature that has left its expected value for a short time'
    LASTING = 'is a temperature that has left its expected value for longer than an excursion lasts'
    DOUBTED = 'is too far off, for a moment so far'
    JUMPED = 'is too far off, and has been for longer than a spike lasts'


class ReadingCheck(NamedTuple):
    """
    The steps of the signals, and the readings that were not as expected.

    `doubted` is the first of the rejected readings that agree, None: none. The current excursion began at
    `excursion_ns` [ns]; None: the temperature is as expected. `ignored`: whether each of the latest readings was.
    """

    temperature_steps: Resolution = Resolution(TEMPERATURE_STEPS_K)
    soc_steps: Resolution = Resolution(SOC_STEPS)
    doubted: MeasuredState | None = None
    excursion_ns: int | None = None
    ignored: tuple[bool, ...] = ()

    @property
    def ignored_share(self) -> float:
        """Share of the latest readings that were ignored, 0 ... 1."""
        return sum(self.ignored) / len(self.ignored) if self.ignored else 0.0

    def seen(self, state: BatteryState) -> ReadingCheck:
        """Return the check with the steps after a reading; call it for every reading, before `judged`."""
        temperature_steps = self.temperature_steps.seen(state.temperature_c)
        soc_steps = self.soc_steps.seen(state.soc)
        return self if (temperature_steps, soc_steps) == (self.temperature_steps, self.soc_steps) else (
            self._replace(temperature_steps=temperature_steps, soc_steps=soc_steps))

    def judged(self, measurement: MeasuredState,
               expected: tuple[Expected, Expected]) -> tuple[ReadingCheck, Verdict]:
        """Return the check after a MeasuredState, and the Verdict; `expected` temperature [deg C] and charge."""
        looks = self._looks_at(measurement.state)
        excursion_ns, verdict = self._excursion(measurement.stamp_ns, looks[0], expected[0])
        doubted = None
        if verdict is None:
            is_plausible = all(
                abs(reading - mean) <= 0.5 * step + IMPLAUSIBLE_DEVIATIONS * max(
                    math.sqrt(max(variance, 0.0)), least)
                for (reading, step, least), (mean, variance) in zip(looks, expected))
            first = self.doubted if self.doubted is not None and self._agree(
                self.doubted.state, measurement.state) else measurement
            doubted = None if is_plausible else first
            has_lasted = measurement.stamp_ns - first.stamp_ns >= LONGEST_SPIKE_S * NS_PER_S
            verdict = Verdict.BELIEVED if is_plausible else Verdict.JUMPED if has_lasted else Verdict.DOUBTED
        is_ignored = verdict not in (Verdict.BELIEVED, Verdict.LASTING)
        return ReadingCheck(self.temperature_steps, self.soc_steps, doubted, excursion_ns,
                            (*self.ignored, is_ignored)[-COUNTED_READINGS:]), verdict

    def _excursion(self, stamp_ns: int, look: Look, expected: Expected) -> tuple[int | None, Verdict | None]:
        """Return start [ns] and Verdict of a temperature in an excursion, or after one; None: no excursion."""
        (reading, step, least), (mean, variance) = look, expected
        beyond_k = abs(reading - mean) - 0.5 * step
        deviations = EXCURSION_DEVIATIONS if self.excursion_ns is None else RETURN_DEVIATIONS
        if not deviations * max(math.sqrt(max(variance, 0.0)), least) < beyond_k <= LARGEST_EXCURSION_K:
            return None, None
        since_ns = stamp_ns if self.excursion_ns is None else self.excursion_ns
        if stamp_ns - since_ns < LONGEST_EXCURSION_S * NS_PER_S:
            return since_ns, Verdict.EXCURSION
        return None, Verdict.LASTING

    def _agree(self, one: BatteryState, other: BatteryState) -> bool:
        """Whether two rejected readings agree."""
        return all(
            abs(reading - before) <= step + IMPLAUSIBLE_DEVIATIONS * least
            for (before, _, _), (reading, step, least) in zip(
                self._looks_at(one), self._looks_at(other)))

    def _looks_at(self, state: BatteryState) -> tuple[Look, Look]:
        """Return (reading, step of the signal, least standard deviation) of both readings."""
        return ((state.temperature_c, self.temperature_steps.step, READING_NOISE_K),
                (state.soc, self.soc_steps.step, LEAST_SOC_DEVIATION))
