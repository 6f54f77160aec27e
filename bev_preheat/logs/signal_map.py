# SPDX-License-Identifier: Apache-2.0
"""Signal maps: which channel of a log is which signal, in which unit, sign and scale (YAML)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
import re
from typing import Any

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.input_files import configuration_folder, find_configuration
from bev_preheat.files.units import check_unit, Conversion, LONGEST_NAME, MOST_NAMES, own_unit, split_unit
from bev_preheat.logs.recording import SIGNALS

SCHEMA = Path(__file__).with_name('signal_map_schema.yaml')
SUFFIX = '.yaml'
# The map for logs that no other map recognises.
COMMON = 'common'
# Plausible values (low, high) of the signals, in their own units; others are dropped. Speeds in a wrong unit pass,
# so that the mix-up can be reported and repaired.
PLAUSIBLE = {
    'battery_temperature_c': (-50.0, 90.0), 'soc': (0.0, 1.01), 'voltage_v': (20.0, 1500.0),
    'current_a': (-3000.0, 3000.0), 'power_w': (-2e6, 2e6), 'speed_mps': (0.0, 350.0),
    'elevation_m': (-500.0, 9000.0), 'ambient_c': (-60.0, 60.0), 'heater_w': (0.0, 50e3),
    'battery_heater_w': (0.0, 50e3), 'cabin_heater_w': (0.0, 50e3), 'auxiliary_w': (0.0, 50e3),
    'aircon_w': (0.0, 50e3),
    'propulsion_power_w': (-2e6, 2e6), 'coolant_c': (-60.0, 130.0), 'latitude_deg': (-90.0, 90.0),
    'longitude_deg': (-180.0, 180.0), 'odometer_m': (0.0, 1e10)}


# Last parts of dotted paths that mean something only with the parts before: TractionBattery.StateOfCharge.Current.
NOT_ALONE = frozenset(('average', 'current', 'level', 'max', 'mean', 'min', 'power', 'range', 'speed', 'state',
                       'temperature', 'time', 'value', 'voltage'))


@dataclass(frozen=True)
class Source:
    """
    Where a signal comes from, and how its readings are converted.

    `channels` are names, or patterns between slashes, in order of preference; all channels of the first entry that
    matches any are combined (`combine`: mean, min, max, first; empty: the mean of alike ones). `unit` is empty if
    the log names it; `other_units` are used if the readings have them rather than that. `scales`: factors on the
    reading, the first that makes the signal plausible counts; then `offset` is added, and the unit converted.
    `at_least`, if above 0, is how many channels must be valid; then the channels of all entries are combined.
    `no_reading` are readings that mean none; `plausible` is the range in the signal's unit.
    """

    signal: str
    channels: tuple[str, ...]
    combine: str = ''
    unit: str = ''
    other_units: tuple[str, ...] = ()
    scales: tuple[float, ...] = (1.0,)
    offset: float = 0.0
    charging_is_positive: bool = False
    no_reading: tuple[float, ...] = ()
    plausible: tuple[float, float] = (-1e300, 1e300)
    at_least: int = 0

    def in_own_unit(self, readings: Any, scale: float, conversion: Conversion) -> Any:
        """Return readings (a float or an array) in the signal's own unit and sign; `scale` is one of `scales`."""
        own = (readings * scale + self.offset) * conversion.factor + conversion.offset
        return -own if self.charging_is_positive else own

    def only(self, entry: str) -> Source:
        """Return this Source with one of its entries alone."""
        return replace(self, channels=(entry,))


@dataclass(frozen=True)
class SignalMap:
    """
    A signal map: Sources by signal, channels with the time, channels that identify the log, DBC files.

    `no_reading` are readings of any channel that mean none. `inherited` are the signals of the map that this one
    extends; the channels of its own signals are not theirs.
    `live` is the part on live signals as it stands in the file at `path`, None without one; bus.live_map reads it.
    """

    name: str
    sources: dict[str, Source]
    time: tuple[str, ...] = ()
    recognised_by: tuple[str, ...] = ()
    databases: tuple[Path, ...] = ()
    no_reading: tuple[float, ...] = ()
    live: FileData = None
    path: Path = Path()
    inherited: frozenset[str] = frozenset()

    @property
    def file_name(self) -> str:
        """The name by which another map extends this one: of a shipped map, else of its file."""
        return self.path.stem if self.path.parent == configuration_folder('signals') else self.path.name

    def recognises(self, names: Sequence[str]) -> bool:
        """Return whether a log with these channels belongs to this map."""
        return bool(self.recognised_by) and all(
            any(matches(entry, name) for name in names) for entry in self.recognised_by)

    def means(self, names: Sequence[str]) -> bool:
        """Return whether a signal of this map's own means any of these channels."""
        return any(matches(entry, name) for signal, source in self.sources.items() if signal not in self.inherited
                   for entry in source.channels for name in names)


def is_expression(entry: str) -> bool:
    """Return whether an entry of a map is a regular expression between slashes."""
    return len(entry) > 2 and entry[0] == entry[-1] == '/'


def matches(entry: str, name: str, touches_last: bool = False) -> bool:
    """
    Return whether an entry of a map, a name or a pattern between slashes, means a channel.

    With `touches_last` a pattern must match something of the last part of a dotted name: a channel is not a
    temperature because its message has some.
    """
    if len(name) > LONGEST_NAME:
        return False
    last = name.rpartition('.')[2]
    if is_expression(entry):
        found = re.finditer(entry[1:-1], name, re.IGNORECASE)
        return any(not touches_last or match.end() > len(name) - len(last) for match in found)
    return plain(entry) in (plain(name), plain(split_unit(name).name)) or (
        plain(entry) == plain(last) and plain(last) not in NOT_ALONE)


