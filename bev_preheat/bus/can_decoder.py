# SPDX-License-Identifier: Apache-2.0
"""Decodes live CAN frames by a DBC, after their checks, into readings of signals."""

from __future__ import annotations

from collections.abc import Mapping
import re
from typing import Any, TYPE_CHECKING

from bev_preheat.bus.frame_checks import FrameChecks
from bev_preheat.bus.readings import live_channels, LiveChannel
from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.logs.can_frames import load_dbc
from bev_preheat.logs.units import pint_unit
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.bus.live_map import LiveMap
    from bev_preheat.bus.readings import Readings

# Values that the DBC gives such a name are no readings.
NO_READING = re.compile(r'(^|[^a-z])(sna|n\W?a|nan|init\w*|invalid|fault\w*|error|err|unknown|undefined|'
                        r'not ?(available|defined|valid|used)|no ?(signal|data|value)|reserved)([^a-z]|$)',
                        re.IGNORECASE)


class CanDecoder:
    """
    Turns frames into Readings.

    `channels` has the LiveChannels of each signal, as battery.BatteryReader takes them; `identifiers` are the
    frames that are used, as (identifier, whether it has 29 bits).
    """

    def __init__(self, live_map: LiveMap) -> None:
        """Load the DBC files; raises InvalidInput if one is unreadable or lacks a required signal."""
        require('cantools')
        where = str(live_map.signals.path)
        messages = {message.name: message for file in live_map.signals.databases
                    for message in load_dbc(file).messages}
        signals = {f'{message.name}.{signal.name}': signal
                   for message in messages.values() for signal in message.signals}
        units = {name: pint_unit(signal.unit or '') for name, signal in signals.items()}
        self.channels = live_channels(live_map.sources, units, where)
        problems = [f'{where}: signals.{name}: no signal of the DBC is called '
                    f'{" or ".join(live_map.signals.sources[name].channels)}; write MESSAGE.SIGNAL as in the DBC'
                    for name in live_map.required if not self.channels[name]]
        problems += [f'{where}: live.messages.{name}: no message of the DBC has this name'
                     for name in live_map.messages if name not in messages]
        self._charging = live_map.charging_channel
        if self._charging is not None and self._charging not in signals:
            problems.append(f'{where}: live.charging.channel: {self._charging} is no MESSAGE.SIGNAL of the DBC')
        if problems:
            raise InvalidInput(problems)
        self._wanted: dict[str, list[tuple[str, LiveChannel]]] = {}
        for signal, groups in self.channels.items():
            for channel in {each.name: each for group in groups for each in group}.values():
                self._wanted.setdefault(channel.name, []).append((signal, channel))
        used = {name.partition('.')[0] for name in (*self._wanted, self._charging or '.')}
        self._checks = {
            (message.frame_id, message.is_extended_frame):
            FrameChecks(message, live_map.messages.get(message.name), f'{where}: live.messages.{message.name}')
            for message in messages.values() if message.name in used}
        self._limits = {name: _limits(signals[name]) for name in self._wanted}
        self._nothing = {name: _names_of_nothing(signals[name]) for name in self._wanted}
        self.identifiers = tuple(self._checks)
        self.messages: Mapping[str, Any] = messages

    @property
    def checks(self) -> tuple[FrameChecks, ...]:
        """The checks of the messages that are used."""
        return tuple(self._checks.values())

    def take(self, identifier: int, is_extended: bool, data: bytes, instant_s: float, readings: Readings) -> None:
        """Record the readings of a frame that came at an instant [s], or why it was dropped."""
        checks = self._checks.get((identifier, is_extended))
        if checks is None:
            return
        name = checks.message.name
        try:
            checks.check_data(data, instant_s)
            try:
                values = checks.message.decode(data, decode_choices=False, scaling=False)
                scaled = checks.message.decode(data, decode_choices=False)
            except Exception as error:
                # cantools raises errors of several packages, such as for a multiplexer that the DBC does not know.
                raise InvalidInput(f'{name}: does not fit the DBC ({quoted(str(error))})') from error
            checks.check_counter(values)
        except InvalidInput as error:
            readings.doubt(name, str(error), instant_s)
            return
        for signal, number in scaled.items():
            full_name = f'{name}.{signal}'
            if full_name == self._charging:
                readings.put('charging', full_name, float(number), instant_s)
            for wanted, channel in self._wanted.get(full_name, ()):
                try:
                    self._check(full_name, values[signal], number)
                    readings.put(wanted, full_name, channel.read(float(number)), instant_s)
                except InvalidInput as error:
                    readings.doubt(full_name, str(error), instant_s)

    def _check(self, name: str, raw: float, number: float) -> None:
        """Raise InvalidInput if the DBC calls a raw value no reading, or has it outside its limits."""
        if raw in self._nothing[name]:
            raise InvalidInput(f'{name}: {figure(raw)} means {quoted(self._nothing[name][raw])}')
        low, high = self._limits[name]
        if not low <= number <= high:
            raise InvalidInput(f'{name}: {figure(number)} is outside the limits of the DBC, {figure(low)} ... '
                               f'{figure(high)}')


def _limits(signal: Any) -> tuple[float, float]:
    low, high = signal.minimum, signal.maximum
    # In a DBC, [0|0] means no limits.
    if low is None or high is None or low >= high:
        return -1e300, 1e300
    rounding = 1e-9 * max(abs(low), abs(high))
    return float(low) - rounding, float(high) + rounding


def _names_of_nothing(signal: Any) -> dict[float, str]:
    return {value: str(name) for value, name in (signal.choices or {}).items()
            if NO_READING.search(str(name).replace('_', ' '))}
