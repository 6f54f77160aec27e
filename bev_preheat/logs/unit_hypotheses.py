# SPDX-License-Identifier: Apache-2.0
"""Units, scales and signs of bytes that may explain readings; one counts only if it is better than the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from bev_preheat.files.units import conversion, own_unit
from bev_preheat.logs.doubts import AGREEMENT, by_position, distances, integral
from bev_preheat.logs.recording import Series
from bev_preheat.logs.signal_map import Source
from bev_preheat.numerics import BoolArray, FloatArray

# Units that are tried, by the signal's own.
ALIKE = {'degC': ('degC', 'degF', 'kelvin'), '1': ('1', 'percent'), 'volt': ('volt', 'millivolt', 'kilovolt'),
         'ampere': ('ampere', 'milliampere'), 'watt': ('watt', 'kilowatt'),
         'meter': ('meter', 'kilometer', 'mile', 'foot'),
         'meter/second': ('meter/second', 'kilometer/hour', 'mile/hour'), 'degree': ('degree',)}
# Scales that are tried for readings that are implausible in every unit.
OTHER_SCALES = ((0.1, 0.01, 0.001), (10.0, 100.0, 1000.0))
# Share of the readings that a hypothesis must make plausible.
FITTING_SHARE = 0.99
# Usual values; a hypothesis counts if it has the median in this range: 14.2 V are no tenth of 142 V.
USUAL = {'battery_temperature_c': (-30.0, 55.0), 'ambient_c': (-35.0, 45.0), 'soc': (0.1, 1.0),
         'voltage_v': (150.0, 950.0), 'odometer_m': (1e5, 1e9)}
# The other temperature of the car, which a temperature is near to when a log begins. The best hypothesis must be
# within NEAR_OTHER_K, and nearer than each other one by APART_K.
OTHER = {'battery_temperature_c': 'ambient_c', 'ambient_c': 'battery_temperature_c'}
NEAR_OTHER_K, APART_K = 14.0, 14.0
# No temperature of a battery or of the air changes so much [K] within such a time [s].
JUMP_K, JUMP_S = 5.0, 30.0
# Share of steps that may be jumps, as of faulty readings.
MOST_JUMPS = 0.04
# A step that is so many times the usual one is a leap.
LEAP = 10.0
# Resolutions of a byte or a word that may have lost its sign.
STEPS_OF_BYTE, STEPS_OF_WORD = (1.0, 0.5), (1.0, 0.1, 0.01)
# Sensors outside have steps of 0.5 K.
SENSOR_STEP_K = 0.5


class Hypothesis(NamedTuple):
    """
    A way to read raw values: `unit` and `scale`.

    Values from half of `modulus` on are negative, as of a byte that was read without its sign (0: none are).
    """

    unit: str
    scale: float
    modulus: float = 0.0

    def words(self, given: Hypothesis) -> str:
        """Return the difference from the given way."""
        if self.modulus:
            return f'with values from {0.5 * self.modulus:g} on as negative ones (minus {self.modulus:g})'
        words = [f'the unit {self.unit}'] if self.unit != given.unit else []
        words += [f'a factor of {self.scale / given.scale:g}'] if self.scale != given.scale else []
        return f'with {" and ".join(words)}'

    def own(self, numbers: FloatArray, source: Source) -> FloatArray:
        """Return raw values in the signal's own unit."""
        if self.modulus:
            numbers = np.where(numbers >= 0.5 * self.modulus, numbers - self.modulus, numbers)
        wanted = own_unit(source.signal)
        # A damaged number may be too large for any unit; it is implausible then.
        with np.errstate(over='ignore', invalid='ignore'):
            own: FloatArray = source.in_own_unit(numbers, self.scale, conversion(self.unit or wanted, wanted))
        return own

    def fits(self, numbers: FloatArray, source: Source, share: float = FITTING_SHARE) -> bool:
        """Return whether a share of the finite raw values is plausible; zeros show nothing."""
        finite = numbers[np.isfinite(numbers) & (numbers != 0.0)]
        return not finite.size or bool(np.mean(plausible(self.own(finite, source), source)) >= share)


def plausible(own: FloatArray, source: Source) -> BoolArray:
    """Return which values in the signal's own unit are plausible, but for rounding of the unit's conversion."""
    low, high = source.plausible
    inside: BoolArray = (own >= low - 1e-9 * abs(low)) & (own <= high + 1e-9 * abs(high))
    return inside


