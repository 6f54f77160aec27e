# SPDX-License-Identifier: Apache-2.0
"""Entries of /diagnostics: written by every node, and read back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bev_preheat.messages.fields import time_message

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def entry(node_name: str, part: str, hardware: str, level: bytes, message: str,
          values: Mapping[str, str] | None = None) -> DiagnosticStatus:
    """Return the DiagnosticStatus `NODE: part` with figures by name."""
    return DiagnosticStatus(
        name=f'{node_name.lstrip("/")}: {part}', hardware_id=hardware, level=level, message=message,
        values=[KeyValue(key=key, value=value) for key, value in (values or {}).items()])


def judged(node_name: str, part: str, hardware: str, errors: Sequence[str], warnings: Sequence[str], good: str,
           values: Mapping[str, str] | None = None) -> DiagnosticStatus:
    """Return the DiagnosticStatus `NODE: part`: ERROR with any error, else WARN with any warning, else OK."""
    return entry(node_name, part, hardware, ERROR if errors else WARN if warnings else OK,
                 '; '.join([*errors, *warnings]) or good, values)


def diagnostics(now_ns: int, entries: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return the DiagnosticArray of entries at an instant [ns]."""
    message = DiagnosticArray(status=list(entries))
    message.header.stamp = time_message(now_ns)
    return message


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """Return the figures of an entry by name."""
    return {item.key: item.value for item in status.values}
