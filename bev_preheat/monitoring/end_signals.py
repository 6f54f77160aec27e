# SPDX-License-Identifier: Apache-2.0
"""The signals that end a view, recorded and handled between two steps."""

from __future__ import annotations

from contextlib import contextmanager
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

# A closed terminal ends the view like Ctrl-C.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class EndSignals:
    """Whether SIGINT, SIGTERM or SIGHUP has come; a second one raises KeyboardInterrupt."""

    def __init__(self) -> None:
        """Start without a signal."""
        self.have_come = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Record a signal; the second one interrupts a blocked output."""
        if self.have_come:
            raise KeyboardInterrupt
        self.have_come = True


@contextmanager
def end_signals() -> Iterator[EndSignals]:
    """Yield the EndSignals that record signals during the block."""
    taken = EndSignals()
    before = {number: signal.signal(number, taken) for number in END_SIGNALS}
    try:
        yield taken
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
