# SPDX-License-Identifier: Apache-2.0
"""Reads a log of any known format into a Recording in SI units."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure, InvalidInput, shortened
from bev_preheat.logs.channels import RawLog
from bev_preheat.logs.decoding import Decoder
from bev_preheat.logs.doubts import find_doubts
from bev_preheat.logs.formats import open_log
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.logs.remarks import Remarks
from bev_preheat.logs.samples import combined, Samples
from bev_preheat.logs.signal_map import load_signal_map, recognised_map, SignalMap
from bev_preheat.logs.units import split_unit

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray

# A channel is combined with others at an instant if it has a reading this near [s].
HOLD_S = 60.0
# Share of the readings that may be out of order before the log counts as several logs in one.
MOST_OUT_OF_ORDER = 0.02
LONGEST_LIST = 400
FASTEST_MPS = 100.0
LONGEST_LOG_S = 60.0 * 86400.0


def read_recording(path: str | Path, signals: str | Path | SignalMap | None = None,
                   repair: bool = False, only: Collection[str] | None = None) -> Recording:
    """
    Return the Recording of a log.

    `signals` is a signal map: a name in config/signals, a YAML file or a SignalMap; None: the map that recognises
    the log's channels, else the common one. Doubts about sign, unit or scale are among the remarks; with `repair`
    they are corrected. `only` names the signals that are read (None: all). Power is added as voltage times
    current if the log has none. Raises InvalidInput naming file, place, value and allowed values.
    """
    given = signals if signals is None or isinstance(signals, SignalMap) else load_signal_map(signals)
    log = open_log(path, () if given is None else given.databases)
    names = [channel.name for channel in log.channels]
    signal_map = recognised_map(names) if given is None else given
    chosen = {signal: source.chosen(names) for signal, source in signal_map.sources.items()}
    chosen = {signal: channels for signal, channels in chosen.items()
              if channels and (only is None or signal in only)}
    if not chosen:
        raise InvalidInput(
            f'{path}: none of its channels is a signal of the signal map {signal_map.name}; the channels are '
            f'{shortened(", ".join(names), LONGEST_LIST)}; name them in a signal map')
    log.use(signal_map)
    remarks = Remarks()
    for channel in {each for channels in chosen.values() for each in channels if f'{each} #2' in names}:
        remarks.add(f'twice {channel}', f'{path}: {channel} is named more than once; the first counts')
    units = {channel.name: channel.unit for channel in log.channels}
    decoders = {
        (signal, channel): Decoder(signal_map.sources[signal], channel, units[channel], log.decimal, repair)
        for signal, channels in chosen.items() for channel in channels}
    samples = {key: Samples() for key in decoders}
    by_channel: dict[str, list[tuple[str, str]]] = {}
    for key in decoders:
        by_channel.setdefault(key[1], []).append(key)
    for piece in log.pieces(by_channel.keys(), remarks):
        for key in by_channel[piece.channel]:
            values = decoders[key].decode(piece.values, piece.places, remarks, f'{path}, {log.place}')
            samples[key].add(piece.time_s, values, piece.places)
    series = _series(path, log, chosen, samples, signal_map, remarks)
    if not series:
        raise InvalidInput([f'{path}: no signal has a valid reading', *remarks.sentences()])
    sources = {signal: tuple(_described(decoders[signal, channel]) for channel in channels
                             if samples[signal, channel].readings)
               for signal, channels in chosen.items() if signal in series}
    _judge(path, series, remarks, repair)
    _drop_too_fast(path, series, remarks)
    _add_power(series, sources)
    if not series:
        raise InvalidInput([f'{path}: no signal has a valid reading', *remarks.sentences()])
    start_s = min(float(each.time_s[0]) for each in series.values())
    return Recording(
        name=Path(path).stem,
        signals={signal: Series(each.time_s - start_s, each.value) for signal, each in series.items()},
        start_s=start_s if log.absolute else None, signal_map=signal_map.name, remarks=remarks.sentences(),
        format=log.format, sources=sources)


def _described(decoder: Decoder) -> str:
    named = decoder.unit and not split_unit(decoder.channel).unit
    return f'{decoder.channel} [{decoder.unit}]' if named else decoder.channel


def _judge(path: str | Path, series: dict[str, Series], remarks: Remarks, repair: bool) -> None:
    """Remark on doubts about the signals, and correct them on request."""
    # A corrected speed or current may settle the doubt about another signal.
    for _ in range(len(series)):
        doubts = find_doubts(series)
        for doubt in doubts[:1] if repair else doubts:
            done = 'repaired' if repair else 'to correct it, read the log with repair (--repair) or a signal map'
            remarks.add(f'doubt {doubt.signal} {doubt.factor:g}', f'{path}: {doubt.sentence} {done}'
                        if doubt.sentence.endswith('?') else f'{path}: {doubt.sentence}; {done}')
            if repair:
                series[doubt.signal] = doubt.repaired(series[doubt.signal])
        if not doubts or not repair:
            return


def _drop_too_fast(path: str | Path, series: dict[str, Series], remarks: Remarks) -> None:
    """Drop speeds that no car reaches, now that their unit is as good as it gets."""
    speed = series.get('speed_mps')
    if speed is None or (speed.value <= FASTEST_MPS).all():
        return
    good = speed.value <= FASTEST_MPS
    at = int(np.argmin(good))
    remarks.add('fast', f'{path}: speed_mps: {figure(speed.value[at])} at '
                        f'{figure(speed.time_s[at] - speed.time_s[0])} s '
                f'is dropped (plausible: 0 ... {FASTEST_MPS:g})', int((~good).sum()))
    if good.any():
        series['speed_mps'] = Series(speed.time_s[good], speed.value[good])
    else:
        del series['speed_mps']


def _add_power(series: dict[str, Series], sources: dict[str, tuple[str, ...]]) -> None:
    """Add the power as voltage times current, at the instants of the current that the voltage covers."""
    if 'power_w' in series or not {'voltage_v', 'current_a'} <= series.keys():
        return
    voltage, current = series['voltage_v'], series['current_a']
    inside = (current.time_s >= voltage.time_s[0]) & (current.time_s <= voltage.time_s[-1])
    if inside.any():
        time_s = current.time_s[inside]
        volts = np.interp(time_s, voltage.time_s, voltage.value)
        series['power_w'] = Series(time_s, volts * current.value[inside])
        sources['power_w'] = ('voltage_v x current_a',)


def _series(path: str | Path, log: RawLog, chosen: dict[str, tuple[str, ...]],
            samples: dict[tuple[str, str], Samples], signal_map: SignalMap, remarks: Remarks) -> dict[str, Series]:
    """Return the Series of each signal that has a sample; times as in the log."""
    series = {}
    for signal, channels in chosen.items():
        parts = []
        for channel in channels:
            kept = samples[signal, channel]
            if kept.averaged > 1:
                remarks.add('averaged', f'{path}: the log is long ({channel}: {kept.readings} readings); a '
                                        'sample is the '
                            f'mean of {kept.averaged} readings', noun='channel')
            part = _in_order(path, log, channel, *kept.arrays(), remarks)
            if len(part.time_s):
                parts.append(part)
        source = signal_map.sources[signal]
        if len(parts) < source.at_least:
            remarks.add(f'few {signal}', f'{path}: {signal}: {len(parts)} of its channels have valid readings; at '
                                         f'least {source.at_least} are needed; the signal is left out')
        elif len(parts) > 1:
            whole = combined(parts, source.combine, HOLD_S, source.at_least)
            if len(whole.time_s):
                series[signal] = whole
        elif parts:
            series[signal] = parts[0]
    return series


def _in_order(path: str | Path, log: RawLog, channel: str, time_s: FloatArray, values: FloatArray,
              places: IntArray, remarks: Remarks) -> Series:
    """Return the samples with strictly increasing times; remark on those that were sorted or left out."""
    if len(time_s):
        # Clocks that were not yet set, or a digit that was lost.
        far = np.abs(time_s - np.median(time_s)) > LONGEST_LOG_S
        if far.any():
            first = places[int(np.argmax(far))]
            remarks.add_shared('far', f'{path}, {log.place} {first}: the time is more than '
                               f'{LONGEST_LOG_S / 86400.0:g} days from the others; the reading is dropped',
                               int(far.sum()), 'reading')
            time_s, values, places = time_s[~far], values[~far], places[~far]
    steps_s = np.diff(time_s)
    back = np.flatnonzero(steps_s < 0.0)
    if back.size:
        at = back[0] + 1
        where = (f'{path}, {log.place} {places[at]}: the time goes back by {-steps_s[back[0]]:g} s')
        many = back.size > max(2.0, MOST_OUT_OF_ORDER * len(time_s))
        if many or time_s[-1] - time_s.min() < 0.5 * np.ptp(time_s):
            raise InvalidInput(f'{where}, in {back.size} places; a log must be one drive: split it, or name the '
                               'channel of the time in a signal map')
        remarks.add_shared('order', f'{where}; the readings are sorted', int(back.size), 'place')
        order = np.argsort(time_s, kind='stable')
        time_s, values, places = time_s[order], values[order], places[order]
        steps_s = np.diff(time_s)
    same = np.flatnonzero(steps_s == 0.0)
    if same.size:
        # A clock of whole seconds, and faster readings: their mean counts.
        remarks.add_shared('same', f'{path}, {log.place} {places[same[0] + 1]}: has the time of the reading '
                                   'before; '
                           'their mean counts', int(same.size), 'reading')
        starts = np.flatnonzero(np.concatenate([[True], steps_s > 0.0]))
        values = np.add.reduceat(values, starts) / np.diff(starts, append=len(values))
        time_s = time_s[starts]
    return Series(time_s, values)
