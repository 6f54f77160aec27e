# SPDX-License-Identifier: Apache-2.0
"""Decodes live CAN frames by a DBC, after their checks, into readings of signals."""

from __future__ import annotations

from collections.abc import Mapping
import re
from typing import Any, TYPE_CHECKING

from bev_preheat.bus.frame_checks import FrameChecks
from bev_preheat.bus.live_map import CHARGING
from bev_preheat.bus.readings import live_channels, LiveChannel
from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.logs.can_frames import load_dbc
from bev_preheat.logs.signal_map import PLAUSIBLE, Source
from bev_preheat.logs.units import pint_unit
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.bus.live_map import LiveMap
    from bev_preheat.bus.readings import Readings

# Names of the heater's readings.
HEATER_POWER, HEATER_FAULT = 'battery_heater_w', 'heater_fault'
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
        """Load the DBC files; raises InvalidInput for an unreadable file or a missing signal."""
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
        # Signals without a unit of their own, by their name among the Readings.
        status = live_map.heater_status
        self._plain = {name: channel for name, channel in (
            (CHARGING, live_map.charging_channel),
            (HEATER_FAULT, None if status is None else status.fault)) if channel is not None}
        self._heater_power = None if status is None else status.power
        for key, channel in ((f'live.{CHARGING}.channel', self._plain.get(CHARGING)),
                             ('live.heater_status.fault', self._plain.get(HEATER_FAULT)),
                             ('live.heater_status.power', self._heater_power)):
            if channel is not None and channel not in signals:
                problems.append(f'{where}: {key}: {channel} is no MESSAGE.SIGNAL of the DBC')
        if problems:
            raise InvalidInput(problems)
        self._wanted: dict[str, list[tuple[str, LiveChannel]]] = {}
        for signal, groups in self.channels.items():
            for wanted in {each.name: each for group in groups for each in group}.values():
                self._wanted.setdefault(wanted.name, []).append((signal, wanted))
        if self._heater_power is not None:
            power = Source(HEATER_POWER, (self._heater_power,), plausible=PLAUSIBLE[HEATER_POWER])
            self._wanted.setdefault(self._heater_power, []).append((HEATER_POWER, LiveChannel(
                self._heater_power, power, units[self._heater_power] or 'W')))
        used = {name.partition('.')[0] for name in (*self._wanted, *self._plain.values())}
        self._checks = {
            (message.frame_id, message.is_extended_frame):
            FrameChecks(message, live_map.messages.get(message.name), f'{where}: live.messages.{message.name}')
            for message in messages.values() if message.name in used}
        self._signals = signals
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
