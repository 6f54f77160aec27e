# SPDX-License-Identifier: Apache-2.0
"""The CAN frame that carries the heater's command: power, share or set-point, alive counter, checksum."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from bev_preheat.bus.frame_checks import Checksum, counter_of, counts_of, signal_of
from bev_preheat.bus.live_map import HeaterFrameRule
from bev_preheat.errors import InvalidInput
from bev_preheat.files.units import conversion, unit_named
from bev_preheat.logs.dbc import NoReading

USUAL_PERIOD_S, SHORTEST_PERIOD_S, SLOWEST_PERIOD_S = 0.1, 0.01, 1.0
# Shares of full power by the unit of a signal.
SHARES = {'percent': 0.01, '1': 1.0}
TEMPERATURES = ('degC', 'degF', 'kelvin')


class HeaterFrame:
    """
    Makes the frames of one message of the DBC.

    The unit of the command's signal decides its meaning: a power, a share of `full_power_w` [W], or the
    coolant's set-point, which is the temperature that it follows plus the power divided by `watts_per_kelvin`,
    within `range_c` [deg C]. It is rounded down to the signal's resolution, and the power limited to `highest_w`
    [W]. A counter rises by one a frame and begins again at 0. `period_s` is the time between two frames [s],
    `follows` MESSAGE.SIGNAL of the temperature that a set-point follows, else None.
    """

    def __init__(self, rule: HeaterFrameRule, messages: Mapping[str, Any], where: str,
                 vehicle_power_w: float | None = None, key: str = 'live.heater_command') -> None:
        """
        Take cantools Messages by name, and the maximum power of the heater in the vehicle file [W], if known.

        Raises InvalidInput, with `where` and the `key` of the rule, if it does not fit the messages.
        """
        self._where = where = f'{where}: {key}'
        message = messages.get(rule.message)
        if message is None:
            raise InvalidInput(f'{where}.message: {rule.message} is no message of the DBC; its messages are '
                               f'{", ".join(messages)}')
        if message.is_multiplexed():
            raise InvalidInput(f'{where}.message: {rule.message} is multiplexed; the heater needs a message of '
                               'its own')
        self._rule, self._message = rule, message
        self._power = power = signal_of(message, rule.power, f'{where}.power')
        self._name, self._nothing = f'{rule.message}.{rule.power}', NoReading(message, power)
        self._counter = counter_of(message, rule.counter, where)
        self._enable = None if rule.enable is None else signal_of(message, rule.enable, f'{where}.enable')
        self._checksum = None if rule.checksum is None else Checksum(
            rule.checksum, message, f'{where}.checksum', self._counter)
        self._check_roles()
        self._others = self._other_values()
        if power.scale <= 0.0:
            raise InvalidInput(f'{where}.power: {self._name} has the factor {power.scale:g}; it must be positive')
        self.full_power_w = rule.full_power_w or vehicle_power_w
        unit = self._unit()
        self._to_celsius = conversion(unit, 'degC') if unit in TEMPERATURES else None
        self.follows = None if self._to_celsius is None or rule.coolant is None else rule.coolant.follows
        self._watts = 1.0 if self._to_celsius else self._watts_of(unit)
        self.highest_w = self._highest_w(vehicle_power_w)
        self._off = self._off_value()
        # The end of a lease must not wait for a slow cycle.
        cycle_s = (message.cycle_time or 0) / 1000.0 or USUAL_PERIOD_S
        self.period_s = rule.period_s or min(max(cycle_s, SHORTEST_PERIOD_S), SLOWEST_PERIOD_S)
        self._count = 0
        self.identifier, self.is_extended = int(message.frame_id), bool(message.is_extended_frame)
        self.is_fd = bool(message.is_fd) or message.length > 8
        try:
            # A DBC is read although signals overlap; a frame cannot carry them.
            message.refresh(strict=True)
            self.next(0.0)
        except Exception as error:
            # cantools raises errors of several packages.
            raise InvalidInput(f'{where}: {rule.message} cannot be made of these values: {error}') from error

    def next(self, power_w: float, followed_c: float | None = None) -> bytes:
        """
        Return the data of the next frame for an electrical power of 0 ... `highest_w` [W]; more is limited.

        `followed_c` [deg C] is the temperature that a set-point follows; None: unknown, the heater is off.
        """
        carried = self._carried(min(max(power_w, 0.0), self.highest_w), followed_c)
        is_on = carried is not None
        values = {**self._others, self._power.name: carried if is_on else self._off}
        if self._enable is not None:
            values[self._enable.name] = 1 if is_on else 0
        if self._counter is not None:
            values[self._counter.name] = self._count
            self._count = (self._count + 1) % counts_of(self._counter, self._checksum)
        data = bytes(self._message.encode(values, scaling=True, strict=True))
        return data if self._checksum is None else self._checksum.written(data)

    def _carried(self, power_w: float, followed_c: float | None) -> float | None:
        """Return the value of the signal for a power [W], at most for that power; None: off."""
        if power_w <= 0.0:
            return None
        if self._to_celsius is None:
            carried = self._rounded_down(power_w / self._watts)
            return carried if carried > 0.0 else None
        law = self._rule.coolant
        assert law is not None
        if followed_c is None or not math.isfinite(followed_c):
            return None
        factor, offset = self._to_celsius
        wanted_c = min(followed_c + power_w / law.watts_per_kelvin, law.range_c[1])
        carried = self._rounded_down((wanted_c - offset) / factor)
        carried_c = carried * factor + offset
        # A higher set-point than that of the power would be more power: below its range the heater is off.
        return carried if carried_c > followed_c and carried_c >= law.range_c[0] - 1e-6 else None

    def _rounded_down(self, value: float) -> float:
        power = self._power
        steps = math.floor((value - power.offset) / power.scale + 1e-9)
        return float(steps * power.scale + power.offset)

    def _check_roles(self) -> None:
        """Raise InvalidInput if a signal has two roles, because a frame carries one value a signal."""
        checksum, keys = self._checksum, dict[str, str]()
        for key, name in (('power', self._power.name), ('counter', self._counter and self._counter.name),
                          ('enable', self._rule.enable), ('checksum.signal', checksum and checksum.signal),
                          ('checksum.data_id_nibble', checksum and checksum.nibble and checksum.nibble[0])):
            if name and (other := keys.setdefault(name, key)) != key:
                raise InvalidInput(f'{self._where}.{key}: {name} is the signal of {other} already; each needs a '
                                   'signal of its own')

    def _other_values(self) -> dict[str, float]:
        """Return the values of all signals but power, counter and enable."""
        rule = self._rule
        others = {signal.name: _usual_value(signal) for signal in self._message.signals
                  if signal not in (self._power, self._counter, self._enable)}
        for name, value in rule.constants.items():
            if name not in others:
                raise InvalidInput(f'{self._where}.constants: {name} is not among the other signals of '
                                   f'{rule.message}: {", ".join(others) or "it has no others"}')
            others[name] = float(value)
        if self._checksum is not None and self._checksum.nibble is not None:
            name, value = self._checksum.nibble
            others[name] = float(value)
        return others

    def _unit(self) -> str:
        """Return the unit of the command's signal."""
        text = self._rule.unit or self._power.unit or ''
        unit = unit_named(text)
        if not unit:
            problem = (f'the unit {text!r} of {self._name} is unknown' if text else
                       f'is missing, and the DBC has none for {self._name}')
            raise InvalidInput(f'{self._where}.unit: {problem}; write W, kW, percent or degC')
        return unit

    def _watts_of(self, unit: str) -> float:
        """Return the watts of a unit of a power or share."""
        if unit in SHARES:
            if self.full_power_w is None:
                raise InvalidInput(
                    f'{self._where}.full_power_w: is missing; {self._name} is a share ({unit}), and the power at '
                    '100 % [W] must be given here or, for heater_controller, in the vehicle file')
            return self.full_power_w * SHARES[unit]
        try:
            return conversion(unit, 'W').factor
        except InvalidInput as error:
            raise InvalidInput(f'{self._where}.power: {self._name}: {error}; a power, percent or a temperature is '
                               'allowed') from error

    def _highest_w(self, vehicle_power_w: float | None) -> float:
        """Return the largest power that may be commanded [W]."""
        rule, most_w = self._rule, self._rule.maximum_power_w
        if self._to_celsius is not None:
            if rule.coolant is None:
                raise InvalidInput(f'{self._where}.coolant: is missing; {self._name} is a temperature, and '
                                   'coolant says how it follows from the power')
            if rule.coolant.range_c[0] >= rule.coolant.range_c[1]:
                raise InvalidInput(f'{self._where}.coolant.range_c: {rule.coolant.range_c[0]:g} is not below '
                                   f'{rule.coolant.range_c[1]:g}')
            limit_w = most_w or vehicle_power_w
            if limit_w is None:
                raise InvalidInput(f'{self._where}.maximum_power_w: is missing; {self._name} is a temperature '
                                   'and limits no power')
            return limit_w
        power = self._power
        largest_raw = int(min(2**(power.length - (1 if power.is_signed else 0)) - 1, self._nothing.highest_raw))
        while self._nothing.word(largest_raw):
            largest_raw -= 1
        highest = largest_raw * power.scale + power.offset
        if power.maximum is not None and (power.minimum or 0.0) < power.maximum:
            highest = min(highest, float(power.maximum))
        if most_w is not None and most_w > highest * self._watts * (1.0 + 1e-9):
            raise InvalidInput(f'{self._where}.maximum_power_w: {most_w:g} W is not allowed; {self._name} carries '
                               f'at most {highest * self._watts:g} W')
        return highest * self._watts if most_w is None else most_w

    def _off_value(self) -> float:
        """Return the value of the command's signal while the heater is off."""
        power, law, (factor, offset) = self._power, self._rule.coolant, self._to_celsius or (1.0, 0.0)
        low, high = law.range_c if self._to_celsius and law else (0.5 * power.scale, math.inf)
        if (off := self._rule.off_value) is not None:
            is_named = self._nothing.word(round((off - power.offset) / power.scale))
            if self._enable is None and not is_named and low <= off * factor + offset <= high:
                raise InvalidInput(f'{self._where}.off_value: {off:g} is a value at which the heater heats; write '
                                   'one at which it is off, or name a signal that enables it (enable)')
            return float(off)
        if self._to_celsius is None:
            return 0.0
        if self._enable is None:
            raise InvalidInput(f'{self._where}.off_value: is missing; {self._name} is a temperature: name the '
                               'value at which the heater is off, or a signal that enables it (enable)')
        return self._rounded_down((low - offset) / factor + power.scale * (1.0 - 1e-6))


def _usual_value(signal: Any) -> float:
    """Return a signal's initial value, else the allowed value that is nearest to 0."""
    if signal.initial is not None:
        return float(signal.initial)
    low = signal.minimum if signal.minimum is not None else 0.0
    high = signal.maximum if signal.maximum is not None else 0.0
    return float(min(max(0.0, low), high)) if low < high else 0.0
