# SPDX-License-Identifier: Apache-2.0
"""Decodes readings of a channel into a signal: validity, scale, sign, unit. Knows nothing of files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.logs.cell_numbers import read_numbers, unit_in_cells
from bev_preheat.logs.units import ALIKE, check_unit, Conversion, conversion, own_unit

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import Source
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray

# The state of charge of a battery in use; a scale that gives less does not fit.
LEAST_PLAUSIBLE_SOC = 0.02
# Units for readings that have none, by their size: a share of charge exceeds 1.01 only as a percentage; a drive
# needs
# more than LARGEST_KW watts at some instant, and fewer kilowatts; loggers for people write km/h.
LARGEST_SHARE, LARGEST_KW = 1.01, 600.0
# Scales that are tried for readings that are implausible in every unit.
OTHER_SCALES = (0.1, 0.01, 0.001, 10.0, 100.0, 1000.0)
# Share of the readings that a scale must make plausible.
FITTING_SHARE = 0.9


class Decoder:
    """
    Decodes one channel for one Source.

    The unit is the map's, else the channel's, else the one behind the first readings, else the signal's own; the
    scale is chosen by the first readings. `unit` says which unit was used.
    """

    def __init__(self, source: Source, channel: str, channel_unit: str, decimal: str = '.',
                 repair: bool = False) -> None:
        """
        Take the unit in which the log says that the channel is ('' if it does not).

        With `repair` another unit or power of ten is used if only that makes the readings plausible.
        """
        self.source, self.channel = source, channel
        self.unit = source.unit or _fitting(channel_unit, source.signal)
        self._decimal, self._scale, self._repair = decimal, source.scales[0], repair
        self._conversion: Conversion | None = None

    def decode(self, values: FloatArray | Sequence[str], places: IntArray, remarks: Remarks,
               where: str) -> FloatArray:
        """
        Return readings in the signal's unit, shape (N,), NaN for each that is no reading or implausible.

        Remarks name the first dropped reading of each cause: `where` followed by its place.
        """
        angle = self.source.signal.endswith('_deg')
        if isinstance(values, np.ndarray):
            numbers, wrong = values.astype(float), np.zeros(len(values), dtype=bool)
        else:
            numbers, wrong = read_numbers(values, self._decimal, angle)
            if wrong.any():
                first = quoted(str(values[int(np.argmax(wrong))]))
                self._dropped(remarks, 'text', f'{first} is not a number', wrong, places, where)
            if self._conversion is None and not self.unit:
                self.unit = _fitting(unit_in_cells(values[:100]), self.source.signal)
        numbers = np.where(np.isfinite(numbers), numbers, np.nan)
        for nothing in self.source.no_reading:
            none = np.abs(numbers - nothing) <= 1e-9 * max(abs(nothing), 1.0)
            self._dropped(remarks, f'none {nothing:g}', f'{nothing:g} means no reading', none, places, where)
            numbers[none] = np.nan
        if self._conversion is None:
            if not np.isfinite(numbers).any():
                return numbers
            self._choose(numbers, remarks, where.rpartition(',')[0])
        own = self._converted(numbers)
        low, high = self.source.plausible
        bad = (own < low) | (own > high)
        if bad.any():
            at = int(np.argmax(bad))
            # Rounding of the unit's conversion.
            bad &= (own < low - 1e-9 * abs(low)) | (own > high + 1e-9 * abs(high))
            self._dropped(remarks, 'range', f'{figure(numbers[at])} is implausible '
                                            f'({self._range()})', bad, places, where)
        return np.where(bad, np.nan, own)

    def _choose(self, numbers: FloatArray, remarks: Remarks, path: str) -> None:
        """Choose unit and scale by the first readings, which are finite or NaN."""
        if not self.unit:
            self.unit = _usual_unit(self.source.signal, numbers[np.isfinite(numbers)])
            if self.unit:
                remarks.add(f'unit {self.channel}', f'{path}: {self.channel}: has no unit; its readings are '
                                                    'taken as '
                            f'{self.unit}')
        self._conversion = conversion(self.unit or own_unit(self.source.signal), own_unit(self.source.signal))
        finite = numbers[np.isfinite(numbers)]
        for scale in self.source.scales:
            self._scale = scale
            if self._fits(finite):
                return
        self._scale = self.source.scales[0]
        if len(self.source.scales) == 1:
            self._explain(finite, remarks, path)

    def _fits(self, finite: FloatArray, share: float = FITTING_SHARE) -> bool:
        low, high = self.source.plausible
        if self.source.signal == 'soc' and len(self.source.scales) > 1:
            low = max(low, LEAST_PLAUSIBLE_SOC)
        # Zeros fit any scale, and tell none.
        own = self._converted(finite)[finite != 0.0]
        return not own.size or bool(np.mean((own >= low) & (own <= high)) >= share)

    def _explain(self, finite: FloatArray, remarks: Remarks, path: str) -> None:
        """Name the unit or scale that makes implausible readings plausible, and use it for a repair."""
        if self._fits(finite, 0.5):
            return
        signal, given = self.source.signal, (self.unit, self._scale, self._conversion)
        others = [(unit, 1.0) for unit in ALIKE[own_unit(signal)]] + [(self.unit, scale) for scale in OTHER_SCALES]
        for unit, scale in others:
            self.unit, self._scale = unit, given[1] * scale
            self._conversion = conversion(unit or own_unit(signal), own_unit(signal))
            if self._fits(finite, 0.99):
                words = f'a factor of {scale:g}' if scale != 1.0 else f'the unit {unit}'
                done = ('repaired' if self._repair else
                        'read the log with repair (--repair) or name it in a signal map')
                remarks.add(f'mixed {self.channel}', f'{path}: {self.channel}: its readings, '
                            f'{figure(float(np.median(finite)))} in the middle, are implausible as {signal}; with '
                            f'{words} they are plausible; {done}')
                if self._repair:
                    return
                break
        self.unit, self._scale, self._conversion = given

    def _converted(self, numbers: FloatArray) -> FloatArray:
        assert self._conversion is not None
        # A damaged number may be too large for any unit; it is implausible then.
        with np.errstate(over='ignore'):
            converted: FloatArray = self.source.in_own_unit(numbers, self._scale, self._conversion)
            return converted

    def _range(self) -> str:
        assert self._conversion is not None
        ends = sorted((((-end if self.source.charging_is_positive else end) - self._conversion.offset)
                       / self._conversion.factor - self.source.offset) / self._scale
                      for end in self.source.plausible)
        return f'plausible: {figure(ends[0])} ... {figure(ends[1])}'

    def _dropped(self, remarks: Remarks, cause: str, words: str, which: BoolArray, places: IntArray,
                 where: str) -> None:
        if which.any():
            remarks.add(f'{self.channel} {self.source.signal} {cause}',
                        f'{where} {places[int(np.argmax(which))]}: {self.channel}: {words}; it is dropped',
                        int(which.sum()))


def _usual_unit(signal: str, readings: FloatArray) -> str:
    """Return the unit that readings without one most probably have, '' for the signal's own."""
    # A few wild readings do not count.
    largest = float(np.quantile(np.abs(readings), 0.99))
    if signal == 'soc':
        return 'percent' if largest > LARGEST_SHARE else ''
    if signal == 'speed_mps':
        return 'km/h'
    if signal in ('power_w', 'propulsion_power_w'):
        return 'kW' if 0.0 < largest < LARGEST_KW else ''
    if signal == 'odometer_m':
        return 'km'
    return ''


def _fitting(unit: str, signal: str) -> str:
    """Return a unit that the log names if it measures the signal's quantity, else ''."""
    try:
        check_unit(unit or own_unit(signal), signal)
    except InvalidInput:
        return ''
    return unit
