# SPDX-License-Identifier: Apache-2.0
"""Messages and signals of a DBC: which bits are theirs, and which raw values are no readings."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import combinations
import math
from pathlib import Path
import re
from typing import Any

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.files.input_files import check_input
from bev_preheat.files.table import encoding_of
from bev_preheat.optional_packages import require

# Values that the DBC gives such a name are no readings.
NO_READING = re.compile(
    r'(?<![a-z])(sna|n\W?a|nan|init\w*|err|nicht ?\w*|(no|keine?) ?(signal|data|value|sensor|daten|wert)\w*)'
    r'(?![a-z])|not ?(av|def|val|used|supp|ready|conn|init)|invalid|fault|error|fehler|defe[ck]t|fail|unavail|'
    r'lost|(im|un)plausib|unknown|unbekannt|undef|ung(ü|ue)ltig|reserved|missing|timeout|circuit|out ?of ?range',
    re.IGNORECASE)
# Of an identifier of J1939: all but priority and sender; a DBC has this one for any sender.
J1939_GROUP, ANY_SENDER = 0x03FFFF00, 0xFE


def identifying_bits(identifier: int, is_extended: bool) -> int:
    """Return the bits of the identifier of a message of a DBC that each of its frames has."""
    if not is_extended:
        return 0x7FF
    return J1939_GROUP if identifier & 0xFF == ANY_SENDER else 0x1FFFFFFF


# Fewer bits are counts or states, all values of which are used.
LEAST_BITS = 8
# SAE J1939-71: measurements have a first byte of at most this; those above mean an error, not available, or are
# reserved. Signals of less than LEAST_BITS_BY_BYTE bits leave out as many values at the end.
HIGHEST_BYTE, LEAST_BITS_BY_BYTE = 0xFA, 12
FRAME_FORMAT = ('BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
                'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n')
# Bits in a message.
LONGEST_BITS = 60


def load_dbc(file: str | Path) -> Any:
    """Return the cantools Database of a DBC file; raises InvalidInput if it cannot be read."""
    require('cantools')
    import cantools
    check_input(file)
    try:
        data = Path(file).read_bytes()
        text = data.decode('utf-8-sig' if encoding_of(data) == 'utf-8-sig' else 'cp1252', 'replace')
        # Signals that overlap are refused only if they are used; see `part_of`.
        return cantools.database.load_string(_with_frame_format(_with_nodes(text)), 'dbc', strict=False)
    except Exception as error:
        # cantools raises errors of its parser, of files and of encodings.
        raise InvalidInput(f'{file}: cannot be read as a DBC: {quoted(" ".join(str(error).split()))}') from error


def _with_nodes(text: str) -> str:
    """Return a DBC with the sections BS_ and BU_, which some tools leave out."""
    missing = [key for key in ('BS_:', 'BU_:') if not re.search(rf'^\s*{key[:-1]}\s*:', text, re.MULTILINE)]
    first = re.search(r'^\s*BO_\s', text, re.MULTILINE)
    if not missing or first is None:
        return text
    return f'{text[:first.start()]}\n{" ".join(missing)}\n{text[first.start():]}'


def _with_frame_format(text: str) -> str:
    """Return a DBC whose messages say that they are of J1939 if the file says so for all."""
    is_j1939 = re.search(r'^BA_\s+"ProtocolType"\s+"J1939', text, re.MULTILINE)
    return text if not is_j1939 or '"VFrameFormat"' in text else f'{text}\n{FRAME_FORMAT}'


def values_of_nothing(signal: Any) -> dict[float, str]:
    """Return the raw values of a cantools Signal whose names say that there is no reading, with these names."""
    return {value: str(name) for value, name in (signal.choices or {}).items()
            if NO_READING.search(str(name).replace('_', ' '))}


def scaled(signal: Any, raw: float) -> float:
    """Return a raw value of a cantools Signal in its unit."""
    return float(signal.conversion.raw_to_scaled(raw, decode_choices=False))


def last_values(signal: Any) -> tuple[int, ...]:
    """Return raw values of a cantools Signal that often mean no reading: all bits set, both ends if signed."""
    if signal.is_float or signal.length < LEAST_BITS:
        return ()
    count = 1 << signal.length - int(signal.is_signed)
    return (-count, count - 1) if signal.is_signed else (count - 1,)


class NoReading:
    """Tells which raw values of a cantools Signal are no readings: by their names, `others`, or SAE J1939."""

    def __init__(self, message: Any, signal: Any, others: Mapping[float, str] | None = None) -> None:
        self._named = {**(others or {}), **values_of_nothing(signal)}
        is_j1939 = message.is_extended_frame and (
            message.protocol == 'j1939' or identifying_bits(message.frame_id, True) == J1939_GROUP)
        missing = 0xFF - HIGHEST_BYTE << (signal.length - 8 if signal.length >= LEAST_BITS_BY_BYTE else 0)
        has_limit = is_j1939 and signal.length >= LEAST_BITS and not (signal.is_float or signal.is_signed)
        self.highest_raw = (1 << signal.length) - 1 - missing if has_limit else math.inf

    def word(self, raw: float) -> str:
        """Return the meaning of a raw value that is no reading, else ''."""
        if (named := self._named.get(raw)) is not None:
            return named
        return 'error or not available (J1939)' if raw > self.highest_raw else ''


def part_of(message: Any, names: Collection[str]) -> Any:
    """
    Return a cantools Message with only the named signals and their multiplexers, to decode them.

    Raises InvalidInput if two signals of the same frame have bits in common.
    """
    from cantools.database import Message
    signals = {signal.name: signal for signal in message.signals}
    kept = [signals[name] for name in dict.fromkeys(
        each for name in names for each in (name, *_conditions(signals[name], signals)))]
    for one, other in combinations(kept, 2):
        mine, others = _conditions(one, signals), _conditions(other, signals)
        if any(mine[name].isdisjoint(others[name]) for name in mine.keys() & others.keys()):
            continue
        if shared := _bits(one) & _bits(other):
            bits = shortened(', '.join(map(str, sorted(shared))), LONGEST_BITS)
            raise InvalidInput(f'{message.name}: {one.name} and {other.name} overlap in the DBC (bits {bits}): '
                               'correct the DBC, or use only one')
    return Message(message.frame_id, message.name, message.length, kept, strict=False,
                   is_extended_frame=message.is_extended_frame)


def _conditions(signal: Any, signals: Mapping[str, Any]) -> dict[str, frozenset[int]]:
    """Return the values of each multiplexer with which a frame carries a signal."""
    found: dict[str, frozenset[int]] = {}
    while (name := signal.multiplexer_signal) is not None and name not in found:
        found[name] = frozenset(signal.multiplexer_ids or ())
        signal = signals[name]
    return found


def _bits(signal: Any) -> set[int]:
    """Return the bits of a signal, as a DBC counts them."""
    if signal.byte_order == 'little_endian':
        return set(range(signal.start, signal.start + signal.length))
    first = signal.start ^ 7
    return {bit ^ 7 for bit in range(first, first + signal.length)}
