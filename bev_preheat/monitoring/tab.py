# SPDX-License-Identifier: Apache-2.0
"""
A browser tab at the other end of a WebSocket.

A tab that does not read gets no further messages, and is closed after a while, so that no memory grows.
"""

from __future__ import annotations

import asyncio
import json
import time
from typing import Any

from tornado.web import HTTPError
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from bev_preheat.monitoring.handlers import Checked
from bev_preheat.monitoring.plain import written
from bev_preheat.monitoring.source import Cursor

# A tab that has not read for this time is closed [s].
TAB_CLOSED_AFTER_S = 30.0
MOST_TABS = 64


class TabHandler(Checked, WebSocketHandler):
    """A browser tab: gets the list of planners and the messages of the chosen one."""

    is_followed = True

    def prepare(self) -> None:
        """Check the request before the connection becomes a WebSocket."""
        self.check()
        if len(self.shared.tabs) >= MOST_TABS:
            raise HTTPError(503, reason='Too many tabs')

    def check_origin(self, origin: str) -> bool:
        """Allow only the page itself; `prepare` has refused the others."""
        return self.shared.access.is_same_origin(self.request.headers)

    def write_error(self, status_code: int, **options: Any) -> None:
        """Answer with one line."""
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(f'{status_code}: {self._reason}\n')

    def open(self, *arguments: str, **named: str) -> None:
        """Start."""
        self._planner, self._cursor, self._list = '', Cursor(), ''
        self._sending: asyncio.Future[None] | None = None
        self._sent_s = time.monotonic()
        self.set_nodelay(True)
        self.shared.tabs.add(self)
        self.send()

    def on_message(self, text: str | bytes) -> None:
        """Change the planner that the tab shows."""
        try:
            planner = json.loads(text)['planner']
        except (ValueError, TypeError, KeyError, RecursionError):
            self.close(1003, 'not understood')
            return
        self._planner, self._cursor = str(planner), Cursor()
        self.send()

    def on_close(self) -> None:
        """End."""
        self.shared.tabs.discard(self)

    def send(self) -> None:
        """Send the new values, unless the tab has not read the previous messages yet."""
        now_s = time.monotonic()
        if self._sending is not None and not self._sending.done():
            if now_s - self._sent_s > TAB_CLOSED_AFTER_S:
                self.shared.tabs.discard(self)
                self.close(1008, 'does not read')
                # The closing message would wait behind the unread ones.
                if self.ws_connection is not None and self.ws_connection.stream is not None:
                    self.ws_connection.stream.close()
            return
        source = self.shared.source
        texts = []
        planners = written({'planners': source.planners(now_s)})
        if planners != self._list:
            self._list = planners
            texts.append(planners)
        message = source.message(self._planner, self._cursor, now_s)
        if message is not None:
            texts.append(message)
        if texts:
            self._sent_s = now_s
            self._sending = asyncio.ensure_future(self._write(texts))

    async def _write(self, texts: list[str]) -> None:
        try:
            for text in texts:
                await self.write_message(text)
        except WebSocketClosedError:
            self.shared.tabs.discard(self)
