# SPDX-License-Identifier: Apache-2.0
"""Run a process in a terminal of its own, as a person would start it, and read its screen."""

from __future__ import annotations

import errno
import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

# Moves the cursor to the top, which starts a new view of the whole screen.
HOME = b'\x1b[H'
OTHER_SCREEN, FIRST_SCREEN = b'\x1b[?1049h', b'\x1b[?1049l'
HIDE_CURSOR, SHOW_CURSOR = b'\x1b[?25l', b'\x1b[?25h'
CONTROL_SEQUENCE = re.compile(r'\x1b\[[0-9;?]*[A-Za-z]')
CTRL_C = b'\x03'
# Length of the stored end of the output.
MOST_BYTES = 200_000
CHUNK_BYTES = 1 << 16
SECONDS_TO_END = 10.0


class TerminalProcess:
    """
    A process whose standard streams are a terminal; as a context manager it ends the process on leaving.

    `views` counts the full-screen views drawn so far, `tail` is the end of the output.
    """

    def __init__(self, command: Sequence[str], columns: int, rows: int,
                 environment: Mapping[str, str] | None = None) -> None:
        """Start a command (a list) in a terminal of this size."""
        self._terminal, theirs = pty.openpty()
        self._is_open = True
        self.resize(columns, rows)
        os.set_blocking(self._terminal, False)
        self._process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
            preexec_fn=_take_terminal,  # noqa: PLW1509  started before any thread
            env={**_without_size(os.environ), 'TERM': 'xterm-256color', **(environment or {})})
        os.close(theirs)
        self.views, self.tail = 0, b''

    def __enter__(self) -> TerminalProcess:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self.close()

    @property
    def process_id(self) -> int:
        return self._process.pid

    @property
    def exit_status(self) -> int | None:
        """None while it runs; then 0 ... 255, or -N if signal N ended it."""
        return self._process.poll()

    @property
    def view(self) -> str:
        """The latest complete view, as text without colors."""
        parts = self.tail.split(HOME)
        drawn = parts[-2] if len(parts) > 2 else b''
        return CONTROL_SEQUENCE.sub('', drawn.decode('utf-8', 'replace')).replace('\r', '')

    @property
    def has_left_terminal_as_it_was(self) -> bool:
        """Whether the cursor is visible and the first screen is back, if they ever were not."""
        return (self.tail.rfind(SHOW_CURSOR) >= self.tail.rfind(HIDE_CURSOR)
                and self.tail.rfind(FIRST_SCREEN) >= self.tail.rfind(OTHER_SCREEN))

    def resize(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._terminal, termios.TIOCSWINSZ, struct.pack('HHHH', rows, columns, 0, 0))

    def type(self, keys: bytes) -> None:
        os.write(self._terminal, keys)

    def read(self, duration_s: float) -> bytes:
        """Read the output for a duration [s] or until the process ends; return it as bytes."""
        end_s, came = time.monotonic() + duration_s, bytearray()
        while (left_s := end_s - time.monotonic()) > 0.0:
            if not select.select([self._terminal], [], [], left_s)[0]:
                break
            try:
                chunk = os.read(self._terminal, CHUNK_BYTES)
            except OSError as error:
                # The kernel's error for a terminal that no process has open any more.
                if error.errno != errno.EIO:
                    raise
                break
            came += chunk
        joined = self.tail[-len(HOME) + 1:] + came
        self.views += joined.count(HOME)
        self.tail = (self.tail + came)[-MOST_BYTES:]
        return bytes(came)

    def wait(self, timeout_s: float = SECONDS_TO_END) -> int | None:
        """Return the exit status, reading meanwhile; None if the process has not ended in time."""
        end_s = time.monotonic() + timeout_s
        while self.exit_status is None and time.monotonic() < end_s:
            self.read(0.05)
        self.read(0.05)
        return self.exit_status

    def close(self) -> None:
        """Close the terminal, as closing its window would."""
        if self._is_open:
            os.close(self._terminal)
            self._is_open = False


def _without_size(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without a terminal size."""
    return {name: value for name, value in environment.items() if name not in ('COLUMNS', 'LINES')}


def _take_terminal() -> None:
    """Make standard input the controlling terminal, so that Ctrl-C reaches the process."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
