# SPDX-License-Identifier: Apache-2.0
"""Collects samples in bounded memory, and makes signals: no clock goes back, all alike, in the likely unit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.logs.decoding import Decoder
from bev_preheat.logs.raw_log import Piece, RawLog, Remarks
from bev_preheat.logs.recording import Series
from bev_preheat.logs.signal_map import Source
from bev_preheat.logs.unit_hypotheses import JUMP_K, jumps, likely, MOST_JUMPS, OTHER, plausible
from bev_preheat.numerics import FloatArray, IntArray
from bev_preheat.tunables import MISSING_CELL_C

# Beyond this many samples of a channel, pairs of neighbours are averaged (six hours at 10 Hz).
MOST_SAMPLES = 200_000


class Samples:
    """Samples of one channel: times, values and places; at most twice MOST_SAMPLES, however long the log is."""

    def __init__(self) -> None:
        self._kept: list[tuple[FloatArray, FloatArray, IntArray]] = []
        self._count = 0
        # How many readings one kept sample is the mean of.
        self.averaged = 1
        self.readings = 0

    def add(self, time_s: FloatArray, values: FloatArray, places: IntArray) -> None:
        """Add samples; those that are not finite are left out."""
        good = np.isfinite(time_s) & np.isfinite(values)
        self.readings += int(good.sum())
        time_s, values, places = time_s[good], values[good], places[good]
        for _ in range(self.averaged.bit_length() - 1):
            time_s, values, places = _halved(time_s, values, places)
        self._kept.append((time_s, values, places))
        self._count += len(time_s)
        while self._count > 2 * MOST_SAMPLES:
            halved = _halved(*self.arrays())
            self._kept, self._count = [halved], len(halved[0])
            self.averaged *= 2

    def arrays(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return times, values and places, each of shape (N,), in the order of the file."""
        if not self._kept:
            return np.empty(0), np.empty(0), np.empty(0, dtype=int)
        times, values, places = zip(*self._kept)
        return np.concatenate(times), np.concatenate(values), np.concatenate(places)


