# SPDX-License-Identifier: Apache-2.0
"""The flight recording of one drive: the planner writes it into a folder of its own, then it becomes one file."""

from __future__ import annotations

import os
from pathlib import Path
import tempfile
from typing import TYPE_CHECKING

from bev_preheat.flight_recorder.ring import recordings_in, SUFFIX
from bev_preheat.optional_packages import is_installed

if TYPE_CHECKING:
    from contextlib import ExitStack
    from typing import Any

    from bev_preheat.files.output_files import AnyPath


def recording_beside(path: AnyPath) -> Path:
    """Return the path of a recording beside another output of the drive."""
    return Path(f'{os.path.splitext(path)[0]}{SUFFIX}')


class KeptRecording:
    """A planner's recording, kept at `path`; without the package mcap nothing is recorded."""

    def __init__(self, path: Path) -> None:
        """Record nothing yet."""
        self.path = path
        self._folder: Path | None = None

    def parameters(self, stack: ExitStack) -> dict[str, Any]:
        """Return the planner's parameters that make it record; `stack` deletes the working folder."""
        if not is_installed('mcap'):
            return {}
        # In the same folder, so that keeping it renames a file.
        self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory(
            prefix='.recording_', dir=self.path.parent)))
        return {'flight_recorder': self._folder}

    def keep(self) -> Path | None:
        """
        Keep the recording of a planner that has ended; return its path, None without a recording.

        A long drive has several files; these keep the names that replays put in order. Raises OSError.
        """
        parts = [] if self._folder is None else recordings_in(self._folder)
        kept = [self.path] if len(parts) == 1 else [self.path.with_name(part.name) for part in parts]
        for part, path in zip(parts, kept, strict=True):
            os.replace(part, path)
        return kept[0] if kept else None
