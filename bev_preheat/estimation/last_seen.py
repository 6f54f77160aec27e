# SPDX-License-Identifier: Apache-2.0
"""The battery's last known state, and its form in the state file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData

# Temperature range of road vehicle batteries [deg C].
TEMPERATURE_RANGE_C = (-100.0, 150.0)
LATEST_NS = 2**63 - 1


@dataclass(frozen=True)
class LastSeen:
    """
    Battery temperature [deg C] and state of charge (0 ... 1) at an instant.

    The instant is in nanoseconds since the epoch, by the clock of the node that saw them.
    """

    temperature_c: float
    soc: float
    stamp_ns: int


def last_seen_entry(last_seen: LastSeen) -> FileData:
    """Return a LastSeen as plain values for JSON."""
    return asdict(last_seen)


def last_seen_from(entry: FileData) -> LastSeen:
    """Return the LastSeen of an entry; raise InvalidInput, naming field, value and range."""
    if not isinstance(entry, dict):
        raise InvalidInput('last_seen: must have temperature_c, soc and stamp_ns')
    temperature_c, soc = (
        _number(entry.get(name), f'last_seen.{name}', *limits)
        for name, limits in (('temperature_c', TEMPERATURE_RANGE_C), ('soc', (0.0, 1.0))))
    return LastSeen(temperature_c, soc, instant_from(entry.get('stamp_ns'), 'last_seen.stamp_ns'))


def instant_from(value: object, name: str) -> int:
    """Return an instant [ns] of a file; raise InvalidInput, naming field, value and range."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= LATEST_NS:
        raise InvalidInput(f'{name}: {quoted(str(value))} is not allowed; it must be a whole number, '
                           f'0 ... {LATEST_NS}')
    return value


def _number(value: object, name: str, low: float, high: float) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
        raise InvalidInput(f'{name}: {quoted(str(value))} is not allowed; it must be {low:g} ... {high:g}')
    return float(value)
