# SPDX-License-Identifier: Apache-2.0
"""Run a process in a terminal of its own, as a person would start it, and read its screen."""

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

    def __init__(self, command, columns, rows, environment):
        """Start a command (a list) in a terminal of this size, with some more variables of the environment."""
        self._terminal, theirs = pty.openpty()
        self._is_open = True
        self.resize(columns, rows)
        os.set_blocking(self._terminal, False)
        self._process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
            preexec_fn=_take_terminal,  # noqa: PLW1509  started before any thread
            env={**{name: value for name, value in os.environ.items() if name not in ('COLUMNS', 'LINES')},
                 'TERM': 'xterm-256color', **environment})
        os.close(theirs)
        self.views, self.tail = 0, b''

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self.close()

    @property
    def process_id(self):
        return self._process.pid

    @property
    def exit_status(self):
        """None while it runs; then 0 ... 255, or -N if signal N ended it."""
        return self._process.poll()

    @property
    def view(self):
        """The latest complete view, as text without colors."""
        parts = self.tail.split(HOME)
        drawn = parts[-2] if len(parts) > 2 else b''
        return CONTROL_SEQUENCE.sub('', drawn.decode('utf-8', 'replace')).replace('\r', '')

    @property
    def has_left_terminal_as_it_was(self):
        """Whether the cursor is visible and the first screen is back, if they ever were not."""
        return (self.tail.rfind(SHOW_CURSOR) >= self.tail.rfind(HIDE_CURSOR)
                and self.tail.rfind(FIRST_SCREEN) >= self.tail.rfind(OTHER_SCREEN))

    def resize(self, columns, rows):
        fcntl.ioctl(self._terminal, termios.TIOCSWINSZ, struct.pack('HHHH', rows, columns, 0, 0))

    def type(self, keys):
        os.write(self._terminal, keys)

    def read(self, duration_s):
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

    def wait(self, timeout_s=SECONDS_TO_END):
        """Return the exit status, reading meanwhile; None if the process has not ended in time."""
        end_s = time.monotonic() + timeout_s
        while self.exit_status is None and time.monotonic() < end_s:
            self.read(0.05)
        self.read(0.05)
        return self.exit_status

    def close(self):
        """Close the terminal, as closing its window would."""
        if self._is_open:
            os.close(self._terminal)
            self._is_open = False


def _take_terminal():
    """Make standard input the controlling terminal, so that Ctrl-C reaches the process."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
