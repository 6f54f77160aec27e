# SPDX-License-Identifier: Apache-2.0
"""Reads a log of any known format, found by its content, into a Recording in SI units; refuses several cars."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
import re

import numpy as np

from bev_preheat.errors import figure, InvalidInput, quoted, shortened
from bev_preheat.files.table import encoding_of, read_head
from bev_preheat.files.units import is_stated, measures, split_unit, unit_named
from bev_preheat.logs.assembly import Assembly
from bev_preheat.logs.can_frames import open_can_frames
from bev_preheat.logs.choice import all_candidates, Candidates
from bev_preheat.logs.csv_log import open_csv_log
from bev_preheat.logs.decoding import Decoder
from bev_preheat.logs.doubts import find_doubts, J_PER_KWH
from bev_preheat.logs.heater_response import heater_response
from bev_preheat.logs.json_lines import open_json_lines
from bev_preheat.logs.mdf import open_mdf
from bev_preheat.logs.raw_log import RawLog, Remarks
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.logs.ros_bag import is_bag_folder, open_ros_bag, RosBag
from bev_preheat.logs.signal_map import load_signal_map, plain, recognised_map, SignalMap
from bev_preheat.numerics import no_position

# Each takes a path, the file's first bytes and the DBC files, and returns the open log, None for another format.
FORMATS: tuple[Callable[[str | Path, bytes, Collection[str | Path]], RawLog | None], ...] = (
    open_mdf, open_can_frames, open_ros_bag, open_json_lines, open_csv_log)
# The beginnings of files of other kinds, and what to do with them.
OTHERS = (
    (rb'PAR1', 'a Parquet file', 'write it as CSV'),
    (rb'PK\x03\x04|\xd0\xcf\x11\xe0', 'a spreadsheet or an archive', 'save the sheet as CSV, or unpack it'),
    (rb'\x1f\x8b|7z|BZh|\x28\xb5\x2f\xfd', 'packed', 'unpack it'),
    (rb'\x89HDF|MATLAB', 'a file of MATLAB or HDF5', 'write it as CSV'),
    (rb'(?s)SQLite format 3\0.*arbitration_id', 'a database of python-can', 'convert it with can_logconvert'),
    (rb'(?s)SQLite format 3\0(?!.*topics)', 'a database', 'export its table as CSV'),
    (rb'[^\0]{0,50000}?\b(CREATE TABLE|INSERT INTO) ', 'a dump of a database', 'export its table as CSV'),
    (rb'\s*<', 'XML or HTML', 'a GPX is a route: give it to --route'),
    (rb'\$[A-Z]{2}(RMC|GGA)', 'a log of a receiver (NMEA)', 'convert it to GPX and give it to --route'),
    (rb'[^\s,=#]+(,\S+=\S+)* \S+=\S+ \d{10,19}\s', "InfluxDB's line protocol", 'export it as CSV'))


def open_log(path: str | Path, databases: Collection[str | Path] = ()) -> RawLog:
    """Return the open log of a file or rosbag2 folder, with DBC files; refuse unknown formats."""
    if is_bag_folder(path):
        return RosBag(path)
    head = read_head(path)
    for beginning, words, advice in OTHERS:
        if re.match(beginning, head):
            raise InvalidInput(f'{path}: is {words}, which is not read; {advice}')
    for open_format in FORMATS:
        log = open_format(path, head, databases)
        if log is not None:
            return log
    if encoding_of(head) is not None:
        raise InvalidInput(f'{path}: is text, but no log: a CSV log has a header that names its columns and '
                           'lines of values below it, JSON lines have an object a line, candump has (time) '
                           'channel frame')
    raise InvalidInput(f'{path}: is no log of a known format; known: CSV with a header (one column a signal, or '
                       'SECONDS;PID;VALUE;UNITS), JSON lines, MDF, candump, ASC or BLF with a DBC, MCAP and '
                       'rosbag2')


LONGEST_LIST = 400
HIGHEST_SPEED_MPS = 100.0
# Jumps of the state of charge and of the odometer [m] within a time [s] that no car makes to and fro; with two
# cars in a log they turn at least so often. Medians leave out single wrong readings.
LEAST_SOC_JUMP, LEAST_ODOMETER_JUMP_M, LONGEST_JUMP_S = 0.03, 2000.0, 120.0
LEAST_TURNS, MEDIAN_OF = 5, 5
# Commands to other heat sources in recordings of the planner's topics.
OTHER_SOURCES = re.compile(r'(.*/)?heat_source_command\.battery_heating_power')
# Names of channels that identify the car.
CAR = re.compile(r'(.*\.)?((car|veh(icle)?)( ?(id|no|nr|num(ber)?|name))?|vin)')


def read_recording(path: str | Path, signals: str | Path | SignalMap | None = None,
                   repair: bool = False, only: Collection[str] | None = None) -> Recording:
    """
    Return the Recording of a log.

    `signals` is a signal map: a name in config/signals, a YAML file or a SignalMap; None, or if it names none of
    the log's channels: the map that recognises them, else the common one. Doubts about sign, unit or scale are
    among the remarks; with `repair` they are corrected. `only` names the signals that are read (None: all). Power
    is added as voltage times current if the log has none. Raises InvalidInput naming file, place, value and range.
    """
    given = signals if signals is None or isinstance(signals, SignalMap) else load_signal_map(signals)
    log = open_log(path, () if given is None else given.databases)
    units = {channel.name: channel.unit for channel in log.channels}
    remarks = Remarks()
    signal_map = recognised_map(list(units))
    if given is not None and (given.means(list(units)) or not signal_map.recognises(list(units))):
        signal_map = given
    elif given is not None:
        remarks.add('map', f'{path}: the signal map {given.name} names none of its channels; {signal_map.name}, '
                    'which knows them, is used')
    found = {signal: each for signal, each in all_candidates(signal_map, units).items()
             if only is None or signal in only}
    chosen = {signal: each.groups for signal, each in found.items() if each.groups}
    _remark_on_excluded(path, found, units, remarks)
    if not chosen:
        raise InvalidInput([
            f'{path}: none of its channels is a signal of the signal map {signal_map.name}; the channels are '
            f'{shortened(", ".join(units), LONGEST_LIST)}; name them in a signal map', *remarks.sentences()])
    log.use(signal_map)
    for channel in {each for groups in chosen.values() for group in groups for each in group
                    if f'{each} #2' in units}:
        remarks.add(f'twice {channel}', f'{path}: {channel} is named more than once; the first counts')
    full = {channel.name: channel.full for channel in log.channels}
    decoders = {
        (signal, channel): Decoder(signal_map.sources[signal], channel, units[channel], log.decimal, full[channel],
                                   signal_map is not given)
        for signal, groups in chosen.items() for group in groups for channel in group}
    assembly = Assembly(path, log, decoders, remarks, repair)
    cars: dict[str, set[str]] = {name: set() for name in units if CAR.fullmatch(plain(name))}
    commanded_w = {name: 0.0 for name in units if OTHER_SOURCES.fullmatch(name)}
    for piece in log.pieces(dict.fromkeys([*cars, *commanded_w, *(channel for _, channel in decoders)]), remarks):
        if piece.channel in cars:
            cars[piece.channel].update(str(each) for each in set(piece.values))
            _refuse_several(path, piece.channel, cars[piece.channel])
        if piece.channel in commanded_w:
            commanded_w[piece.channel] = float(np.fmax.reduce(
                np.array(piece.values, dtype=float), initial=commanded_w[piece.channel]))
        assembly.take(piece)
    series, used = assembly.series(chosen)
    sources = {signal: tuple(_described(decoders[signal, channel]) for channel in channels)
               for signal, channels in used.items()}
    _remark_on_topics(path, chosen, used, remarks)
    _refuse_to_and_fro(path, series)
    _drop_no_position(path, series, remarks)
    _judge(path, series, remarks, repair)
    _drop_too_fast(path, series, remarks)
    _add_power(series, sources)
    _remark_on_heater(path, signal_map, series, sources, remarks)
    for name, most_w in commanded_w.items():
        if most_w > 0.0:
            remarks.add(name, f'{path}: {name}: other heat sources than the HVCH were commanded, up to '
                        f'{most_w:.0f} W; no signal has their heat or cold, so predictions leave it out')
    if not series:
        raise InvalidInput([f'{path}: no signal has a valid reading', *remarks.sentences()])
    start_s = min(float(each.time_s[0]) for each in series.values())
    return Recording(
        name=Path(path).stem,
        signals={signal: Series(each.time_s - start_s, each.value) for signal, each in series.items()},
        start_s=start_s if log.absolute else None, signal_map=signal_map.name, remarks=remarks.sentences(),
        format=log.format, sources=sources, unused=_unused(log, used, found))


def _described(decoder: Decoder) -> str:
    unit = unit_named(decoder.given.unit) or decoder.given.unit
    named = unit and split_unit(decoder.channel).unit != unit
    return f'{decoder.channel} [{decoder.given.unit}]' if named else decoder.channel


def _remark_on_excluded(path: str | Path, found: dict[str, Candidates], units: dict[str, str],
                        remarks: Remarks) -> None:
    for signal, each in found.items():
        for name in each.excluded:
            unit = units[name]
            if is_stated(name, unit) and not measures(unit, signal):
                remarks.add(f'excluded {signal}', f'{path}: {name}: has the unit {unit}, so it is not taken for '
                            f'{signal}', noun='channel')
            elif not each.groups:
                remarks.add(f'excluded {signal}', f'{path}: {name}: has the name of a counter, check, state, '
                            f'limit or direction, so it is not taken for {signal}', noun='channel')


def _refuse_several(path: str | Path, channel: str, cars: set[str]) -> None:
    cars.difference_update(('', 'nan'))
    if len(cars) > 1:
        raise InvalidInput(f'{path}: {channel} is {" and ".join(map(quoted, sorted(cars)[:2]))}; a log must be of '
                           'one car: split it')


def _refuse_to_and_fro(path: str | Path, series: dict[str, Series]) -> None:
    """Refuse a log whose state of charge or odometer alternates, as those of two cars in one log do."""
    for signal, least in (('soc', LEAST_SOC_JUMP), ('odometer_m', LEAST_ODOMETER_JUMP_M)):
        if signal not in series:
            continue
        each = series[signal]
        if len(each.value) < MEDIAN_OF:
            continue
        values = np.median(np.lib.stride_tricks.sliding_window_view(each.value, MEDIAN_OF), axis=1)
        steps, at = np.diff(values), MEDIAN_OF // 2
        large = np.flatnonzero((np.abs(steps) > least) & (np.diff(each.time_s)[at:-at] <= LONGEST_JUMP_S))
        if int((np.diff(np.sign(steps[large])) != 0.0).sum()) >= LEAST_TURNS:
            raise InvalidInput(f'{path}: {signal} jumps to and fro between {figure(values[large[0]])} and '
                               f'{figure(values[large[0] + 1])}; a log must be of one car: split it')


def _remark_on_topics(path: str | Path, chosen: dict[str, tuple[tuple[str, ...], ...]],
                      used: dict[str, tuple[str, ...]], remarks: Remarks) -> None:
    """Remark that a topic was chosen among several of one name, such as those of two cars or batteries."""
    for signal, names in used.items():
        topic, _, field = names[0].rpartition('/')
        for other in (name for group in chosen[signal] for name in group if name not in names):
            if '/' in other and other.rpartition('/')[2] == field:
                remarks.add(f'topics {topic} {other.rpartition("/")[0]}', f'{path}: {names[0]} counts for '
                            f'{signal}, {other} does not; to read that, name it in a signal map', noun='signal')


def _drop_no_position(path: str | Path, series: dict[str, Series], remarks: Remarks) -> None:
    """Drop the positions that receivers write without a fix."""
    if not {'latitude_deg', 'longitude_deg'} <= series.keys():
        return
    latitude, longitude = series['latitude_deg'], series['longitude_deg']
    for signal, each in (('latitude_deg', latitude), ('longitude_deg', longitude)):
        missing = no_position(latitude.at(each.time_s), longitude.at(each.time_s))
        if missing.any():
            remarks.add_shared('position', f'{path}: latitude_deg and longitude_deg: 0, 0 means no position; it '
                               'is dropped', int(missing.sum()), 'sample')
            del series[signal]
            if not missing.all():
                series[signal] = each.part(~missing)


def _unused(log: RawLog, used: dict[str, tuple[str, ...]], found: dict[str, Candidates]) -> tuple[str, ...]:
    """Return the channels that were not used, without those of the time; first those like a signal."""
    read = {channel for channels in used.values() for channel in channels} | set(log.times)
    alike = [name for each in found.values() for name in (*(name for group in each.groups for name in group),
                                                          *each.excluded)]
    return tuple(name for name in dict.fromkeys([*alike, *(channel.name for channel in log.channels)])
                 if name not in read)


def _judge(path: str | Path, series: dict[str, Series], remarks: Remarks, repair: bool) -> None:
    """Remark on doubts about the signals, and correct them on request."""
    # A corrected speed or current may settle the doubt about another signal.
    for _ in range(len(series)):
        doubts = find_doubts(series)
        clear = [doubt for doubt in doubts if doubt.is_clear]
        for doubt in clear[:1] if repair and clear else doubts:
            done = 'name the unit in a signal map' if not doubt.is_clear else 'repaired' if repair else (
                'to correct it, read the log with repair (--repair) or a signal map')
            remarks.add(f'doubt {doubt.signal} {doubt.factor:g}', f'{path}: {doubt.sentence} {done}'
                        if doubt.sentence.endswith('?') else f'{path}: {doubt.sentence}; {done}')
            if repair and doubt.is_clear:
                series[doubt.signal] = doubt.repaired(series[doubt.signal])
        if not clear or not repair:
            return


def _drop_too_fast(path: str | Path, series: dict[str, Series], remarks: Remarks) -> None:
    """Drop speeds that no car reaches, now that their unit is as good as it gets."""
    speed = series.get('speed_mps')
    if speed is None or (speed.value <= HIGHEST_SPEED_MPS).all():
        return
    good = speed.value <= HIGHEST_SPEED_MPS
    at = int(np.argmin(good))
    after_s = speed.time_s[at] - speed.time_s[0]
    remarks.add('fast', f'{path}: speed_mps: {figure(speed.value[at])} at {figure(after_s)} s is dropped '
                f'(plausible: 0 ... {HIGHEST_SPEED_MPS:g})', int((~good).sum()))
    if good.any():
        series['speed_mps'] = speed.part(good)
    else:
        del series['speed_mps']


def _remark_on_heater(path: str | Path, signal_map: SignalMap, series: dict[str, Series],
                      sources: dict[str, tuple[str, ...]], remarks: Remarks) -> None:
    """Remark that a heater warms the battery, which a name for battery and cabin together leaves open."""
    response = heater_response(series)
    if response is not None:
        channel = sources['heater_w'][0]
        named = split_unit(channel.rpartition(' [')[0] or channel).name.replace("'", "''")
        remarks.add('heater', f'{path}: heater_w: battery_temperature_c answers to it, by {response.rise_k:.0f} K '
                    f'to {response.energy_j / J_PER_KWH:.1f} kWh; if it heats the battery, name it in a map: '
                    f"{{extends: {signal_map.file_name}, signals: {{battery_heater_w: '{named}'}}}}")


def _add_power(series: dict[str, Series], sources: dict[str, tuple[str, ...]]) -> None:
    """Add the power as voltage times current, at the instants of the current that the voltage covers."""
    if 'power_w' in series or not {'voltage_v', 'current_a'} <= series.keys():
        return
    voltage, current = series['voltage_v'], series['current_a']
    inside = (current.time_s >= voltage.time_s[0]) & (current.time_s <= voltage.time_s[-1])
    if inside.any():
        time_s = current.time_s[inside]
        series['power_w'] = Series(time_s, voltage.at(time_s) * current.value[inside])
        sources['power_w'] = ('voltage_v x current_a',)
