# SPDX-License-Identifier: Apache-2.0
"""
A live source of the battery, and of other signals of the car: the latest and the valid readings of a bus.

A reading is in the signal's own unit, with its instant and the latest doubt. Instants are on a steady clock: steps
of the system's clock change no age.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import itertools
import math
from threading import Lock
import time

import numpy as np

from bev_preheat.bus.live_map import BATTERY_SIGNALS, CELLS, CHARGING, LiveMap
from bev_preheat.errors import figure, InvalidInput, located
from bev_preheat.files.units import check_unit, conversion, own_unit
from bev_preheat.logs.choice import candidates
from bev_preheat.logs.signal_map import Source
from bev_preheat.numerics import present_cells

# A stamp this far from the system's clock is another clock's: some adapters count from their own start [s].
FAR_S = 3600.0
# The latest doubt about a channel is shown for this time [s].
DOUBT_SHOWN_S = 10.0


def steady_s() -> float:
    """Return the seconds since the computer started, including those in which it slept."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def age_of_stamp(stamp_s: float | None) -> float:
    """Return the age [s] of a stamp of the system's clock [s], at least 0; 0 for a stamp of another clock."""
    age_s = time.time() - (stamp_s or 0.0)
    return age_s if 0.0 <= age_s <= FAR_S else 0.0


@dataclass(frozen=True)
class Reading:
    """A value, and the instant [s] at which it was known to hold."""

    value: float
    instant_s: float


class LiveChannel:
    """One channel as one signal: validity, scale, sign, unit."""

    def __init__(self, name: str, source: Source, channel_unit: str) -> None:
        """
        Take the unit in which the bus has the channel ('' if it names none).

        Raises InvalidInput if neither map nor bus names a unit, or if the bus's unit measures another quantity.
        """
        self.name = name
        self._source = source
        unit = source.unit or channel_unit
        if not unit:
            raise InvalidInput(f'{name} has no unit; name it in the signal map (unit: ...)')
        with located(name):
            check_unit(unit, source.signal)
        self._conversion = conversion(unit, own_unit(source.signal))

    def read(self, number: float) -> float:
        """Return a reading in the signal's own unit; raises InvalidInput if it means none or is implausible."""
        source = self._source
        if not math.isfinite(number):
            raise InvalidInput(f'{self.name}: {number} is no reading')
        if any(abs(number - nothing) <= 1e-9 * max(abs(nothing), 1.0) for nothing in source.no_reading):
            raise InvalidInput(f'{self.name}: {figure(number)} means no reading')
        own: float = source.in_own_unit(number, source.scales[0], self._conversion)
        low, high = source.plausible
        if not low <= own <= high:
            unit = own_unit(source.signal).replace('1', 'as a share')
            raise InvalidInput(f'{self.name}: {figure(own)} {unit} is implausible; '
                               f'{figure(low)} ... {figure(high)} is allowed')
        return own


