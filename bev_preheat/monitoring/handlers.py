# SPDX-License-Identifier: Apache-2.0
"""
Answers of the web server: the page and its files, the token, requests to planners, browser tabs.

A tab that does not read gets no further messages, and is closed after a while, so that no memory grows.
"""

from __future__ import annotations

import asyncio
import json
import time
from typing import Any, NamedTuple, TYPE_CHECKING

from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from bev_preheat.errors import InvalidInput
from bev_preheat.monitoring.access import COOKIE, HEADERS
from bev_preheat.monitoring.pages import file_of, FILES, login_page, main_page
from bev_preheat.monitoring.source import asked_of, Cursor
from bev_preheat.monitoring.view import written

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.monitoring.access import Access
    from bev_preheat.monitoring.source import LiveSource

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


class Checked:
    """Refuses a request by its headers before anything else is done with it."""

    request: Any
    settings: dict[str, Any]
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
            self.set_header(name, value)  # type: ignore[attr-defined]
        self.clear_header('Server')  # type: ignore[attr-defined]

    def check(self) -> None:
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
        return str(self.get_cookie(COOKIE, '') or '')  # type: ignore[attr-defined]

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Log an unexpected exception in one line, without the request's address."""
        if not isinstance(error, HTTPError | WebSocketClosedError):
            self.shared.log(f'web page: {type(error).__name__}: {error}')


class PageHandler(Checked, RequestHandler):
    """A request for a page or a file."""

    def prepare(self) -> None:
        """Check the request."""
        self.check()

    def write_error(self, status_code: int, **options: Any) -> None:
        """Answer with one line."""
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(f'{status_code}: {self._reason}\n')

    def write_page(self, text: str) -> None:
        """Answer with a page."""
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(text)

    def write_json(self, value: Any, status: int = 200) -> None:
        """Answer with JSON."""
        self.set_status(status)
        self.set_header('Content-Type', 'application/json')
        self.finish(written(value))


class MissingHandler(PageHandler):
    """Any other address."""

    needs_session = False

    def prepare(self) -> None:
        """Refuse."""
        self.check()
        raise HTTPError(404)


class MainHandler(PageHandler):
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


class LoginHandler(PageHandler):
    """The token from the form."""

    needs_session, is_followed = False, True

    async def post(self) -> None:
        """Exchange the token for the cookie."""
        await exchange_token(self, self.get_body_argument('token', ''))


async def exchange_token(handler: PageHandler, token: str) -> None:
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


class AssetHandler(PageHandler):
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


class AskHandler(PageHandler):
    """A request to a planner."""

    is_followed = True

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
            text = str(error) if isinstance(error, InvalidInput) else 'The request is not JSON.'
            self.write_json({'isAccepted': False, 'text': text}, 400)
            return
        answered = source.ask(str(values.get('planner', '')), asked)
        if answered is None:
            self.write_json({'isAccepted': False, 'text': 'There is no such planner.'}, 404)
            return
        try:
            answer = await asyncio.wait_for(asyncio.wrap_future(answered), LONGEST_REQUEST_S)
        except TimeoutError:
            self.write_json({'isAccepted': False, 'text': 'No answer in time; look at the status.'}, 504)
            return
        self.write_json({'isAccepted': answer.is_accepted, 'text': answer.text})


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
