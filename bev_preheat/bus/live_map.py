# SPDX-License-Identifier: Apache-2.0
"""The live part of a signal map: the bus, how long a reading is valid, checks of messages, the heater's frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeVar

from bev_preheat.errors import InvalidInput
from bev_preheat.files.checked_yaml import FileData
from bev_preheat.logs.signal_map import (
    database_files,
    load_signal_map,
    read_source,
    SignalMap,
    Source,
    source_problems,
)
from bev_preheat.vehicle.description import HVCH

# Signals of a map that battery_state is made of.
BATTERY_SIGNALS = ('battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'power_w')
# Names of further readings in `valid_for_s_of`.
CELLS, CHARGING = 'cells_c', 'charging'
# Other signals of the car: the air, which changes slowly, and the speed.
AMBIENT, SPEED = 'ambient_c', 'speed_mps'
AMBIENT_VALID_FOR_S = 6 * 3600.0
LIVE_SIGNALS = (*BATTERY_SIGNALS, AMBIENT, SPEED)
REQUIRED = ('battery_temperature_c', 'soc')
VALID_FOR_S = {'can': 2.0, 'vss': 600.0}
# The interface whose channel is a recording of frames.
REPLAY = 'replay'
# Databrokers listen here by default.
BROKER_PORT = 55555


Rule = TypeVar('Rule')


@dataclass(frozen=True)
class CanSettings:
    """A bus as python-can opens it, bitrate [bit/s; None: the interface's own], and its DBC files."""

    interface: str
    channel: str | int
    bitrate: int | None = None
    options: Mapping[str, FileData] = field(default_factory=dict)
    databases: tuple[Path, ...] = ()


@dataclass(frozen=True)
class VssSettings:
    """A databroker; `conditioning`: whether BatteryConditioning is served."""

    host: str = '127.0.0.1'
    port: int = BROKER_PORT
    token: Path | None = None
    root_certificates: Path | None = None
    tls_server_name: str | None = None
    conditioning: bool = True


@dataclass(frozen=True)
class ChecksumRule:
    """The place of a message's checksum, computed by a `method` (CRCS) or an `e2e_profile` (PROFILES)."""

    signal: str
    method: str | None = None
    prefix: tuple[int, ...] = ()
    suffix: tuple[int, ...] = ()
    initial: int | None = None
    final_xor: int | None = None
    e2e_profile: int | None = None
    data_id: int | None = None
    data_ids: tuple[int, ...] = ()
    data_id_mode: str | None = None
    data_id_nibble: str | None = None

    @property
    def mode(self) -> str:
        """How the data ID takes part."""
        return 'list' if self.data_ids else self.data_id_mode or 'both'


@dataclass(frozen=True)
class MessageRule:
    """Checks of a CAN message beyond those of its DBC; None: as the DBC says, or not checked."""

    cycle_time_s: float | None = None
    counter: str | None = None
    largest_step: int | None = None
    checksum: ChecksumRule | None = None


@dataclass(frozen=True)
class CoolantLaw:
    """
    How a coolant set-point follows from the heater's power.

    It is the temperature of `follows` (MESSAGE.SIGNAL) plus power / `watts_per_kelvin` [W/K], within `range_c`
    [deg C].
    """

    follows: str
    watts_per_kelvin: float
    range_c: tuple[float, float]


@dataclass(frozen=True)
class HeaterFrameRule:
    """
    The CAN message that carries the heater's command; names are those of the DBC.

    `unit` '' is that of the DBC. `full_power_w` [W] is the power of a share of 100 %; None: the vehicle's.
    `off_value` is the value of the signal at 0 W; None: 0, or for a set-point any, because `enable` switches it
    off.
    """

    message: str
    power: str
    counter: str | None = None
    enable: str | None = None
    checksum: ChecksumRule | None = None
    period_s: float | None = None
    maximum_power_w: float | None = None
    constants: Mapping[str, float] = field(default_factory=dict)
    unit: str = ''
    full_power_w: float | None = None
    off_value: float | None = None
    coolant: CoolantLaw | None = None


@dataclass(frozen=True)
class HeaterStatusRule:
    """MESSAGE.SIGNAL of the heater's measured power, and of a fault (not 0); None: not given."""

    power: str | None = None
    fault: str | None = None
    valid_for_s: float = 1.0


class HeaterRules(NamedTuple):
    """The frame of a heat source's command, and its status; `key` begins both keys."""

    key: str
    command: HeaterFrameRule
    status: HeaterStatusRule


@dataclass(frozen=True)
class LiveMap:
    """
    A signal map with a live part; either `can` (one bus or more) or `vss` is given.

    `valid_for_s` has a time [s] for each of LIVE_SIGNALS, CELLS and CHARGING. `charging_values` are those of
    `charging_channel` while the battery is being charged. `heaters` are the commanded heat sources by name, the
    HVCH first.
    """

    signals: SignalMap
    can: tuple[CanSettings, ...]
    vss: VssSettings | None
    required: tuple[str, ...]
    valid_for_s: Mapping[str, float]
    cells: Source | None = None
    charging_channel: str | None = None
    charging_values: tuple[float, ...] = (1.0,)
    messages: Mapping[str, MessageRule] = field(default_factory=dict)
    heaters: Mapping[str, HeaterRules] = field(default_factory=dict)

    @property
    def sources(self) -> dict[str, Source]:
        """The Sources of LIVE_SIGNALS that the map has, and of CELLS."""
        found = {name: self.signals.sources[name] for name in LIVE_SIGNALS if name in self.signals.sources}
        return found if self.cells is None else {**found, CELLS: self.cells}


def load_live_map(name_or_file: str | Path) -> LiveMap:
    """Return the LiveMap of a name (config/signals) or a YAML file; raises InvalidInput."""
    signal_map = load_signal_map(name_or_file)
    path, live = signal_map.path, signal_map.live
    if live is None:
        raise InvalidInput(f'{path}: has no key live, which names the bus: add '
                           'live: {can: {interface: socketcan, channel: can0}}, or live: {vss: {}}')
    problems = []
    if sum(key in live for key in ('can', 'can_buses', 'vss')) != 1:
        problems.append(f'{path}: live: must have exactly one key: can, can_buses or vss')
    required = tuple(live.get('required', REQUIRED))
    problems += [f'{path}: live.required: {name} is not among the signals of the map'
                 for name in required if name not in signal_map.sources]
    # There is no second choice of a scale while signals arrive.
    problems += [f'{path}: signals.{name}.scale: a live signal needs one scale, not {len(source.scales)}'
                 for name, source in signal_map.sources.items()
                 if name in LIVE_SIGNALS and len(source.scales) > 1]
    problems += [f'{path}: signals.{name}.unit: a live signal needs one unit, not {1 + len(source.other_units)}'
                 for name, source in signal_map.sources.items() if name in LIVE_SIGNALS and source.other_units]
    if 'cells_c' in live:
        problems += [f'{path}: live.cells_c: {problem}'
                     for problem in source_problems('battery_temperature_c', live['cells_c'])]
    if 'can' in live and not signal_map.databases:
        problems.append(f'{path}: dbc: is missing; live CAN signals need the DBC files of the bus')
    problems += [f'{path}: live.can_buses[{number}].dbc: is missing; each of several buses needs its own DBC files'
                 for number, bus in enumerate(live.get('can_buses', ())) if 'dbc' not in bus]
    if 'heater_status' in live and 'heater_command' not in live:
        problems.append(f'{path}: live.heater_status: is the answer to live.heater_command, which is missing')
    if 'vss' in live:
        problems += [f'{path}: live.{key}: is for CAN only'
                     for key in ('messages', 'heater_command', 'heater_status', 'heat_sources') if key in live]
    heaters, senders = _heaters(live), dict[str, str]()
    problems += [f'{path}: {rules.key}command.message: {rules.command.message} is that of {first}command; each '
                 'heat source needs a message of its own' for rules in heaters.values()
                 if (first := senders.setdefault(rules.command.message, rules.key)) != rules.key]
    if problems:
        raise InvalidInput(problems)
    usual_s = live.get('valid_for_s', VALID_FOR_S['vss' if 'vss' in live else 'can'])
    charging = live.get('charging', {})
    return LiveMap(
        signal_map, _can_buses(live, signal_map), _vss(live.get('vss'), path.parent), required,
        {name: float(live.get('valid_for_s_of', {}).get(name, AMBIENT_VALID_FOR_S if name == AMBIENT else usual_s))
         for name in (*LIVE_SIGNALS, CELLS, CHARGING)},
        read_source('battery_temperature_c', live['cells_c'], signal_map.no_reading)
        if 'cells_c' in live else None,
        charging.get('channel'), tuple(map(float, charging.get('values', (1.0,)))),
        {name: _made(MessageRule, entry) for name, entry in live.get('messages', {}).items()}, heaters)


def _heaters(live: FileData) -> dict[str, HeaterRules]:
    entries = {name: (f'live.heat_sources.{name}.', entry) for name, entry in live.get('heat_sources', {}).items()}
    if 'heater_command' in live:
        hvch = {'command': live['heater_command'], 'status': live.get('heater_status', {})}
        entries = {HVCH: ('live.heater_', hvch), **entries}
    return {name: HeaterRules(key, _made(HeaterFrameRule, entry['command']),
                              _made(HeaterStatusRule, entry.get('status', {})))
            for name, (key, entry) in entries.items()}


def _can_buses(live: FileData, signal_map: SignalMap) -> tuple[CanSettings, ...]:
    folder, entries = signal_map.path.parent, live.get('can_buses', [live['can']] if 'can' in live else [])
    return tuple(CanSettings(
        entry['interface'],
        str(folder / str(entry['channel'])) if entry['interface'] == REPLAY else entry['channel'],
        entry.get('bitrate'), entry.get('options', {}),
        database_files(folder, entry['dbc']) if 'dbc' in entry else signal_map.databases) for entry in entries)


def _vss(entry: FileData, folder: Path) -> VssSettings | None:
    if entry is None:
        return None
    return VssSettings(**{**entry, **{key: folder / entry[key] for key in ('token', 'root_certificates')
                                      if key in entry}})


def _made(kind: type[Rule], entry: FileData) -> Rule:
    """Return a rule of an entry of the map, with the rules in it."""
    inner = {'checksum': ChecksumRule, 'coolant': CoolantLaw}
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}
    return kind(**{**values, **{key: _made(inner[key], entry[key]) for key in inner if key in entry}})
