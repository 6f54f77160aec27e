# SPDX-License-Identifier: Apache-2.0
"""Decodes live CAN frames by a DBC, after their checks, into readings of signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import math
from typing import Any

from bev_preheat.bus.frame_checks import FrameChecks
from bev_preheat.bus.heater_frame import HeaterFrame, SHARES
from bev_preheat.bus.live_map import CHARGING, LiveMap
from bev_preheat.bus.source import by_channel, live_channels, LiveChannel, Readings
from bev_preheat.errors import figure, InvalidInput, located, quoted
from bev_preheat.files.units import unit_named
from bev_preheat.logs.dbc import identifying_bits, J1939_GROUP, last_values, load_dbc, NoReading, part_of
from bev_preheat.logs.signal_map import PLAUSIBLE, Source
from bev_preheat.optional_packages import require
from bev_preheat.vehicle.description import HVCH

# Names of the HVCH's readings.
HEATER_POWER, HEATER_FAULT = 'battery_heater_w', 'heater_fault'
# Name of the readings of the temperature that a coolant set-point follows.
FOLLOWED = 'coolant_c'


def reading_of(signal: str, heater: str) -> str:
    """Return the name of the readings of such a signal of a heat source."""
    return signal if heater == HVCH else f'{signal} of {heater}'


class BusMessages:
    """cantools Messages `by_name`, and the index of their `bus`: the first of several that have one."""

    def __init__(self, live_map: LiveMap) -> None:
        """Load the DBC files; raises InvalidInput for an unreadable file."""
        require('cantools')
        self.by_name: dict[str, Any] = {}
        self.bus: dict[str, int] = {}
        for number, settings in enumerate(live_map.can):
            own = {message.name: message for file in settings.databases for message in load_dbc(file).messages}
            self.by_name = {**own, **self.by_name}
            self.bus = {**dict.fromkeys(own, number), **self.bus}


class CanDecoder:
    """
    Turns frames into Readings.

    `channels` has the LiveChannels of each signal, `checks` those of the messages that are used; `identifiers` are
    their frames, as (identifier, whether it has 29 bits), for each bus.
    """

    def __init__(self, live_map: LiveMap, bus_messages: BusMessages, frames: Mapping[str, HeaterFrame]) -> None:
        """Take the frames of the map's heat sources by name; raises InvalidInput for a missing signal."""
        where, messages = str(live_map.signals.path), bus_messages.by_name
        signals = {f'{message.name}.{signal.name}': signal
                   for message in messages.values() for signal in message.signals}
        units = {name: unit_named(signal.unit or '') for name, signal in signals.items()}
        self.channels = live_channels(live_map.sources, units, where)
        problems = [f'{where}: signals.{name}: no signal of the DBC is called '
                    f'{" or ".join(live_map.signals.sources[name].channels)}; write MESSAGE.SIGNAL as in the DBC'
                    for name in live_map.required if not self.channels[name]]
        problems += [f'{where}: live.messages.{name}: no message of the DBC has this name'
                     for name in live_map.messages if name not in messages]
        # Signals without a unit of their own, by their name among the Readings.
        self._plain = {} if live_map.charging_channel is None else {CHARGING: live_map.charging_channel}
        named = [(f'live.{CHARGING}.channel', live_map.charging_channel)]
        wanted_of: list[tuple[str, str, str, str]] = []
        for name, (key, _, status) in live_map.heaters.items():
            if status.fault is not None:
                self._plain[reading_of(HEATER_FAULT, name)] = status.fault
                named.append((f'{key}status.fault', status.fault))
            wanted_of += [(signal, name, f'{key}{part}', channel) for signal, part, channel in (
                (HEATER_POWER, 'status.power', status.power),
                (FOLLOWED, 'command.coolant.follows', frames[name].follows))
                if channel is not None]
        problems += [f'{where}: {key}: {channel} is no MESSAGE.SIGNAL of the DBC'
                     for key, channel in (*named, *(each[2:] for each in wanted_of))
                     if channel is not None and channel not in signals]
        if problems:
            raise InvalidInput(problems)
        self._wanted = by_channel(self.channels)
        # A full share may have all bits set; other quantities do not.
        last: dict[str, dict[float, str]] = {
            name: dict.fromkeys(last_values(signals[name]), 'no reading: the last value of its bits')
            for name in self._wanted if units[name] not in SHARES}
        for signal, name, key, channel in wanted_of:
            self._want(signal, name, channel, units[channel], f'{where}: {key}',
                       None if signal == FOLLOWED else frames[name].full_power_w)
        used = {name.partition('.')[0] for name in (*self._wanted, *self._plain.values())}
        self._checks: dict[tuple[int, int, bool], FrameChecks] = {}
        for name, message in messages.items():
            if name in used:
                first = self._checks.setdefault(
                    (bus_messages.bus[name], message.frame_id, message.is_extended_frame),
                    FrameChecks(message, live_map.messages.get(name), f'{where}: live.messages.{name}'))
                if first.message is not message:
                    raise InvalidInput(f'{where}: {first.message.name} and {name} have the same identifier, '
                                       f'{message.frame_id:X}; use a single message')
        self.checks = tuple(self._checks.values())
        held = [(f'live.valid_for_s_of.{signal}', each.name, live_map.valid_for_s[signal])
                for signal, groups in self.channels.items() for group in groups for each in group]
        held += [(f'{key}status.valid_for_s', channel, status.valid_for_s)
                 for key, _, status in live_map.heaters.values()
                 for channel in (status.power, status.fault) if channel is not None]
        cycles_s = {check.message.name: check.cycle_time_s for check in self.checks}
        for key, channel, valid_s in held:
            if valid_s <= (cycle_s := cycles_s[name := channel.partition('.')[0]]):
                raise InvalidInput(f'{where}: {key}: {valid_s:g} s is too short for {channel}, which comes every '
                                   f'{cycle_s:g} s: write more, or live.messages.{name}.cycle_time_s')
        # Messages of J1939 from any sender, and who sent the first frame of each message.
        self._groups = {(bus, identifier & J1939_GROUP): checks
                        for (bus, identifier, is_extended), checks in self._checks.items()
                        if identifying_bits(identifier, is_extended) == J1939_GROUP}
        self._senders: dict[str, int] = {}
        self._signals = signals
        self._limits = {name: _limits(signals[name]) for name in self._wanted}
        self._nothing = {name: NoReading(messages[name.partition('.')[0]], signals[name], last.get(name))
                         for name in self._wanted}
        with located(where):
            self._parts = {check.message.name: part_of(check.message, [
                signal.name for signal in check.message.signals if signal is check.counter
                or f'{check.message.name}.{signal.name}' in {*self._wanted, *self._plain.values()}])
                for check in self.checks}
        self.identifiers = tuple(
            tuple((identifier, is_extended) for bus, identifier, is_extended in self._checks if bus == number)
            for number in range(len(live_map.can)))
        # Whether a bus has frames of CAN FD.
        self.has_fd = tuple(
            any(bus == number and (check.message.is_fd or check.message.length > 8)
                for (bus, *_), check in self._checks.items()) for number in range(len(live_map.can)))

    def _want(self, signal: str, heater: str, name: str, unit: str, where: str,
              full_power_w: float | None) -> None:
        """Read MESSAGE.SIGNAL as a signal of a heat source; a share refers to `full_power_w` [W]."""
        source = Source(signal, (name,), plausible=PLAUSIBLE[signal])
        if unit in SHARES:
            if full_power_w is None:
                raise InvalidInput(f'{where}: {name} is a share ({unit}); the power at 100 % [W] is missing: '
                                   'full_power_w of the command')
            source, unit = replace(source, scales=(full_power_w * SHARES[unit],)), 'W'
        with located(where):
            channel = LiveChannel(name, source, unit or ('W' if signal == HEATER_POWER else ''))
        self._wanted.setdefault(name, []).append((reading_of(signal, heater), channel))

    def take(self, identifier: int, is_extended: bool, data: bytes, instant_s: float, readings: Readings,
             bus: int = 0) -> None:
        """Record the readings of a frame that came at an instant [s] on a bus, or why it was dropped."""
        checks = self._checks.get((bus, identifier, is_extended))
        if checks is None and is_extended:
            checks = self._groups.get((bus, identifier & J1939_GROUP))
        if checks is None:
            return
        name = checks.message.name
        try:
            if (sender := self._senders.setdefault(name, identifier)) != identifier:
                raise InvalidInput(f'{name}: a frame from {identifier:X}; those from {sender:X} count: write the '
                                   'identifier of the sender into the DBC')
            checks.check_data(data, instant_s)
            try:
                values = self._parts[name].decode(data, decode_choices=False, scaling=False)
            except Exception as error:
                # cantools raises errors of several packages, such as for a multiplexer that the DBC does not know.
                raise InvalidInput(f'{name}: does not fit the DBC ({quoted(str(error))})') from error
            checks.check_counter(values)
        except InvalidInput as error:
            readings.doubt(name, str(error), instant_s)
            return
        for signal, raw in values.items():
            full_name = f'{name}.{signal}'
            number = self._signals[full_name].conversion.raw_to_scaled(raw, decode_choices=False)
            for plain, channel_name in self._plain.items():
                if full_name == channel_name:
                    readings.put(plain, full_name, float(number), instant_s)
            for wanted, channel in self._wanted.get(full_name, ()):
                try:
                    self._check(full_name, raw, number)
                    readings.put(wanted, full_name, channel.read(float(number)), instant_s)
                except InvalidInput as error:
                    readings.doubt(full_name, str(error), instant_s)

    def value_in_words(self, name: str, value: float) -> str:
        """Return a value of MESSAGE.SIGNAL with the name that the DBC gives it."""
        signal = self._signals[name]
        word = (signal.choices or {}).get(round((value - signal.offset) / signal.scale))
        return figure(value) if word is None else f'{word} ({figure(value)})'

    def _check(self, name: str, raw: float, number: float) -> None:
        """Raise InvalidInput if the DBC calls a raw value no reading, or has it outside its limits."""
        if word := self._nothing[name].word(raw):
            raise InvalidInput(f'{name}: {figure(raw)} means {quoted(word)}')
        low, high = self._limits[name]
        rounding = 1e-9 * max(abs(low), abs(high))
        if number < low - rounding or number > high + rounding:
            raise InvalidInput(f'{name}: {figure(number)} is outside the limits of the DBC, {figure(low)} ... '
                               f'{figure(high)}')


def _limits(signal: Any) -> tuple[float, float]:
    low, high = signal.minimum, signal.maximum
    # In a DBC, [0|0] means no limits.
    if low is None or high is None or low >= high:
        return -math.inf, math.inf
    return float(low), float(high)