class Readings:
    """The latest valid reading and doubt of each (signal, channel), at instants [s]; thread-safe."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._latest: dict[tuple[str, str], Reading] = {}
        self._doubts: dict[str, tuple[float, str]] = {}

    def put(self, signal: str, channel: str, value: float, instant_s: float) -> None:
        """Record a valid reading."""
        with self._lock:
            self._latest[signal, channel] = Reading(value, instant_s)

    def drop(self, signal: str, channel: str) -> None:
        """Drop the reading of a channel, because it no longer holds."""
        with self._lock:
            self._latest.pop((signal, channel), None)

    def doubt(self, cause: str, sentence: str, instant_s: float) -> None:
        """Record that something of `cause` (a channel, a message) was dropped, and why."""
        with self._lock:
            self._doubts[cause] = (instant_s, sentence)

    def latest(self, signal: str, channel: str) -> Reading | None:
        """Return the latest valid Reading; None before the first."""
        with self._lock:
            return self._latest.get((signal, channel))

    def doubts(self, now_s: float) -> dict[str, str]:
        """Return the sentences on doubts of the last DOUBT_SHOWN_S, by cause."""
        with self._lock:
            return {cause: sentence for cause, (instant_s, sentence) in self._doubts.items()
                    if 0.0 <= now_s - instant_s <= DOUBT_SHOWN_S}

    def forget(self) -> None:
        """Drop all readings, because their instants no longer count (a clock that fell back)."""
        with self._lock:
            self._latest.clear()
            self._doubts.clear()


# The channels of each signal: a tuple for each entry of its Source that has any on the bus.
Channels = Mapping[str, tuple[tuple[LiveChannel, ...], ...]]


def live_channels(sources: Mapping[str, Source], units: Mapping[str, str],
                  where: str) -> Channels:
    """
    Return the channels of each signal among those of a bus.

    `units` maps the bus's channels to their units ('' if unknown). Raises InvalidInput for channels
    without a unit; `where` names the map.
    """
    found, problems = {}, []
    for signal, source in sources.items():
        groups, key = [], f'{where}: live.{signal}' if signal == CELLS else f'{where}: signals.{signal}'
        for names in _groups(source, units):
            try:
                groups.append(tuple(LiveChannel(name, source, units[name]) for name in names))
            except InvalidInput as error:
                problems += [f'{key}: {problem}' for problem in error.problems]
            if len(names) < source.at_least:
                problems.append(f'{key}.at_least: {source.at_least} channels are needed, but the bus has only '
                                f'{", ".join(names)}')
        found[signal] = tuple(groups)
    if problems:
        raise InvalidInput(problems)
    return found


def _groups(source: Source, units: Mapping[str, str]) -> list[tuple[str, ...]]:
    """Return the channels of each entry that matches any, in the map's order of preference."""
    parts = [source] if source.at_least else [source.only(entry) for entry in source.channels]
    found = [candidates(part, units) for part in parts]
    # Of an entry that means nothing but wrong channels, the error names them.
    return [group for each in found for group in each.groups[:1] or filter(None, [each.excluded])]


def by_channel(channels: Channels) -> dict[str, list[tuple[str, LiveChannel]]]:
    """Return the signals that read each channel, by its name."""
    found: dict[str, list[tuple[str, LiveChannel]]] = {}
    for signal, groups in channels.items():
        for channel in {each.name: each for group in groups for each in group}.values():
            found.setdefault(channel.name, []).append((signal, channel))
    return found


# Values that are sent on change only hold no longer than this after the connection's last sign of life [s].
CONNECTION_LOST_S = 3.0
COMBINED: Mapping[str, Callable[[Sequence[float]], float]] = {
    'mean': lambda values: sum(values) / len(values), 'min': min, 'max': max, 'first': lambda values: values[0]}


@dataclass(frozen=True)
class LiveBattery:
    """
    The battery now.

    Temperatures in deg C, `soc` 0 ... 1, voltage [V], current [A] (positive while discharging); None: unknown.
    `instant_s` is that of the oldest reading in it; `missing` are sentences on optional signals that are not
    valid.
    """

    temperature_c: float | None
    soc: float | None
    voltage_v: float | None
    current_a: float | None
    cells_c: tuple[float, ...]
    is_charging: bool | None
    instant_s: float
    missing: tuple[str, ...] = ()


