# SPDX-License-Identifier: Apache-2.0
"""The formats of logs; a file's format is found by its content."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.can_frames import open_can_frames
from bev_preheat.logs.channels import RawLog
from bev_preheat.logs.csv_log import open_csv_log
from bev_preheat.logs.json_lines import open_json_lines
from bev_preheat.logs.mdf import open_mdf
from bev_preheat.logs.ros_bag import is_bag_folder, open_ros_bag, RosBag
from bev_preheat.tables.text import encoding_of, read_head

# Each takes a path, the file's first bytes and the DBC files, and returns the open log, None for another format.
Opener = Callable[[str | Path, bytes, Collection[str | Path]], RawLog | None]
FORMATS: tuple[Opener, ...] = (
    open_mdf, open_can_frames,
    lambda path, head, databases: open_ros_bag(path, head),
    lambda path, head, databases: open_json_lines(path, head),
    lambda path, head, databases: open_csv_log(path, head))


def open_log(path: str | Path, databases: Collection[str | Path] = ()) -> RawLog:
    """
    Return the open log of a file, or of a rosbag2 folder; `databases` are DBC files for CAN frames.

    Raises InvalidInput if it cannot be read or has no known format.
    """
    if is_bag_folder(path):
        return RosBag(path)
    head = read_head(path)
    for open_format in FORMATS:
        log = open_format(path, head, databases)
        if log is not None:
            return log
    if encoding_of(head) is not None:
        raise InvalidInput(f'{path}: is text, but no log: a CSV log has a header that names its columns and '
                           'lines of '
                           'values below it, JSON lines have an object a line, candump has (time) channel frame')
    raise InvalidInput(f'{path}: is no log of a known format; known: CSV with a header (one column a signal, or '
                       'SECONDS;PID;VALUE;UNITS), JSON lines, MDF, candump, ASC or BLF with a DBC, MCAP and '
                       'rosbag2')
