# SPDX-License-Identifier: Apache-2.0
"""Checks of the frames of one CAN message: length, checksum (also of AUTOSAR), alive counter, rate."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from functools import reduce
from operator import xor
import re
from typing import Any, NamedTuple

from bev_preheat.bus.live_map import ChecksumRule, MessageRule
from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require

# Bits, polynomial, start value and final exclusive or.
Crc = tuple[int, int, int, int]
# SAE J1850; CRC8H2F of AUTOSAR (Specification of CRC Routines); CRC-8 of SMBus; CRC-16-CCITT as AUTOSAR has it.
CRCS: dict[str, Crc] = {
    'crc8_sae_j1850': (8, 0x1D, 0xFF, 0xFF), 'crc8_autosar': (8, 0x2F, 0xFF, 0xFF), 'crc8': (8, 0x07, 0x00, 0x00),
    'crc16_ccitt': (16, 0x1021, 0xFFFF, 0x0000)}
# Profiles 1 and 11 have the polynomial of SAE J1850, but start with 0.
CRC8_OF_PROFILE_1: Crc = (8, 0x1D, 0x00, 0x00)


class Profile(NamedTuple):
    """
    A profile of AUTOSAR's E2E Protocol Specification.

    `counts` is the number of values of its counter, `modes` how the data ID may take part: `both` bytes, the `low`
    one, `alternating` low and high with the counter, `nibble` (the low byte, and 4 bits of the high one in the
    frame), or a byte of a `list` by the counter.
    """

    crc: Crc
    counts: int
    modes: tuple[str, ...]
    is_behind: bool


PROFILES = {1: Profile(CRC8_OF_PROFILE_1, 15, ('both', 'alternating', 'low', 'nibble'), False),
            2: Profile(CRCS['crc8_autosar'], 16, ('list',), True),
            5: Profile(CRCS['crc16_ccitt'], 256, ('both',), True),
            11: Profile(CRC8_OF_PROFILE_1, 15, ('both', 'nibble'), False),
            22: Profile(CRCS['crc8_autosar'], 16, ('list',), True)}


class Checksum:
    """The checksum of a message: that of all bytes but its own, between prefix or suffix, or with a data ID."""

    def __init__(self, rule: ChecksumRule, message: Any, where: str, counter: Any = None) -> None:
        """
        Take cantools' Message and Signal of the counter; `where` is the key of the map.

        Raises InvalidInput if the rule contradicts itself or does not fit the message.
        """
        self._rule, self.signal = rule, rule.signal
        self.profile = None if rule.e2e_profile is None else PROFILES[rule.e2e_profile]
        problem = _rule_problem(rule) or (_counter_problem(rule, self.profile, counter) if self.profile else '')
        if problem:
            raise InvalidInput(f'{where}: {problem}')
        crc = CRCS.get(rule.method or '') if self.profile is None else self.profile.crc
        bits, polynomial, initial, final_xor = crc or (8, 0, 0, 0)
        self._order, self._at, self._bytes = _place_of(message, rule.signal, bits, f'{where}.signal')
        self._counter = counter
        self._nibble = None if rule.data_id_nibble is None else signal_of(
            message, rule.data_id_nibble, f'{where}.data_id_nibble')
        if self._nibble is not None and self._nibble.length != 4:
            raise InvalidInput(f'{where}.data_id_nibble: {message.name}.{self._nibble.name} has '
                               f'{self._nibble.length} bits; it must have 4')
        self._is_xor, self._crc = rule.method == 'xor', None
        self._initial = initial if rule.initial is None else rule.initial
        self._final_xor = final_xor if rule.final_xor is None else rule.final_xor
        if max(self._initial, self._final_xor) >= 1 << bits:
            raise InvalidInput(f'{where}: initial and final_xor of {rule.method} must be 0 ... {(1 << bits) - 1}')
        if crc is not None:
            require('crccheck')
            from crccheck import crc as crccheck
            self._crc = crccheck.Crc(bits, polynomial, self._initial, xor_output=self._final_xor)

    @property
    def nibble(self) -> tuple[str, int] | None:
        """The signal with 4 bits of the data ID, and their value; None without one."""
        return None if self._nibble is None else (self._nibble.name, (self._rule.data_id or 0) >> 8 & 0xF)

    def of(self, data: bytes) -> int:
        """Return the checksum of a frame's data; the bytes of the checksum itself do not count."""
        before, behind = self._identifier(data)
        protected = before + data[:self._at] + data[self._at + self._bytes:] + behind
        if self._crc is not None:
            self._crc.reset()
            return int(self._crc.process(protected).final())
        total = reduce(xor, protected, self._initial) if self._is_xor else sum(protected, self._initial)
        return (total & 0xFF) ^ self._final_xor

    def given(self, data: bytes) -> int:
        """Return the checksum that a frame carries."""
        return int.from_bytes(data[self._at:self._at + self._bytes], self._order)

    def written(self, data: bytes) -> bytes:
        """Return the data with its checksum in place."""
        return (data[:self._at] + self.of(data).to_bytes(self._bytes, self._order) + data[self._at + self._bytes:])

    def problem(self, data: bytes) -> str:
        """Return why a frame is refused; '' for a right one."""
        digits, given, computed = 2 * self._bytes, self.given(data), self.of(data)
        if self.profile is not None and (count := raw_of(self._counter, data)) >= self.profile.counts:
            return (f'{self._counter.name} is {count}; E2E profile {self._rule.e2e_profile} counts to '
                    f'{self.profile.counts - 1}')
        if given != computed:
            return (f'{self.signal} is 0x{given:0{digits}X}, but the checksum of the data is '
                    f'0x{computed:0{digits}X}')
        if self.nibble is not None and (nibble := raw_of(self._nibble, data)) != self.nibble[1]:
            return f'{self.nibble[0]} is 0x{nibble:X}, but that of the data ID is 0x{self.nibble[1]:X}'
        return ''

    def _identifier(self, data: bytes) -> tuple[bytes, bytes]:
        """Return the bytes that are put before and behind a frame's data."""
        rule = self._rule
        if self.profile is None:
            return bytes(rule.prefix), bytes(rule.suffix)
        count = raw_of(self._counter, data)
        if rule.data_ids:
            added = bytes([rule.data_ids[count % len(rule.data_ids)]])
        else:
            low, high = (rule.data_id or 0) & 0xFF, (rule.data_id or 0) >> 8
            added = bytes({'both': (low, high), 'low': (low,), 'nibble': (low, 0),
                           'alternating': (high if count % 2 else low,)}[rule.mode])
        return (b'', added) if self.profile.is_behind else (added, b'')


