# SPDX-License-Identifier: Apache-2.0
"""The formats of logs; a file's format is found by its content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.channels import RawLog
from bev_preheat.logs.json_lines import open_json_lines
from bev_preheat.logs.long_csv import open_long_csv
from bev_preheat.logs.text_lines import read_head
from bev_preheat.logs.wide_csv import open_wide_csv

# Each takes a path and the file's first bytes, and returns the open log, None if the file has another format.
FORMATS: tuple[Callable[[str | Path, bytes], RawLog | None], ...] = (
    open_json_lines, open_long_csv, open_wide_csv)


def open_log(path: str | Path) -> RawLog:
    """Return the open log of a file; raise InvalidInput if it cannot be read or has no known format."""
    head = read_head(path)
    for open_format in FORMATS:
        log = open_format(path, head)
        if log is not None:
            return log
    raise InvalidInput(f'{path}: is no log of a known format; known: CSV with a header (one column a signal, or '
                       'SECONDS;PID;VALUE;UNITS), JSON lines, MDF4, candump, ASC or BLF with a DBC, MCAP and rosbag2')