def _halved(time_s: FloatArray, values: FloatArray, places: IntArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the means of pairs of neighbours; an odd last sample stays."""
    pairs = len(time_s) // 2 * 2

    def mean(array: FloatArray) -> FloatArray:
        return np.concatenate([0.5 * (array[0:pairs:2] + array[1:pairs:2]), array[pairs:]])

    # A view would keep all places in memory.
    return mean(time_s), mean(values), places[::2].copy()


COMBINATIONS: dict[str, Callable[..., FloatArray]] = {'mean': np.nanmean, 'min': np.nanmin, 'max': np.nanmax}


def combined(parts: list[Series], how: str, hold_s: float, at_least: int = 0) -> Series:
    """
    Return one Series of several channels: their mean, min or max at the instants of the longest.

    A channel takes part at an instant if it has a sample at most `hold_s` away; instants at which fewer than
    `at_least` channels take part are left out.
    """
    longest = max(parts, key=lambda part: len(part.time_s))
    rows = []
    for part in parts:
        at = np.clip(np.searchsorted(part.time_s, longest.time_s), 1, max(len(part.time_s) - 1, 1))
        before, after = at - 1, np.minimum(at, len(part.time_s) - 1)
        nearest_s = np.minimum(np.abs(part.time_s[before] - longest.time_s),
                               np.abs(part.time_s[after] - longest.time_s))
        rows.append(np.where(nearest_s <= hold_s, part.at(longest.time_s), np.nan))
    table = np.array(rows)
    value = COMBINATIONS[how](table, axis=0)
    return Series(longest.time_s, value).part(np.isfinite(table).sum(axis=0) >= at_least)


# A channel is combined with others at an instant if it has a reading this near [s].
COMBINED_WITHIN_S = 60.0
# Share of the readings that may be out of order before the log counts as several logs in one.
MOST_OUT_OF_ORDER = 0.02
LONGEST_LOG_S = 60.0 * 86400.0
# The largest difference between sensors of a battery [K].
MOST_SPREAD_K = 15.0
# Beside a sensor that is this far from a code [K], no other stays at it: such a column is of a missing module.
MOST_BESIDE_ZERO_K = 2.0
# A value that a logger writes before the first reading, for at most this time [s], is followed by a larger step
# than a car makes, and does not return as soon.
LONGEST_BEGIN_S = 60.0
LARGEST_STEPS = {'battery_temperature_c': JUMP_K, 'ambient_c': JUMP_K, 'soc': 0.05}
# A reading is compared with the median of as many around it, if they are within this time [s].
LONE_OF, LONGEST_LONE_S, MOST_LONE = 5, 120.0, 0.05
# The readings of a channel that may be dropped for each that is left.
DROPPED_A_READING = 4
# Fewer samples do not show that a channel jumps.
LEAST_OF_JUMPS = 20


class Assembly:
    """Makes the Series of signals of the samples of channels."""

    def __init__(self, path: str | Path, log: RawLog, decoders: dict[tuple[str, str], Decoder], remarks: Remarks,
                 repair: bool) -> None:
        """Begin without samples; the Decoders are those of channels by (signal, channel)."""
        self._path, self._where, self._is_absolute = path, f'{path}, {log.place}', log.absolute
        self._remarks, self._repair = remarks, repair
        self._decoders = decoders
        self._samples = {key: Samples() for key in decoders}
        self._series: dict[str, Series] = {}

    def take(self, piece: Piece) -> None:
        """Decode a Piece for each signal that its channel may be."""
        for key, samples in self._samples.items():
            if key[1] == piece.channel:
                values = self._decoders[key].decode(piece.values, piece.places, self._where)
                samples.add(piece.time_s, values, piece.places)

    def series(self, chosen: dict[str, tuple[tuple[str, ...], ...]]) -> tuple[dict[str, Series],
                                                                              dict[str, tuple[str, ...]]]:
        """Return the Series of each signal that has a sample, times as in the log, and the channels used."""
        used = {}
        # Signals with an open unit are compared with the others.
        is_open = {signal: any(self._decoders[signal, channel].hypotheses for group in groups for channel in group)
                   for signal, groups in chosen.items()}
        for signal in sorted(chosen, key=is_open.__getitem__):
            # Missing sensors read 0 in many logs.
            for group in sorted(chosen[signal], key=lambda group: signal in OTHER and not any(
                    self._samples[signal, channel].arrays()[1].any() for channel in group)):
                for channel in group:
                    self._remarks.extend(self._decoders[signal, channel].said)
                parts = {channel: self._part(signal, channel) for channel in group}
                parts = self._alike(signal, {channel: part for channel, part in parts.items() if len(part.time_s)})
                whole = self._combined(self._decoders[signal, group[0]].source, parts)
                if whole is not None:
                    self._series[signal], used[signal] = whole, tuple(parts)
                    break
        return ({signal: self._series[signal] for signal in chosen if signal in self._series},
                {signal: used[signal] for signal in chosen if signal in used})

    def _alike(self, signal: str, parts: dict[str, Series]) -> dict[str, Series]:
        """Return the parts of a temperature without those at a code; the first alone if they differ too much."""
        for channel, code_c in [(channel, part.value[0]) for channel, part in parts.items()
                                if part.value[0] in MISSING_CELL_C and not np.ptp(part.value)]:
            if signal in OTHER and any(np.abs(part.value - code_c).max() > MOST_BESIDE_ZERO_K
                                       for part in parts.values()):
                self._remarks.add(f'zero {signal}', f'{self._path}: {channel}: stays at {figure(code_c)}, unlike '
                                  f'the others of its kind, so it is not taken for {signal}', noun='channel')
                del parts[channel]
        if signal not in OTHER or len(parts) < 2 or self._decoders[signal, next(iter(parts))].source.combine:
            return parts
        medians = {channel: float(np.median(part.value)) for channel, part in parts.items()}
        if np.ptp(list(medians.values())) <= MOST_SPREAD_K:
            return parts
        first = next(iter(parts))
        other = max(medians, key=lambda channel: abs(medians[channel] - medians[first]))
        self._remarks.add(f'spread {signal}', f'{self._path}: {signal}: {first} ({figure(medians[first], 3)} in '
                          f'the middle) and {other} ({figure(medians[other], 3)}) are not alike; the first counts')
        return {first: parts[first]}

    def _part(self, signal: str, channel: str) -> Series:
        kept = self._samples[signal, channel]
        if kept.averaged > 1:
            self._remarks.add('averaged', f'{self._path}: the log is long ({channel}: {kept.readings} readings); '
                              f'a sample is the mean of {kept.averaged} readings', noun='channel')
        time_s, values, places = kept.arrays()
        decoder = self._decoders[signal, channel]
        if decoder.hypotheses and len(time_s):
            values = self._settled(signal, decoder, Series(time_s, values), places)
            good = np.isfinite(values)
            time_s, values, places = time_s[good], values[good], places[good]
        if decoder.dropped > DROPPED_A_READING * kept.averaged * len(values) > 0:
            # Such as the small readings of a current in mA.
            self._remarks.add(f'rest {channel}', f'{self._path}: {channel}: few of its readings are left, so it '
                              f'is not taken for {signal}')
            return Series(np.empty(0), np.empty(0))
        part = self._begun(signal, channel, self._in_order(time_s, values, places))
        if signal in OTHER and len(part.time_s) > LEAST_OF_JUMPS and np.mean(jumps(part)) > MOST_JUMPS:
            self._remarks.add(f'jumps {channel}', f'{self._path}: {channel}: jumps as no temperature does, so it '
                              f'is not taken for {signal}')
            return Series(np.empty(0), np.empty(0))
        return self._without_zeros(signal, channel, self._without_lone(signal, channel, part))

    def _without_zeros(self, signal: str, channel: str, part: Series) -> Series:
        """Return a part without the zeros that a logger writes for none, a step away from the readings beside."""
        if signal not in LARGEST_STEPS or not part.value.any():
            return part
        zero = part.value == 0.0
        far = np.abs(np.diff(part.value)) > LARGEST_STEPS[signal]
        near = np.diff(part.time_s) <= LONGEST_BEGIN_S
        ends = np.flatnonzero(np.diff(zero, prepend=False, append=False))
        for begin, end in zip(ends[::2], ends[1::2]):
            beside = [at for at in (begin - 1, end - 1) if 0 <= at < len(near) and near[at]]
            zero[begin:end] = bool(beside) and bool(far[beside].all())
        if zero.any():
            after_s = part.time_s[int(np.argmax(zero))] - part.time_s[0]
            self._remarks.add(f'zeros {channel} {signal}', f'{self._path}: {channel}: 0 from {figure(after_s)} s '
                              'on is far from the readings before and after it; it is dropped', int(zero.sum()))
        return part.part(~zero)

    def _begun(self, signal: str, channel: str, part: Series) -> Series:
        """Return a part without the value that a logger writes before the first reading."""
        time_s, value = part.time_s, part.value
        for last in np.flatnonzero(np.diff(value))[:1]:
            soon = (time_s > time_s[last]) & (time_s <= time_s[last] + LONGEST_BEGIN_S)
            is_step = abs(value[last + 1] - value[last]) > LARGEST_STEPS.get(signal, np.inf)
            if is_step and soon[last + 1] and time_s[last] - time_s[0] <= LONGEST_BEGIN_S and (
                    value[soon] != value[last]).all():
                self._remarks.add(f'begin {channel}', f'{self._path}: {channel}: {figure(value[0])} stands '
                                  'before the first reading; it is dropped', int(last) + 1)
                return part.part(np.arange(len(value)) > last)
        return part

    def _without_lone(self, signal: str, channel: str, part: Series) -> Series:
        """Return a part without single readings far from those before and after, such as a 0 for none."""
        if signal not in LARGEST_STEPS or len(part.value) < LONE_OF:
            return part
        value, time_s = (sliding_window_view(np.pad(each, LONE_OF // 2, 'edge'), LONE_OF)
                         for each in (part.value, part.time_s))
        lone = (np.abs(part.value - np.median(value, axis=1)) > LARGEST_STEPS[signal]) & (
            np.ptp(time_s, axis=1) <= LONGEST_LONE_S)
        # More are no exceptions: the channel itself is in doubt.
        if not 0.0 < np.mean(lone) <= MOST_LONE:
            return part
        at = int(np.argmax(lone))
        after_s = part.time_s[at] - part.time_s[0]
        self._remarks.add(f'lone {channel} {signal}', f'{self._path}: {channel}: the reading after '
                          f'{figure(after_s)} s, {figure(part.value[at])} as {signal}, is far from those '
                          'before and after it; it is dropped', int(lone.sum()))
        return part.part(~lone)

    def _settled(self, signal: str, decoder: Decoder, own: Series, places: IntArray) -> FloatArray:
        """Return the readings of a channel with an open unit in the signal's unit, NaN for implausible ones."""
        source, is_choice = decoder.source, bool(decoder.source.other_units)
        raw = Series(own.time_s, decoder.raw(own.value))
        left = likely(decoder.hypotheses, raw, source, self._series)
        is_settled, said = len(left) == 1 and (self._repair or is_choice), ''
        if is_choice and not is_settled:
            said = (f'may be in {" or ".join(each.unit for each in decoder.hypotheses)}; taken as '
                    f'{decoder.given.unit}; name the unit in a signal map')
        elif left and not is_choice:
            words = ', or '.join(each.words(decoder.given) for each in left)
            how = ('repaired' if is_settled else 'name it in a signal map' if len(left) > 1 else
                   'read the log with repair (--repair) or name it in a signal map')
            said = f'are implausible as {signal}; {words} they are plausible; {how}'
        if said:
            self._remarks.add(f'mixed {decoder.channel}', f'{self._path}: {decoder.channel}: its readings, '
                              f'{figure(float(np.median(raw.value)))} in the middle, {said}')
        if is_settled:
            decoder.given = left[0]
        values = decoder.given.own(raw.value, source)
        bad = ~plausible(values, source)
        if bad.any():
            at = int(np.argmax(bad))
            decoder.dropped += int((bad & (raw.value != 0.0)).sum())
            self._remarks.add(f'{decoder.channel} {signal} range', f'{self._where} {places[at]}: '
                              f'{decoder.channel}: {decoder.why_dropped(raw.value[at])}; it is dropped',
                              int(bad.sum()))
        return np.where(bad, np.nan, values)

    def _combined(self, source: Source, parts: dict[str, Series]) -> Series | None:
        """Return the Series of the parts of a signal, None if too few are valid."""
        if len(parts) < source.at_least:
            self._remarks.add(f'few {source.signal}', f'{self._path}: {source.signal}: {len(parts)} of its '
                              f'channels have valid readings; at least {source.at_least} are needed; the signal '
                              'is left out')
        if len(parts) < max(source.at_least, 1):
            return None
        whole = next(iter(parts.values())) if len(parts) == 1 else combined(
            list(parts.values()), source.combine or 'mean', COMBINED_WITHIN_S, source.at_least)
        return whole if len(whole.time_s) else None

    def _in_order(self, time_s: FloatArray, values: FloatArray, places: IntArray) -> Series:
        """Return the samples with strictly increasing times; remark on those that were sorted or left out."""
        if len(time_s):
            # Clocks that were not yet set, or a digit that was lost.
            far = np.abs(time_s - np.median(time_s)) > LONGEST_LOG_S
            if far.any():
                self._remarks.add_shared(
                    'far', f'{self._where} {places[int(np.argmax(far))]}: the time is more than '
                    f'{LONGEST_LOG_S / 86400.0:g} days from the others; the reading is dropped', int(far.sum()),
                    'reading')
                time_s, values, places = time_s[~far], values[~far], places[~far]
        steps_s = np.diff(time_s)
        if self._is_absolute and len(steps_s) and np.mean(steps_s < 0.0) > 1.0 - MOST_OUT_OF_ORDER:
            self._remarks.add_shared(
                'newest', f'{self._path}: begins with the newest reading; the readings are sorted', 1, '')
            time_s, values, places, steps_s = time_s[::-1], values[::-1], places[::-1], -steps_s[::-1]
        back = np.flatnonzero(steps_s < 0.0)
        if back.size:
            first = f'{self._where} {places[back[0] + 1]}: the time goes back by {-steps_s[back[0]]:g} s'
            late = int((time_s < np.maximum.accumulate(time_s)).sum())
            if late > max(2.0, MOST_OUT_OF_ORDER * len(time_s)):
                raise InvalidInput(f'{first}, and {late} of {len(time_s)} readings lie before one above them; a '
                                   'log must be one drive: split it, or name the channel of the time in a signal '
                                   'map')
            self._remarks.add_shared('order', f'{first}; the readings are sorted', int(back.size), 'place')
            order = np.argsort(time_s, kind='stable')
            time_s, values, places = time_s[order], values[order], places[order]
            steps_s = np.diff(time_s)
        same = np.flatnonzero(steps_s == 0.0)
        if same.size:
            # A clock of whole seconds, and faster readings: their mean counts.
            self._remarks.add_shared('same', f'{self._where} {places[same[0] + 1]}: has the time of the reading '
                                     'before; their mean counts', int(same.size), 'reading')
            starts = np.flatnonzero(np.concatenate([[True], steps_s > 0.0]))
            values = np.add.reduceat(values, starts) / np.diff(starts, append=len(values))
            time_s = time_s[starts]
        return Series(time_s, values)