def _rule_problem(rule: ChecksumRule) -> str:
    """Return why the keys do not belong together; '' if they do."""
    if (rule.method is None) is (rule.e2e_profile is None):
        return 'must have either method or e2e_profile'
    others = {'data_id': rule.data_id, 'data_ids': rule.data_ids or None, 'data_id_mode': rule.data_id_mode,
              'data_id_nibble': rule.data_id_nibble} if rule.e2e_profile is None else {
        'prefix': rule.prefix or None, 'suffix': rule.suffix or None, 'initial': rule.initial,
        'final_xor': rule.final_xor}
    for key, value in others.items():
        if value is not None:
            return f'{key} does not belong to {"method" if rule.e2e_profile is None else "e2e_profile"}'
    if rule.e2e_profile is None:
        return ''
    modes = PROFILES[rule.e2e_profile].modes
    if modes == ('list',):
        return '' if rule.data_ids and rule.data_id is None else (
            f'e2e_profile {rule.e2e_profile} needs data_ids, a data ID for each of the 16 counts')
    if rule.data_id is None or rule.data_ids:
        return f'e2e_profile {rule.e2e_profile} needs data_id'
    if rule.mode not in modes:
        return f'data_id_mode of e2e_profile {rule.e2e_profile} must be {" or ".join(modes)}'
    if (rule.mode == 'nibble') is (rule.data_id_nibble is None):
        return 'data_id_nibble names the signal with 4 bits of the data ID for data_id_mode: nibble, and only then'
    return ''


def _counter_problem(rule: ChecksumRule, profile: Profile, counter: Any) -> str:
    """Return why a message's counter does not fit a profile; '' if it does."""
    bits = (profile.counts - 1).bit_length()
    if counter is None:
        return f'e2e_profile {rule.e2e_profile} needs the counter of the message: name it (counter: SIGNAL)'
    if counter.length != bits:
        return (f'{counter.name} has {counter.length} bits; the counter of e2e_profile {rule.e2e_profile} has '
                f'{bits}')
    return ''