@lru_cache(MOST_NAMES)
def plain(name: str) -> str:
    """Return a name in the form in which names are compared."""
    return ' '.join(re.sub(r'[\s_\-]+', ' ', name).split()).casefold()


def load_signal_map(name_or_file: str | Path) -> SignalMap:
    """Return the SignalMap of a name in config/signals or a YAML file; InvalidInput names key, value and range."""
    return _load(find_configuration('signals', name_or_file, SUFFIX), ())


def _load(path: Path, extended_by: tuple[Path, ...]) -> SignalMap:
    contents = load_checked_yaml(path, SCHEMA)
    problems: list[str] = []
    base = _extended(path, contents.get('extends'), extended_by)
    everywhere = tuple(map(float, contents.get('no_reading', () if base is None else base.no_reading)))
    sources = {}
    for signal, entry in contents['signals'].items():
        if signal not in SIGNALS:
            problems.append(f'{path}: signals.{signal} is unknown; known: {", ".join(SIGNALS)}')
            continue
        problems += [f'{path}: signals.{signal}: {problem}' for problem in source_problems(signal, entry)]
        sources[signal] = read_source(signal, entry, everywhere)
    problems += [f'{path}: {problem}' for key in ('time', 'recognised_by')
                 for problem in _bad_patterns(contents.get(key, ()))]
    if problems:
        raise InvalidInput(problems)
    own = SignalMap(contents.get('name', path.stem), sources, _texts(contents.get('time', ())),
                    _texts(contents.get('recognised_by', ())),
                    database_files(path.parent, contents.get('dbc', _of_buses(contents))),
                    everywhere, contents.get('live'), path)
    if base is None:
        return own
    return replace(own, sources={**base.sources, **sources}, time=own.time or base.time,
                   databases=own.databases or base.databases,
                   inherited=frozenset(base.sources) - frozenset(sources))


def _extended(path: Path, name: FileData, extended_by: tuple[Path, ...]) -> SignalMap | None:
    """Return the map that the one at `path` extends: a shipped name, or a file relative to it; None without."""
    if name is None:
        return None
    if path in extended_by:
        raise InvalidInput(f'{path}: extends: {name}: extends itself')
    file = path.parent / name
    return _load(file if file.suffix == SUFFIX and file.is_file() else find_configuration('signals', name, SUFFIX),
                 (*extended_by, path))


@cache
def shipped_maps() -> tuple[SignalMap, ...]:
    """Return the signal maps of config/signals, the common one last."""
    names = sorted(path.stem for path in configuration_folder('signals').glob(f'*{SUFFIX}'))
    return tuple(load_signal_map(name) for name in sorted(names, key=lambda name: name == COMMON))


def recognised_map(names: Sequence[str]) -> SignalMap:
    """Return the shipped map that recognises these channels, with the common names for its missing signals."""
    *maps, common = shipped_maps()
    found = next((each for each in maps if each.recognises(names)), None)
    if found is None:
        return common
    own = {signal: source for signal, source in found.sources.items()
           if any(matches(entry, name) for entry in source.channels for name in names)}
    usual = {signal: replace(source, channels=tuple(each for each in source.channels if not is_expression(each)))
             for signal, source in common.sources.items() if signal not in own}
    return replace(found, sources={**own, **usual}, inherited=frozenset(usual))


def database_files(folder: Path, files: FileData) -> tuple[Path, ...]:
    """Return the paths of DBC files that a map in a folder names."""
    return tuple(folder / file for file in _texts(files))


def _of_buses(contents: FileData) -> list[str]:
    """Return the DBC files of the buses of a map, for logs."""
    return [file for bus in contents.get('live', {}).get('can_buses', ()) for file in _texts(bus.get('dbc', ()))]


def _texts(value: FileData) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else tuple(value)


def read_source(signal: str, entry: FileData, everywhere: tuple[float, ...]) -> Source:
    """Return the Source of a signal's entry in a map; `everywhere` are readings of any channel that mean none."""
    if isinstance(entry, str | list):
        entry = {'channels': entry}
    scale = entry.get('scale', 1.0)
    unit, *others = _texts(entry.get('unit', ''))
    return Source(
        signal, _texts(entry['channels']), entry.get('combine', ''), unit, tuple(others),
        tuple(map(float, scale if isinstance(scale, list) else [scale])), float(entry.get('offset', 0.0)),
        entry.get('positive') == 'charging', everywhere + tuple(map(float, entry.get('no_reading', ()))),
        tuple(map(float, entry.get('range', PLAUSIBLE[signal]))),  # type: ignore[arg-type]
        entry.get('at_least', 0))


def source_problems(signal: str, entry: FileData) -> Iterable[str]:
    """Yield sentences on faults of an entry that the schema cannot find."""
    if isinstance(entry, str | list):
        entry = {'channels': entry}
    yield from _bad_patterns(entry['channels'])
    try:
        for unit in _texts(entry.get('unit', own_unit(signal))):
            check_unit(unit, signal)
    except InvalidInput as error:
        yield from (f'unit: {problem}' for problem in error.problems)
    low, high = entry.get('range', PLAUSIBLE[signal])
    if low >= high:
        yield f'range: {low:g} is not below {high:g}'
    if 'at_least' in entry and entry.get('combine') == 'first':
        yield 'at_least: needs combine: mean, min or max'
    if 'positive' in entry and signal not in ('current_a', 'power_w'):
        yield 'positive: only current_a and power_w have a sign of charging'


def _bad_patterns(entries: FileData) -> Iterable[str]:
    for entry in _texts(entries):
        if is_expression(entry):
            try:
                re.compile(entry[1:-1])
            except (re.error, RecursionError, OverflowError) as error:
                yield f'{quoted(entry)} is not a regular expression: {error}'
