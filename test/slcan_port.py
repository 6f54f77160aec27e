# SPDX-License-Identifier: Apache-2.0
"""A CAN adapter with the LAWICEL (slcan) protocol on a pseudo terminal, written without python-can."""

import os
import select
import threading
import time
import tty

from waiting import poll_until


class SlcanPort:
    """The adapter: `send` puts a frame on the bus; `frames` are those that the other end has sent."""

    def __init__(self):
        """Open a pseudo terminal; `path` is the other end's file."""
        self._mine, self._theirs = os.openpty()
        tty.setraw(self._mine)
        tty.setraw(self._theirs)
        os.set_blocking(self._mine, False)
        self.path = os.ttyname(self._theirs)
        self.frames = []
        self.commands = []
        self._open = True
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def send(self, identifier, data):
        self.send_text(f't{identifier:03X}{len(data)}{data.hex().upper()}\r'.encode())

    def send_text(self, text):
        """Send any bytes; those that nobody takes are lost, as on a bus."""
        try:
            os.write(self._mine, text)
        except (BlockingIOError, OSError):
            pass

    def close(self):
        self._open = False
        self._thread.join()
        os.close(self._mine)
        os.close(self._theirs)

    def wait_for(self, condition):
        """Return the first new (instant, identifier, data) with condition(identifier, data)."""
        first = len(self.frames)
        return poll_until(lambda: next(
            (frame for frame in self.frames[first:] if condition(*frame[1:])), None), 'such a frame')

    def _receive(self):
        text = b''
        while self._open:
            if not select.select([self._mine], [], [], 0.05)[0]:
                continue
            try:
                text += os.read(self._mine, 4096)
            except OSError:
                continue
            *lines, text = text.split(b'\r')
            for line in lines:
                self._take(line)

    def _take(self, line):
        if line[:1] != b't':
            self.commands.append(line)
            return
        length = int(line[4:5])
        self.frames.append((
            time.monotonic(), int(line[1:4], 16), bytes.fromhex(line[5:5 + 2 * length].decode())))
