# SPDX-License-Identifier: Apache-2.0
"""The signals that end a view, recorded and handled between two steps."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

# A closed terminal ends the view like Ctrl-C.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class EndSignals:
    """Whether SIGINT, SIGTERM or SIGHUP has come within the block; a second one raises KeyboardInterrupt."""

    have_come = False

    def __enter__(self) -> EndSignals:
        self._before = {number: signal.signal(number, self._hear) for number in END_SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if self.have_come:
            # A blocked output must end, too.
            raise KeyboardInterrupt
        self.have_come = True
