# SPDX-License-Identifier: Apache-2.0
"""A recording of CAN frames in place of a bus, at the pace at which it was recorded."""

from __future__ import annotations

from collections.abc import Iterator
import time
from typing import Any

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.can_frames import recorded_frames


class ReplayBus:
    """The frames of a candump, ASC or BLF file, received as from a bus; frames that are sent go nowhere."""

    def __init__(self, path: str) -> None:
        """Open a file; raises InvalidInput if it is no recording of CAN frames."""
        self._frames: Iterator[Any] = recorded_frames(path)
        first = next(self._frames, None)
        if first is None:
            raise InvalidInput(f'{path}: has no CAN frames')
        self._next: Any = first
        self._path = path
        self._offset_s = time.monotonic() - first.timestamp

    def recv(self, timeout: float) -> Any:
        """Return the next frame once it is due, None if none is due within `timeout` [s]."""
        if self._next is None:
            time.sleep(timeout)
            return None
        wait_s = self._next.timestamp + self._offset_s - time.monotonic()
        if wait_s > timeout:
            time.sleep(timeout)
            return None
        if wait_s > 0.0:
            time.sleep(wait_s)
        frame, self._next = self._next, next(self._frames, None)
        # It arrives now, whenever it was recorded.
        frame.timestamp = 0.0
        return frame

    def send(self, message: Any, timeout: float | None = None) -> None:
        """Take a frame and do nothing: a recording has no receiver."""

    def shutdown(self) -> None:
        """Close the file."""
        self._next = None
        self._frames = iter(())
