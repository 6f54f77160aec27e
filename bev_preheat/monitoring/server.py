# SPDX-License-Identifier: Apache-2.0
"""
The web server, in a thread of its own: the page and its files, the token, requests to planners, browser tabs.

A tab that does not read gets no further messages, and is closed after a while, so that no memory grows.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address
import json
import os
import socket
from threading import Event, Thread
import time
from typing import Any, NamedTuple

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from bev_preheat.errors import InvalidInput
from bev_preheat.monitoring.access import Access, COOKIE, HEADERS
from bev_preheat.monitoring.pages import file_of, FILES, login_page, main_page
from bev_preheat.monitoring.source import asked_of, Cursor, LiveSource
from bev_preheat.monitoring.view import written

# A wrong token is answered after this time [s]; meanwhile only so many others are.
WRONG_TOKEN_S, MOST_WRONG_TOKENS = 1.0, 20
# Longer than a planner may take to be found, to answer and to report.
LONGEST_REQUEST_S = 15.0
# A tab that has not read for this time is closed [s].
TAB_CLOSED_AFTER_S = 30.0
MOST_TABS = 64


class Shared(NamedTuple):
    """What all handlers use; `log` takes a sentence, `wrong_tokens` are those that wait for their answer."""

    access: Access
    source: LiveSource
    tabs: set[Any]
    log: Callable[[str], object]
    wrong_tokens: set[object]


class Checked(RequestHandler):
    """Refuses a request by its headers before anything else is done with it."""

    is_followed = False
    needs_session = True

    @property
    def shared(self) -> Shared:
        """The Shared of the server."""
        shared: Shared = self.settings['shared']
        return shared

    def set_default_headers(self) -> None:
        """Send the security headers with every answer."""
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header('Server')

    def prepare(self) -> None:
        """Raise HTTPError if the request is not from this page, or needs the token."""
        access, headers = self.shared.access, self.request.headers
        if not access.allows_host(headers.get('Host', '')):
            raise HTTPError(421, reason='Unknown host name')
        if self.is_followed and not access.is_same_origin(headers):
            raise HTTPError(403, reason='Not from this page')
        if self.needs_session and not access.is_session(self.cookie):
            raise HTTPError(401, reason='Token needed')

    @property
    def cookie(self) -> str:
        """The cookie of the session, '' without one."""
        return str(self.get_cookie(COOKIE, '') or '')

    def write_page(self, text: str) -> None:
        """Answer with a page."""
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(text)

    def write_error(self, status_code: int, **options: Any) -> None:
        """Answer with one line."""
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(f'{status_code}: {self._reason}\n')

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Log an unexpected exception in one line, without the request's address."""
        if not isinstance(error, HTTPError | WebSocketClosedError):
            self.shared.log(f'web page: {type(error).__name__}: {error}')


class MissingHandler(Checked):
    """Any other address."""

    needs_session = False

    def prepare(self) -> None:
        """Refuse."""
        super().prepare()
        raise HTTPError(404)


class MainHandler(Checked):
    """The page, or the form for the token."""

    needs_session = False

    async def get(self) -> None:
        """Answer; a token in the address is exchanged for the cookie and leaves the address."""
        access = self.shared.access
        token = self.get_query_argument('token', '')
        if token and access.needs_token:
            await exchange_token(self, token)
        elif access.is_session(self.cookie):
            self.write_page(main_page(self.shared.source.has_controls))
        else:
            self.set_status(401)
            self.write_page(login_page(''))


class LoginHandler(Checked):
    """The token from the form."""

    needs_session, is_followed = False, True

    async def post(self) -> None:
        """Exchange the token for the cookie."""
        await exchange_token(self, self.get_body_argument('token', ''))


async def exchange_token(handler: Checked, token: str) -> None:
    """Set the cookie and go to the page; answer a wrong token late."""
    access, waiting = handler.shared.access, handler.shared.wrong_tokens
    if access.is_token(token):
        handler.set_cookie(COOKIE, access.session, httponly=True, samesite='Strict', path='/')
        handler.redirect('/', status=303)
        return
    if len(waiting) >= MOST_WRONG_TOKENS:
        raise HTTPError(429, reason='Too many wrong tokens')
    waiting.add(handler)
    try:
        await asyncio.sleep(WRONG_TOKEN_S)
    finally:
        waiting.discard(handler)
    handler.set_status(401)
    handler.write_page(login_page('This is not the token.'))


class AssetHandler(Checked):
    """A script or a style."""

    needs_session = False

    def get(self, name: str) -> None:
        """Answer with the file."""
        if name not in FILES:
            raise HTTPError(404)
        self.set_header('Content-Type', f'{FILES[name]}; charset=utf-8')
        # Its name stays the same after an update.
        self.set_header('Cache-Control', 'no-cache')
        self.finish(file_of(name))


class AskHandler(Checked):
    """A request to a planner."""

    is_followed = True

    def answer(self, is_accepted: bool, text: str, status: int = 200) -> None:
        """Answer with JSON."""
        self.set_status(status)
        self.set_header('Content-Type', 'application/json')
        self.finish(written({'isAccepted': is_accepted, 'text': text}))

    async def post(self) -> None:
        """Ask the planner and answer with its answer."""
        source = self.shared.source
        if not source.has_controls:
            raise HTTPError(403, reason='Controls are off; the parameter controls switches them on')
        if self.request.headers.get('Content-Type', '').partition(';')[0] != 'application/json':
            raise HTTPError(415)
        try:
            values = json.loads(self.request.body)
            asked = asked_of(values)
        except (ValueError, RecursionError) as error:
            self.answer(False, str(error) if isinstance(error, InvalidInput) else 'The request is not JSON.', 400)
            return
        answered = source.ask(str(values.get('planner', '')), asked)
        if answered is None:
            self.answer(False, 'There is no such planner.', 404)
            return
        try:
            answer = await asyncio.wait_for(asyncio.wrap_future(answered), LONGEST_REQUEST_S)
        except TimeoutError:
            self.answer(False, 'No answer in time; look at the status.', 504)
            return
        self.answer(*answer)


class TabHandler(Checked, WebSocketHandler):
    """A browser tab: gets the list of planners and the messages of the chosen one."""

    is_followed = True

    def prepare(self) -> None:
        """Check the request before the connection becomes a WebSocket."""
        super().prepare()
        if len(self.shared.tabs) >= MOST_TABS:
            raise HTTPError(503, reason='Too many tabs')

    def check_origin(self, origin: str) -> bool:
        """Allow only the page itself; `prepare` has refused the others."""
        return self.shared.access.is_same_origin(self.request.headers)

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
        self._ready, self._thread = Event(), Thread(
            target=lambda: asyncio.run(self._serve()), name='web page', daemon=True)
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
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._end.wait(), EVENT_PERIOD_S)
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
