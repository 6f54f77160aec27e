# SPDX-License-Identifier: Apache-2.0
"""Checksums of one byte in a CAN frame; the CRCs are computed by crccheck."""

from __future__ import annotations

from functools import reduce
from operator import xor
from typing import Any, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.bus.live_map import ChecksumRule

# Polynomial, start value and final exclusive or of the CRCs: SAE J1850; CRC8H2F of AUTOSAR (Specification of CRC
# Routines); CRC-8 of SMBus.
CRC8 = {'crc8_sae_j1850': (0x1D, 0xFF, 0xFF), 'crc8_autosar': (0x2F, 0xFF, 0xFF), 'crc8': (0x07, 0x00, 0x00)}


class Checksum:
    """The checksum of a message: that of all bytes but its own, behind the prefix."""

    def __init__(self, rule: ChecksumRule, message: Any, where: str) -> None:
        """Take a cantools Message; raises InvalidInput if the signal is not a byte. `where` is the map's."""
        self.signal, self._rule = rule.signal, rule
        self.at = _byte_of(message, rule.signal, where)
        self._crc = None
        if rule.method in CRC8:
            require('crccheck')
            from crccheck.crc import Crc
            polynomial, initial, final_xor = CRC8[rule.method]
            self._crc = Crc(8, polynomial, initial if rule.initial is None else rule.initial,
                            xor_output=final_xor if rule.final_xor is None else rule.final_xor)

    def of(self, data: bytes) -> int:
        """Return the checksum (0 ... 255) of a frame's data; the byte of the checksum itself does not count."""
        protected = bytes(self._rule.prefix) + data[:self.at] + data[self.at + 1:]
        if self._crc is not None:
            self._crc.reset()
            return int(self._crc.process(protected).final())
        initial, final_xor = self._rule.initial or 0, self._rule.final_xor or 0
        total = reduce(xor, protected, initial) if self._rule.method == 'xor' else sum(protected, initial)
        return (total & 0xFF) ^ final_xor

    def written(self, data: bytes) -> bytes:
        """Return the data with its checksum in place."""
        return data[:self.at] + bytes([self.of(data)]) + data[self.at + 1:]


def _byte_of(message: Any, name: str, where: str) -> int:
    """Return the index of the byte that a signal of 8 bits fills."""
    signal = signal_of(message, name, where)
    first = 7 if signal.byte_order == 'big_endian' else 0
    if signal.length != 8 or signal.start % 8 != first:
        raise InvalidInput(f'{where}: {message.name}.{name} has {signal.length} bits from bit {signal.start}; a '
                           'checksum must fill one byte')
    return int(signal.start) // 8


def signal_of(message: Any, name: str, where: str) -> Any:
    """Return a signal of a cantools Message; raises InvalidInput with those that it has."""
    for signal in message.signals:
        if signal.name == name:
            return signal
    raise InvalidInput(f'{where}: {name} is no signal of {message.name}; its signals are '
                       f'{", ".join(signal.name for signal in message.signals)}')