def raw_of(signal: Any, data: bytes) -> int:
    """Return the raw value of a cantools Signal in a frame's data, without a sign."""
    mask = (1 << int(signal.length)) - 1
    if signal.byte_order == 'little_endian':
        return int.from_bytes(data, 'little') >> int(signal.start) & mask
    # The start is the highest bit; bits are numbered within their bytes.
    first = 8 * (int(signal.start) // 8) + 7 - int(signal.start) % 8
    return int.from_bytes(data, 'big') >> (8 * len(data) - first - int(signal.length)) & mask


def _place_of(message: Any, name: str, bits: int, where: str) -> tuple[Any, int, int]:
    """Return the byte order, the first byte and the number of bytes that a signal of `bits` bits fills."""
    signal = signal_of(message, name, where)
    first = 7 if signal.byte_order == 'big_endian' else 0
    if signal.length != bits or signal.start % 8 != first:
        count = 'one byte' if bits == 8 else f'{bits // 8} bytes'
        raise InvalidInput(f'{where}: {message.name}.{name} has {signal.length} bits from bit {signal.start}; '
                           f'this checksum must fill {count}')
    order = 'big' if signal.byte_order == 'big_endian' else 'little'
    return order, int(signal.start) // 8, bits // 8


def signal_of(message: Any, name: str, where: str) -> Any:
    """Return a signal of a cantools Message; raises InvalidInput with those that it has."""
    for signal in message.signals:
        if signal.name == name:
            return signal
    raise InvalidInput(f'{where}: {name} is no signal of {message.name}; its signals are '
                       f'{", ".join(signal.name for signal in message.signals)}')


# Counters are recognised by these words in their names, unless the map names one. Counts of faults have
# such names, too: a repeated count drops the frame only after so many frames with new counts in a row.
COUNTED_FRAMES = 3
COUNTER = re.compile(r'(^|_)(alive|alv|live|msg|message|rolling)?_?(counter|cntr|cnt|ctr|bz)$|alivecounter|'
                     r'rollingcounter|messagecounter', re.IGNORECASE)
# Messages of these send types (GenMsgSendType) also come between two cycles.
ON_CHANGE = re.compile('spontan|change|write|event|trigger', re.IGNORECASE)
# Frames within RATE_WINDOW_S may exceed those of the cycle time by this factor, and by MORE_FRAMES.
RATE_WINDOW_S, MOST_RATE, MORE_FRAMES = 1.0, 2.5, 2


class FrameChecks:
    """The checks of one message. A dropped frame leaves the last readings as they are, and these expire."""

    def __init__(self, message: Any, rule: MessageRule | None, where: str) -> None:
        """Take a cantools Message; raises InvalidInput if the map's rule does not fit it."""
        rule = rule or MessageRule()
        self.message = message
        self.counter = counter_of(message, rule.counter, where)
        self.checksum = None if rule.checksum is None else Checksum(
            rule.checksum, message, f'{where}.checksum', self.counter)
        self._largest_step = rule.largest_step
        self._count: int | None = None
        self._stays, self._advances = 0, 0 if rule.counter is None else COUNTED_FRAMES
        cycle_s = rule.cycle_time_s if rule.cycle_time_s is not None else (message.cycle_time or 0) / 1000.0
        self.cycle_time_s = cycle_s
        is_cyclic = rule.cycle_time_s is not None or not ON_CHANGE.search(message.send_type or '')
        self._most_frames = int(MOST_RATE * RATE_WINDOW_S / cycle_s + MORE_FRAMES) if (
            cycle_s > 0.0 and is_cyclic) else None
        self._instants_s: deque[float] = deque(maxlen=(self._most_frames or 0) + 1)

    def in_words(self) -> list[str]:
        """Return the names of counter, checksum and cycle time that are checked."""
        return [*([] if self.counter is None else [self.counter.name]),
                *([] if self.checksum is None else [self.checksum.signal]),
                *([f'{self.cycle_time_s:g} s'] if self._most_frames is not None else [])]

    def check_data(self, data: bytes, instant_s: float) -> None:
        """Raise InvalidInput if a frame comes too often, is too short, or has a wrong checksum."""
        name = self.message.name
        self._instants_s.append(instant_s)
        if self._most_frames is not None and len(self._instants_s) > self._most_frames:
            window_s = instant_s - self._instants_s[0]
            if window_s < RATE_WINDOW_S:
                raise InvalidInput(
                    f'{name}: {len(self._instants_s)} frames within {window_s:.2f} s; its cycle time of '
                    f'{self.cycle_time_s:g} s allows {self._most_frames} in {RATE_WINDOW_S:g} s; is there a '
                    'second sender?')
        if len(data) < self.message.length:
            raise InvalidInput(f'{name}: a frame of {len(data)} bytes; the DBC has {self.message.length}')
        if self.checksum is not None:
            problem = self.checksum.problem(data)
            if problem:
                raise InvalidInput(f'{name}: {problem}')

    def check_counter(self, values: Mapping[str, float]) -> None:
        """Raise InvalidInput if the counter of a frame with these raw values stays, or skips too many counts."""
        if self.counter is None or self.counter.name not in values:
            return
        name = f'{self.message.name}: the counter {self.counter.name}'
        count, before = int(values[self.counter.name]), self._count
        self._count = count
        if before is None:
            return
        if count != before:
            self._advances += 1
        elif self._advances < COUNTED_FRAMES:
            self._advances = 0
            return
        if count == before:
            self._stays += 1
            raise InvalidInput(f'{name} has stayed at {count} for {self._stays + 1} frames')
        self._stays = 0
        step = (count - before) % counts_of(self.counter, self.checksum)
        if self._largest_step is not None and step > self._largest_step:
            raise InvalidInput(f'{name} went from {before} to {count}; at most {self._largest_step} steps are '
                               'allowed')


def counts_of(signal: Any, checksum: Checksum | None) -> int:
    """Return how many values a counter has, before it begins again at 0; a Checksum's E2E profile says so."""
    if checksum is not None and checksum.profile is not None:
        return checksum.profile.counts
    highest = signal.maximum if signal.maximum else 2**signal.length - 1
    return int(min(highest, 2**signal.length - 1)) + 1


def counter_of(message: Any, name: str | None, where: str) -> Any:
    """Return the Signal that counts a message's frames: of this name, or recognised by its name; None: none."""
    if name is not None:
        return signal_of(message, name, f'{where}.counter')
    found = [signal for signal in message.signals if COUNTER.search(signal.name)]
    # Of several, only the map can decide which one counts the frames.
    return found[0] if len(found) == 1 and found[0].length <= 8 else None
