# SPDX-License-Identifier: Apache-2.0
"""Decodes readings of a channel into a signal: validity, scale, sign, unit. Knows nothing of files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.files.units import (
    cell_units,
    check_unit,
    conversion,
    IN_BRACKETS,
    is_stated,
    measures,
    own_unit,
    read_numbers,
    split_unit,
    unit_named,
)
from bev_preheat.logs.raw_log import Remarks
from bev_preheat.logs.signal_map import Source
from bev_preheat.logs.unit_hypotheses import hypotheses, Hypothesis, plausible
from bev_preheat.numerics import BoolArray, FloatArray, IntArray

# The largest values of one byte and of two, and the usual resolutions and offset of a signal.
BYTES = tuple(255.0 * step + offset for step in (1.0, 0.5, 0.1) for offset in (0.0, -40.0))
WORDS = tuple(full * step for step in (1.0, 0.1, 0.01, 0.001) for full in (65535.0, 32767.0, -32768.0))
# A reading stands apart if no other is nearer than this share of its value; for one byte, a tenth of a degree is a
# reading, so there a distance [K] that no temperature jumps is needed too.
APART, BYTE_APART_K = 0.1, 15.0
# A sensor may stay at a lower value.
LEAST_CONSTANT = 60.0


def all_ones(numbers: FloatArray, is_temperature: bool, full: tuple[float, ...] = ()) -> BoolArray:
    """
    Return which numbers are all ones and stand apart from the others, shape (N,).

    `full` are the values of all ones if the log has them; otherwise the usual ones are tried, those of a byte
    for temperatures only, because other signals pass through them.
    """
    finite = np.unique(numbers[np.isfinite(numbers)])
    found: BoolArray = np.zeros(len(numbers), dtype=bool)
    for value in full or (WORDS + BYTES if is_temperature else WORDS):
        same = np.abs(finite - value) <= 1e-6 * max(abs(value), 1.0)
        others = finite[~same]
        if not same.any() or (not others.size and value < LEAST_CONSTANT and not full):
            continue
        least = max(APART * abs(value), BYTE_APART_K if value in BYTES and not full else 0.0)
        if not others.size or np.abs(others - value).min() >= least:
            found |= np.abs(numbers - value) <= 1e-6 * max(abs(value), 1.0)
    return found


# The state of charge of a battery in use; a scale that gives less does not fit.
LEAST_PLAUSIBLE_SOC = 0.02
# Units for readings that have none, by their size: a share of charge exceeds 1.01 only as a percentage; a drive
# needs more than LARGEST_KW watts at some instant, and fewer kilowatts; loggers for people write km/h.
LARGEST_SHARE, LARGEST_KW = 1.01, 600.0
# Share of the readings that a scale of a map must make plausible.
SCALE_FITTING_SHARE = 0.9


class Decoder:
    """
    Decodes one channel for one Source.

    The unit is the map's, else the channel's, else the one behind the first readings, else the signal's own. With
    `is_guess` the map was recognised and not given, so a unit that the log states comes first. The scale is chosen
    by the first readings. `given` is the Hypothesis with which it decodes. `hypotheses` are others
    that make implausible readings plausible, or those of a map that leaves the unit open; from then on nothing is
    dropped, because the car's other signals decide between them.
    """

    def __init__(self, source: Source, channel: str, channel_unit: str, decimal: str = '.',
                 full: tuple[float, ...] = (), is_guess: bool = False) -> None:
        """Take the unit that the log names ('': none), and the values of all ones if the log has them."""
        self.source, self.channel, self._full = source, channel, full
        self._written = named = _fitting(channel_unit, source.signal)
        # From here on, '' if the log may still say it.
        self._unit = '' if is_guess else source.unit
        if not self._unit and (not source.unit or is_stated(channel, channel_unit)):
            self._unit = named
        self.given = Hypothesis(self._unit or source.unit, source.scales[0])
        self.hypotheses: tuple[Hypothesis, ...] = ()
        self._decimal, self._is_chosen = decimal, False
        # Readings dropped as no number or as implausible, without zeros, which many loggers write for none.
        self.dropped = 0
        # Of decoding; they count only if the channel is used.
        self.said = Remarks()

    def decode(self, values: FloatArray | Sequence[str], places: IntArray, where: str) -> FloatArray:
        """
        Return readings in the signal's unit, shape (N,), NaN for each that is no reading or implausible.

        Remarks name the first dropped reading of each cause: `where` followed by its place.
        """
        if isinstance(values, np.ndarray):
            numbers = values.astype(float)
        else:
            numbers, wrong = read_numbers(values, self._decimal, self.source.signal.endswith('_deg'))
            if wrong.any():
                first = quoted(str(values[int(np.argmax(wrong))]))
                self.dropped += int(wrong.sum())
                self._drop(numbers, wrong, 'text', f'{first} is not a number', places, where)
            self._of_cells(numbers, values, places, where)
        numbers = np.where(np.isfinite(numbers), numbers, np.nan)
        for nothing in self.source.no_reading:
            none = np.abs(numbers - nothing) <= 1e-9 * max(abs(nothing), 1.0)
            self._drop(numbers, none, f'none {nothing:g}', f'{nothing:g} means no reading', places, where)
        full = all_ones(numbers, self.source.signal.endswith('_c'), self._full)
        if full.any():
            value = figure(numbers[int(np.argmax(full))])
            self._drop(numbers, full, 'ones', f'{value} has all bits set, which means no reading', places, where)
        finite = numbers[np.isfinite(numbers)]
        if not finite.size:
            return numbers
        if not self._is_chosen:
            self._choose(finite, where.rpartition(',')[0])
        own = self.given.own(numbers, self.source)
        bad = np.isfinite(own) & ~plausible(own, self.source)
        if bad.any() and not self.hypotheses and len(self.source.scales) == 1:
            self.hypotheses = hypotheses(finite, self.given, self.source)
        if not self.hypotheses:
            self.dropped += int((bad & (numbers != 0.0)).sum())
            self._drop(own, bad, 'range', self.why_dropped(numbers[int(np.argmax(bad))]), places, where)
        return own

    def _of_cells(self, numbers: FloatArray, texts: Sequence[str], places: IntArray, where: str) -> None:
        """Bring numbers with another unit behind them, such as 950 W below 1.2 kW, into the channel's unit."""
        signal, units = self.source.signal, np.array(cell_units(texts))
        if not self._is_chosen:
            first = next((str(unit) for unit in units[units != ''] if _fitting(unit, signal)), '')
            self._unit, self._written = self._unit or first, self._written or first
            self.given = self.given._replace(unit=self._unit or self.given.unit)
        for unit in {*units} - {'', self._written}:
            if _fitting(unit, signal):
                change = conversion(unit, self._written or self.given.unit or own_unit(signal))
                numbers[units == unit] = numbers[units == unit] * change.factor + change.offset
            elif not measures(unit, signal):
                first = quoted(texts[int(np.argmax(units == unit))])
                self._drop(numbers, units == unit, 'unit', f'{first} is no reading of {signal}', places, where)

    def raw(self, own: FloatArray) -> FloatArray:
        """Return the channel's values of readings in the signal's own unit."""
        unit = conversion(self.given.unit or own_unit(self.source.signal), own_unit(self.source.signal))
        own = -own if self.source.charging_is_positive else own
        raw: FloatArray = ((own - unit.offset) / unit.factor - self.source.offset) / self.given.scale
        return np.round(raw, 9)

    def why_dropped(self, number: float) -> str:
        """Return the reason for which a channel's value is dropped as implausible."""
        ends = sorted(self.raw(np.array(self.source.plausible)))
        return f'{figure(number)} is implausible (plausible: {figure(ends[0])} ... {figure(ends[1])})'

    def _choose(self, finite: FloatArray, path: str) -> None:
        signal, self._is_chosen = self.source.signal, True
        if not self.given.unit:
            unit = _usual_unit(signal, finite)
            self.given = self.given._replace(unit=unit)
            shown = unit or own_unit(signal)
            # A signal's own name says its unit.
            if (unit or signal.endswith('_c')) and split_unit(self.channel).unit != shown:
                stated = IN_BRACKETS.match(self.channel)
                fault = f'{quoted(stated[2])} is no known unit' if stated and stated[2] else 'has no unit'
                self.said.add(f'unit {signal}', f'{path}: {self.channel}: {fault}; its readings are taken as '
                              f'{shown}', noun='channel')
        if self.source.other_units and self._unit in ('', self.source.unit):
            self.hypotheses = (self.given, *(self.given._replace(unit=unit_named(unit) or unit)
                                             for unit in self.source.other_units))
        low, high = self.source.plausible
        if signal == 'soc' and len(self.source.scales) > 1:
            low = max(low, LEAST_PLAUSIBLE_SOC)
        for scale in self.source.scales:
            scaled = self.given._replace(scale=scale)
            # Zeros fit any scale, and reveal none.
            own = scaled.own(finite[finite != 0.0], self.source)
            if not own.size or np.mean((own >= low) & (own <= high)) >= SCALE_FITTING_SHARE:
                self.given = scaled
                return

    def _drop(self, values: FloatArray, which: BoolArray, cause: str, words: str, places: IntArray,
              where: str) -> None:
        values[which] = np.nan
        if which.any():
            self.said.add(f'{self.channel} {self.source.signal} {cause}',
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
