# SPDX-License-Identifier: Apache-2.0
"""Decodes readings of a channel into a signal: validity, scale, sign, unit. Knows nothing of files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.logs.numbers import read_numbers, unit_in_cells
from bev_preheat.logs.units import check_unit, Conversion, conversion, own_unit

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import Source
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray

# The state of charge of a battery in use; a scale that gives less does not fit.
LEAST_PLAUSIBLE_SOC = 0.02
# Share of the readings that a scale must make plausible.
FITTING_SHARE = 0.9


class Decoder:
    """
    Decodes one channel for one Source.

    The unit is the map's, else the channel's, else the one behind the first readings, else the signal's own; the
    scale is chosen by the first readings. `unit` says which unit was used.
    """

    def __init__(self, source: Source, channel: str, channel_unit: str, decimal: str = '.') -> None:
        """Take the unit in which the log says that the channel is ('' if it does not)."""
        self.source, self.channel = source, channel
        self.unit = source.unit or _fitting(channel_unit, source.signal)
        self._decimal, self._scale = decimal, source.scales[0]
        self._conversion: Conversion | None = None

    def decode(self, values: FloatArray | Sequence[str], places: IntArray, remarks: Remarks,
               where: str) -> FloatArray:
        """
        Return readings in the signal's unit, shape (N,), NaN for each that is no reading or implausible.

        Remarks name the first dropped one of a cause: `where` followed by its place.
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
            self._dropped(remarks, f'none {nothing:g}', f'{nothing:g} means no reading and', none, places, where)
            numbers[none] = np.nan
        if self._conversion is None:
            if not np.isfinite(numbers).any():
                return numbers
            self._choose(numbers)
        own = self._converted(numbers)
        low, high = self.source.plausible
        bad = (own < low) | (own > high)
        if bad.any():
            at = int(np.argmax(bad))
            # Rounding of the unit's conversion.
            bad &= (own < low - 1e-9 * abs(low)) | (own > high + 1e-9 * abs(high))
            self._dropped(remarks, 'range', f'{figure(numbers[at])} (plausible: {self._range()})', bad, places, where)
        return np.where(bad, np.nan, own)

    def _choose(self, numbers: FloatArray) -> None:
        """Choose the scale by the first readings, which are finite or NaN."""
        self._conversion = conversion(self.unit or own_unit(self.source.signal), own_unit(self.source.signal))
        finite = numbers[np.isfinite(numbers)]
        low, high = self.source.plausible
        if self.source.signal == 'soc':
            low = max(low, LEAST_PLAUSIBLE_SOC)
        for scale in self.source.scales:
            self._scale = scale
            own = self._converted(finite)
            # Zeros fit any scale, and tell none.
            own = own[finite != 0.0]
            if np.mean((own >= low) & (own <= high)) >= FITTING_SHARE if own.size else True:
                return
        self._scale = self.source.scales[0]

    def _converted(self, numbers: FloatArray) -> FloatArray:
        assert self._conversion is not None
        own = (numbers * self._scale + self.source.offset) * self._conversion.factor + self._conversion.offset
        return -own if self.source.charging_is_positive else own

    def _range(self) -> str:
        assert self._conversion is not None
        ends = sorted((((-end if self.source.charging_is_positive else end) - self._conversion.offset)
                       / self._conversion.factor - self.source.offset) / self._scale
                      for end in self.source.plausible)
        return f'{figure(ends[0])} ... {figure(ends[1])}'

    def _dropped(self, remarks: Remarks, cause: str, words: str, which: BoolArray, places: IntArray,
                 where: str) -> None:
        if which.any():
            remarks.add(f'{self.channel} {self.source.signal} {cause}',
                        f'{where} {places[int(np.argmax(which))]}: {self.channel}: {words} is dropped',
                        int(which.sum()))


def _fitting(unit: str, signal: str) -> str:
    """Return a unit that the log names if it measures the signal's quantity, else ''."""
    try:
        check_unit(unit or own_unit(signal), signal)
    except InvalidInput:
        return ''
    return unit