def hypotheses(numbers: FloatArray, given: Hypothesis, source: Source) -> tuple[Hypothesis, ...]:
    """Return the Hypotheses that make raw values plausible, which are not so as `given`."""
    found = list(_signs(numbers, given, source))
    if not given.fits(numbers, source, 0.5):
        found += [Hypothesis(unit, given.scale) for unit in ALIKE[own_unit(source.signal)]
                  if unit != (given.unit or own_unit(source.signal))]
        # Smart batteries count tenths of a kelvin.
        found += [Hypothesis('kelvin', 0.1 * given.scale)] * source.signal.endswith('_c')
        # Of the smaller and of the larger ones, the first that fits; those beyond it fit for nothing.
        # A temperature that never changes is a code, such as the least value of its bits.
        is_code = source.signal.endswith('_c') and np.ptp(numbers[np.isfinite(numbers)]) == 0.0
        for scales in () if is_code else OTHER_SCALES:
            scaled = (given._replace(scale=given.scale * scale) for scale in scales)
            found += [each for each in scaled if each.fits(numbers, source)][:1]
        # Battery managers count halves of a percent in a byte.
        found += [given._replace(scale=0.5 * given.scale)] * (source.signal == 'soc')
    return tuple(each for each in found if each.fits(numbers, source))


def _signs(numbers: FloatArray, given: Hypothesis, source: Source) -> Iterator[Hypothesis]:
    finite = numbers[np.isfinite(numbers)]
    if not source.signal.endswith(('_c', '_a')) or not finite.size or finite.min() < 0.0:
        return
    for size, steps in ((256.0, STEPS_OF_BYTE), (65536.0, STEPS_OF_WORD)):
        for step in steps:
            counts = finite / step
            if np.abs(counts - np.round(counts)).max() < 1e-3 and 0.5 * size <= counts.max() < size:
                yield given._replace(modulus=size * step)


def jumps(series: Series) -> BoolArray:
    """Return which steps of a temperature are such as no battery and no air makes, shape (N - 1,)."""
    steps: BoolArray = (np.diff(series.time_s) <= JUMP_S) & (np.abs(np.diff(series.value)) > JUMP_K)
    return steps


def likely(found: tuple[Hypothesis, ...], raw: Series, source: Source,
           signals: Mapping[str, Series]) -> tuple[Hypothesis, ...]:
    """Return those of several Hypotheses on raw values that remain beside the car's other signals."""
    own = {each: each.own(raw.value, source) for each in found if each.fits(raw.value, source)}
    kept = list(own)
    if source.signal in OTHER:
        # A faulty reading of 250 in a log of 20 degC is no negative one.
        kept = [each for each in kept if not each.modulus or jumps(Series(raw.time_s, own[each])).sum()
                <= MOST_JUMPS * (raw.value >= 0.5 * each.modulus).sum()]
        leaps = {each: _leaps(own[each]) for each in kept}
        kept = [each for each in kept if leaps[each] == min(leaps.values())]
        steps_in = _unit_by_steps(raw.value)
        kept = [each for each in kept if steps_in in ('', each.unit or own_unit(source.signal))] or kept
    if (raw.value != np.round(raw.value)).any():
        # Values without a scale are whole numbers.
        kept = [each for each in kept if each.scale == found[0].scale] or kept
    if source.signal in USUAL:
        low, high = USUAL[source.signal]
        kept = [each for each in kept if low <= np.median(own[each]) <= high]
    position = by_position(signals) if source.signal in ('speed_mps', 'odometer_m') and len(kept) > 1 else None
    if position is not None:
        kept = [each for each in kept if _agrees(source.signal, Series(raw.time_s, own[each]), position)] or kept
    other = signals.get(OTHER.get(source.signal, ''))
    if other is not None and len(kept) > 1:
        far_k = {each: abs(float(np.median(own[each][:20]) - np.median(other.value[:20]))) for each in kept}
        best, second = sorted(kept, key=far_k.__getitem__)[:2]
        if far_k[best] <= NEAR_OTHER_K and far_k[second] - far_k[best] >= APART_K:
            return (best,)
    return tuple(kept)


def _agrees(signal: str, series: Series, position: Series) -> bool:
    """Return whether a speed or an odometer gives the distance by position."""
    series = series.part(np.argsort(series.time_s, kind='stable'))
    driven = Series(series.time_s, integral(series)) if signal == 'speed_mps' else series
    found = distances(driven, position)
    return found is not None and abs(found[0] / found[1] - 1.0) < AGREEMENT


def _leaps(values: FloatArray) -> int:
    """Return the number of steps that are far larger than most, in any unit."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-9]
    return int((steps > LEAP * np.median(steps)).sum()) if steps.size else 0


def _unit_by_steps(numbers: FloatArray) -> str:
    """Return the unit in which temperatures have the usual steps of a sensor, '' if that is not clear."""
    steps = {'degC': numbers / SENSOR_STEP_K, 'degF': (numbers - 32.0) / (1.8 * SENSOR_STEP_K)}
    on_grid = [unit for unit, counts in steps.items() if np.abs(counts - np.round(counts)).max() < 0.06]
    # Whole numbers may have been rounded.
    return on_grid[0] if len(on_grid) == 1 and (numbers != np.round(numbers)).any() else ''