@dataclass
class View:
    """
    The readings of a LiveSource at one instant.

    On a bus that sends values on change only, `confirmed_s` is the latest instant [s] at which its connection was
    alive: until then, the latest values hold. `oldest_s` is the instant of the oldest reading used so far [s];
    `missing` are sentences on signals that are not valid.
    """

    live_map: LiveMap
    channels: Channels
    readings: Readings
    now_s: float
    confirmed_s: float | None

    def __post_init__(self) -> None:
        self.oldest_s = self.now_s
        self.missing = {signal: f'{signal}: is not on the bus' for signal in self.live_map.sources
                        if not self.channels.get(signal)}

    @property
    def is_lost(self) -> bool:
        """Whether nothing is valid any more, because the connection is silent."""
        return self.confirmed_s is not None and self.now_s - self.confirmed_s > CONNECTION_LOST_S

    def value(self, signal: str) -> float | None:
        """Return a signal by the first entry of its Source that is valid as a whole."""
        for group in self.channels.get(signal, ()):
            source = self.live_map.sources[signal]
            found = [self._valid(signal, channel.name) for channel in group]
            used = [reading for reading in found if reading is not None]
            if signal.endswith('_c') and len(used) > 1:
                present = np.isfinite(present_cells(np.array([reading.value for reading in used])))
                for reading in itertools.compress(used, ~present):
                    self.missing[signal] = (f'{signal}: {figure(reading.value)} degC far from the others is a '
                                            'module that is not there')
                used = list(itertools.compress(used, present))
            if len(used) == len(found):
                self.missing.pop(signal, None)
            elif source.at_least:
                self.missing[signal] += f'; {len(used)} of {len(found)} channels are valid'
            if len(used) >= (source.at_least or len(found)):
                self.oldest_s = min([self.oldest_s, *(self._held_s(reading) for reading in used)])
                return float(COMBINED[source.combine or 'mean']([reading.value for reading in used]))
            if source.at_least:
                self.missing[signal] += f', at least {source.at_least} are needed'
        return None

    def all_values(self, signal: str) -> tuple[float, ...]:
        """Return the valid values of every channel of a signal; NaN for each that is not."""
        values = []
        for name in dict.fromkeys(channel.name for group in self.channels.get(signal, ()) for channel in group):
            value = self.reading(signal, name)
            values.append(math.nan if value is None else value)
        return tuple(values)

    def reading(self, signal: str, channel: str) -> float | None:
        """Return the valid value of a channel, None without one."""
        reading = self._valid(signal, channel)
        if reading is None:
            return None
        self.oldest_s = min(self.oldest_s, self._held_s(reading))
        return reading.value

    def _held_s(self, reading: Reading) -> float:
        """Return the latest instant at which a reading is known to hold [s]."""
        return reading.instant_s if self.confirmed_s is None else max(
            reading.instant_s, min(self.confirmed_s, self.now_s))

    def _valid(self, signal: str, channel: str) -> Reading | None:
        reading, limit_s = self.readings.latest(signal, channel), self.live_map.valid_for_s[signal]
        if reading is None:
            self.missing[signal] = f'{signal}: no valid reading of {channel} yet'
            return None
        age_s = self.now_s - reading.instant_s
        if age_s > limit_s:
            self.missing[signal] = (f'{signal}: the last valid reading of {channel} is {figure(age_s, 3)} s old; '
                                    f'it expires after {limit_s:g} s')
            return None
        return reading

    def battery(self) -> tuple[LiveBattery | None, tuple[str, ...]]:
        """Return the battery; or None and a sentence for each required signal without a valid value."""
        if self.is_lost:
            assert self.confirmed_s is not None
            silent_s = self.now_s - self.confirmed_s
            return None, ('no sign of life of the connection' + (
                f' for {figure(silent_s, 3)} s' if math.isfinite(silent_s) else ' yet'),)
        values = {signal: self.value(signal) for signal in BATTERY_SIGNALS}
        cells_c = self.all_values(CELLS)
        lacking = [self.missing[signal] for signal in self.live_map.required if values.get(signal) is None]
        if lacking:
            return None, tuple(lacking)
        charging = None
        if self.live_map.charging_channel is not None:
            charging = self.reading(CHARGING, self.live_map.charging_channel)
        current_a, power_w, voltage_v = values['current_a'], values['power_w'], values['voltage_v']
        if current_a is None and power_w is not None and voltage_v:
            current_a = power_w / voltage_v
        return LiveBattery(
            values['battery_temperature_c'], values['soc'], voltage_v, current_a, cells_c,
            None if charging is None else charging in self.live_map.charging_values, self.oldest_s,
            tuple(self.missing.values())), ()


class LiveSource:
    """A bus that is being received; `name` is the bus as text, such as `socketcan can0`."""

    name: str

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float], channels: Channels,
                 confirmed_s: float | None = None) -> None:
        """
        Take a map, the clock [s] of the readings' instants, and the channels that `live_channels` returns.

        On a bus that sends values on change only, `confirmed_s` is when its connection was last alive [s].
        """
        self._map, self._clock_s, self._channels, self._confirmed_s = live_map, clock_s, channels, confirmed_s
        self._readings = Readings()

    def battery(self, now_s: float) -> tuple[LiveBattery | None, tuple[str, ...]]:
        """Return the battery at an instant [s]; else a sentence for each missing signal."""
        return self._view(now_s).battery()

    def value(self, signal: str, now_s: float) -> float | None:
        """Return another signal of live_map.LIVE_SIGNALS in its own unit, None without a valid value."""
        view = self._view(now_s)
        return None if view.is_lost else view.value(signal)

    def _view(self, now_s: float) -> View:
        return View(self._map, self._channels, self._readings, now_s, self._confirmed_s)

    def doubts(self) -> dict[str, str]:
        """Return a sentence on the latest dropped input of each cause."""
        return self._readings.doubts(self._clock_s())

    def forget(self) -> None:
        """Drop all readings, because the clock fell back."""
        self._readings.forget()
