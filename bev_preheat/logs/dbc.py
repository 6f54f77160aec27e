# SPDX-License-Identifier: Apache-2.0
"""DBC files, which describe the signals of CAN frames, and the values that mean no reading."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import check_input
from bev_preheat.optional_packages import require

# Values that the DBC gives such a name are no readings.
NO_READING = re.compile(r'(^|[^a-z])(sna|n\W?a|nan|init\w*|invalid|fault\w*|error|err|unknown|undefined|'
                        r'not ?(available|defined|valid|used)|no ?(signal|data|value)|reserved)([^a-z]|$)',
                        re.IGNORECASE)
# Fewer bits are counts or states, all values of which are used.
LEAST_BITS = 8


def load_dbc(file: str | Path) -> Any:
    """Return the cantools Database of a DBC file; raises InvalidInput if it cannot be read."""
    require('cantools')
    import cantools
    check_input(file)
    try:
        try:
            return cantools.database.load_file(str(file), strict=False)
        except Exception:
            mended = _with_nodes(Path(file).read_text(encoding='cp1252'))
            if mended is None:
                raise
            return cantools.database.load_string(mended, 'dbc', strict=False)
    except Exception as error:
        # cantools raises errors of its parser, of files and of encodings.
        raise InvalidInput(f'{file}: cannot be read as a DBC: {quoted(" ".join(str(error).split()))}') from error


def _with_nodes(text: str) -> str | None:
    """Return a DBC with the sections BS_ and BU_, which some tools leave out; None if it has both."""
    missing = [key for key in ('BS_:', 'BU_:') if not re.search(rf'^\s*{key[:-1]}\s*:', text, re.MULTILINE)]
    first = re.search(r'^\s*BO_\s', text, re.MULTILINE)
    if not missing or first is None:
        return None
    return f'{text[:first.start()]}\n{" ".join(missing)}\n{text[first.start():]}'


def values_of_nothing(signal: Any) -> dict[float, str]:
    """Return the raw values of a cantools Signal whose names say that there is no reading, with these names."""
    return {value: str(name) for value, name in (signal.choices or {}).items()
            if NO_READING.search(str(name).replace('_', ' '))}


def scaled(signal: Any, raw: float) -> float:
    """Return a raw value of a cantools Signal in its unit."""
    return float(signal.conversion.raw_to_scaled(raw, decode_choices=False))


def all_bits_set(signal: Any) -> tuple[float, ...]:
    """Return the value of a cantools Signal, in its unit, with all bits set; () if that is nothing special."""
    if signal.is_signed or signal.is_float or signal.length < LEAST_BITS:
        return ()
    return (scaled(signal, (1 << signal.length) - 1),)
