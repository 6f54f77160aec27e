# SPDX-License-Identifier: Apache-2.0
"""The CAN frame that carries the heater's command: power, alive counter, checksum."""

from __future__ import annotations

import math
from typing import Any, TYPE_CHECKING

from bev_preheat.bus.checksums import Checksum, signal_of
from bev_preheat.bus.frame_checks import counts_of
from bev_preheat.errors import InvalidInput
from bev_preheat.logs.units import check_unit, conversion, pint_unit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.bus.live_map import HeaterFrameRule

USUAL_PERIOD_S = 0.1


class HeaterFrame:
    """
    Makes the frames of one message of the DBC.

    The counter rises by one a frame and begins again at 0. The power is rounded down to the signal's resolution
    and limited to `highest_w` [W], the heater's largest power. `period_s` is the time between two frames [s].
    """

    def __init__(self, rule: HeaterFrameRule, messages: Mapping[str, Any], where: str) -> None:
        """Take cantools Messages by name; raises InvalidInput, with `where`, if the rule does not fit them."""
        where = f'{where}: live.heater_command'
        message = messages.get(rule.message)
        if message is None:
            raise InvalidInput(f'{where}.message: {rule.message} is no message of the DBC; its messages are '
                               f'{", ".join(messages)}')
        if message.is_multiplexed():
            raise InvalidInput(f'{where}.message: {rule.message} is multiplexed; the heater needs a message of '
                               'its own')
        power = signal_of(message, rule.power, f'{where}.power')
        unit = pint_unit(power.unit or '') or 'W'
        check_unit(unit, 'heater_w')
        self._watts = conversion(unit, 'W').factor
        self._counter = signal_of(message, rule.counter, f'{where}.counter')
        self._enable = None if rule.enable is None else signal_of(message, rule.enable, f'{where}.enable')
        self._checksum = None if rule.checksum is None else Checksum(rule.checksum, message, f'{where}.checksum')
        self._message, self._power = message, power
        named = {rule.power, rule.counter, rule.enable}
        self._others = {signal.name: _usual_value(signal)
                        for signal in message.signals if signal.name not in named}
        for name, value in rule.constants.items():
            if name not in self._others:
                raise InvalidInput(f'{where}.constants: {name} is not among the other signals of {rule.message}: '
                                   f'{", ".join(self._others) or "there are none"}')
            self._others[name] = float(value)
        if power.scale <= 0.0:
            raise InvalidInput(f'{where}.power: {rule.power} has the factor {power.scale:g}; it must be positive')
        largest_raw = 2**(power.length - (1 if power.is_signed else 0)) - 1
        highest = largest_raw * power.scale + power.offset
        if power.maximum is not None and (power.minimum or 0.0) < power.maximum:
            highest = min(highest, float(power.maximum))
        self.highest_w = highest * self._watts
        if rule.maximum_power_w is not None:
            if rule.maximum_power_w > self.highest_w * (1.0 + 1e-9):
                raise InvalidInput(f'{where}.maximum_power_w: {rule.maximum_power_w:g} W is not allowed; '
                                   f'{rule.message}.{rule.power} carries at most {self.highest_w:g} W')
            self.highest_w = rule.maximum_power_w
        self.period_s = rule.period_s or (message.cycle_time or 0) / 1000.0 or USUAL_PERIOD_S
        self._count = 0
        self.identifier, self.is_extended = int(message.frame_id), bool(message.is_extended_frame)
        try:
            self.next(0.0)
        except Exception as error:
            # cantools raises errors of several packages.
            raise InvalidInput(f'{where}: {rule.message} cannot be made of these values: {error}') from error

    def next(self, power_w: float) -> bytes:
        """Return the data of the next frame for an electrical power of 0 ... `highest_w` [W]; more is limited."""
        power = self._power
        # The offset of a conversion between watts and kilowatts is 0.
        wanted = min(max(power_w, 0.0), self.highest_w) / self._watts
        steps = math.floor((wanted - power.offset) / power.scale + 1e-9)
        carried = steps * power.scale + power.offset
        if carried <= 0.0:
            carried = 0.0
        values = {**self._others, power.name: carried, self._counter.name: self._count}
        if self._enable is not None:
            values[self._enable.name] = 1 if carried > 0.0 else 0
        self._count = (self._count + 1) % counts_of(self._counter)
        data = bytes(self._message.encode(values, scaling=True, strict=True))
        return data if self._checksum is None else self._checksum.written(data)


def _usual_value(signal: Any) -> float:
    """Return a signal's initial value, else the allowed value that is nearest to 0."""
    if signal.initial is not None:
        return float(signal.initial)
    low = signal.minimum if signal.minimum is not None else 0.0
    high = signal.maximum if signal.maximum is not None else 0.0
    return float(min(max(0.0, low), high)) if low < high else 0.0
