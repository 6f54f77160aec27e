# SPDX-License-Identifier: Apache-2.0
"""The web server, in a thread of its own."""

from __future__ import annotations

import asyncio
from ipaddress import ip_address
import os
import socket
from threading import Event, Thread
from typing import TYPE_CHECKING

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application

from bev_preheat.errors import InvalidInput
from bev_preheat.monitoring.handlers import (
    AskHandler,
    AssetHandler,
    LoginHandler,
    MainHandler,
    MissingHandler,
    Shared,
    TabHandler,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.monitoring.access import Access
    from bev_preheat.monitoring.source import LiveSource

EVENT_PERIOD_S = 0.5
LARGEST_BODY_BYTES, LARGEST_HEADER_BYTES, LARGEST_MESSAGE_BYTES = 4096, 16384, 1024
STOPPED_WITHIN_S = 3.0
# Addresses reserved for documentation: they are routed like any other, and no host has them.
ELSEWHERE = {4: (socket.AF_INET, '192.0.2.1'), 6: (socket.AF_INET6, '2001:db8::1')}


class PageServer:
    """Serves a LiveSource. The port is taken by the constructor, the rest starts with `start`."""

    def __init__(self, access: Access, port: int, source: LiveSource, log: Callable[[str], object]) -> None:
        """Bind; raises InvalidInput if address or port cannot be used."""
        try:
            self._sockets: list[socket.socket] = bind_sockets(port, access.address, reuse_port=False)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise InvalidInput(f'port: {access.address}:{port} cannot be used: {reason}; choose another with '
                               'port:=, or 0 for any free one') from error
        self.port: int = self._sockets[0].getsockname()[1]
        self._shared = Shared(access, source, set(), log, set())
        self._ready, self._thread = Event(), Thread(target=self._run, name='web page', daemon=True)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None

    @property
    def url(self) -> str:
        """The page's address for a browser, on another device if the page is for other devices."""
        address = own_address(self._shared.access.address)
        host = f'[{address}]' if ':' in address else address
        return f'http://{host}:{self.port}/'

    @property
    def tabs(self) -> int:
        """The number of open tabs."""
        return len(self._shared.tabs)

    def start(self) -> None:
        """Serve from now on."""
        self._thread.start()
        self._ready.wait()

    def stop(self) -> None:
        """Close all connections and the port."""
        if self._loop is not None and self._end is not None:
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(STOPPED_WITHIN_S)

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        application = Application(
            [('/', MainHandler), ('/login', LoginHandler), ('/tab', TabHandler), ('/ask', AskHandler),
             ('/assets/([a-zA-Z0-9._]+)', AssetHandler)],
            default_handler_class=MissingHandler, shared=self._shared, compress_response=True,
            websocket_max_message_size=LARGEST_MESSAGE_BYTES, websocket_ping_interval=10,
            # Addresses of requests may have the token in them.
            log_function=lambda handler: None)
        server = HTTPServer(application, max_body_size=LARGEST_BODY_BYTES, max_header_size=LARGEST_HEADER_BYTES,
                            idle_connection_timeout=60, body_timeout=10)
        server.add_sockets(self._sockets)
        self._ready.set()
        try:
            while not self._end.is_set():
                for tab in list(self._shared.tabs):
                    tab.send()
                try:
                    await asyncio.wait_for(self._end.wait(), EVENT_PERIOD_S)
                except TimeoutError:
                    pass
        finally:
            server.stop()
            for tab in list(self._shared.tabs):
                tab.close(1001, 'the dashboard ends')
            await server.close_all_connections()


def own_address(address: str) -> str:
    """
    Return an address at which a server bound to an IP address is reached.

    For 0.0.0.0 and ::, which mean all addresses of this computer, that is the one from which it reaches others, or
    its name if it has no network.
    """
    bound = ip_address(address)
    if not bound.is_unspecified:
        return address
    family, elsewhere = ELSEWHERE[bound.version]
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            # This chooses the own address; nothing is sent.
            probe.connect((elsewhere, 9))
            return str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname()
