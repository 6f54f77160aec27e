# SPDX-License-Identifier: Apache-2.0
"""The web server: pages, tabs, requests; and those that must not get anything."""

import asyncio
from concurrent.futures import Future
from contextlib import closing
import json
import socket
import struct
import time
from urllib.error import HTTPError
from urllib.parse import urlencode, urlsplit
from urllib.request import build_opener, HTTPCookieProcessor, HTTPRedirectHandler, Request

import pytest
from seen_examples import a_board, a_plan, START_S
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect
from waiting import poll_until

from bev_preheat.monitoring import server
from bev_preheat.monitoring.access import Access
from bev_preheat.monitoring.server import FILES, PageServer
from bev_preheat.monitoring.source import Answer, Asked, LiveSource

TOKEN = 'correct-horse-battery'
LIMIT_S = 60.0


class Page:
    """A running server, and requests to it."""

    def __init__(self, token='', controls=False):
        self.source, self.logged, self.asked = LiveSource(), [], []
        self.source.boards = {'/planner': a_board(), '/car/planner': a_board(route_id='<b>two</b>')}
        if controls:
            self.source.ask_planner = self.answer
        self.server = PageServer(Access('127.0.0.1', token), 0, self.source, self.logged.append)
        self.server.start()
        self.host = f'127.0.0.1:{self.server.port}'
        self.result = Answer(True, 'Preheating is switched off.')

    def answer(self, planner, asked, at_s):
        self.asked.append((planner, asked, at_s))
        future = Future()
        future.set_result(self.result)
        return future

    def request(self, path='/', data=None, follow=True, **headers):
        """Return status, headers and text of an answer."""
        opener = build_opener() if follow else build_opener(_Unfollowed())
        request = Request(f'http://{self.host}{path}', data,
                          {name.replace('_', '-'): value for name, value in headers.items()})
        try:
            with opener.open(request, timeout=LIMIT_S) as answer:
                return answer.status, answer.headers, answer.read().decode()
        except HTTPError as error:
            return error.code, error.headers, error.read().decode()

    def ask(self, values, **headers):
        headers = {'Origin': f'http://{self.host}', 'Content_Type': 'application/json', **headers}
        return self.request('/ask', json.dumps(values).encode(), **headers)

    def connect(self, **headers):
        """Return the coroutine of a WebSocket to it."""
        headers = {'Origin': f'http://{self.host}', **{
            name.replace('_', '-'): value for name, value in headers.items()}}
        return websocket_connect(HTTPRequest(f'ws://{self.host}/tab', headers=headers, request_timeout=LIMIT_S))


class _Unfollowed(HTTPRedirectHandler):
    def redirect_request(self, *arguments):
        return None


@pytest.fixture
def page(request):
    """Return a Page; parametrize `page` with its arguments."""
    made = Page(**getattr(request, 'param', {}))
    yield made
    made.server.stop()
    assert made.logged == []


with_token = pytest.mark.parametrize('page', [{'token': TOKEN, 'controls': True}], indirect=True)
with_controls = pytest.mark.parametrize('page', [{'controls': True}], indirect=True)


def test_the_page_and_all_that_it_loads_come_from_it(page):
    status, headers, text = page.request()
    assert status == 200 and 'Battery preheating' in text and 'http://' not in text and 'https://' not in text
    assert "default-src 'none'" in headers['Content-Security-Policy'] and headers['Cache-Control'] == 'no-store'
    for name in FILES:
        status, headers, content = page.request(f'/assets/{name}')
        assert status == 200 and content and headers['X-Content-Type-Options'] == 'nosniff', name
        if name.startswith(('dashboard.', 'view', 'controls')):
            assert 'http://' not in content and 'https://' not in content and '.innerHTML' not in content, name
    assert text.count('/assets/') == len(FILES)
    for path in ('/assets/../server.py', '/assets/%2e%2e/server.py', '/assets/x', '/x'):
        assert page.request(path)[0] == 404, path


def test_without_controls_there_are_no_buttons_and_requests_are_refused(page):
    assert 'do-enable' not in page.request()[2]
    status, _, text = page.ask({'planner': '/planner', 'kind': 'disable'})
    assert status == 403 and 'Controls are off' in text and page.asked == []


@with_controls
def test_with_controls_the_answer_comes_back(page):
    assert 'do-enable' in page.request()[2]
    status, _, text = page.ask({'planner': '/planner', 'kind': 'disable'})
    assert (status, json.loads(text)) == (200, {'isAccepted': True, 'text': 'Preheating is switched off.'})
    page.result = Answer(False, 'The goal was refused: <too late>.')
    status, _, text = page.ask({'planner': '/car/planner', 'kind': 'prepare', 'minutes': 20})
    assert json.loads(text)['text'] == 'The goal was refused: <too late>.' and status == 200
    assert page.asked == [('/planner', Asked('disable'), START_S),
                          ('/car/planner', Asked('prepare', 20.0), START_S)]


@with_controls
@pytest.mark.parametrize('values, headers, status', [
    ({'planner': '/planner', 'kind': 'disable'}, {'Origin': 'http://evil.example'}, 403),
    ({'planner': '/planner', 'kind': 'disable'}, {'Content_Type': 'text/plain'}, 415),
    ({'planner': '/planner', 'kind': 'disable'}, {'Host': 'evil.example'}, 421),
    ({'planner': '/nobody', 'kind': 'disable'}, {}, 404),
    ({'planner': '/planner', 'kind': 'erase'}, {}, 400), ([[]], {}, 400)])
def test_what_is_not_from_the_page_or_makes_no_sense_reaches_no_planner(page, values, headers, status):
    assert page.ask(values, **headers)[0] == status
    assert page.asked == []


@with_controls
def test_broken_json_is_refused(page):
    for body in (b'', b'{', b'[' * 4000, b'\xff'):
        status, _, text = page.request('/ask', body, Origin=f'http://{page.host}', Content_Type='application/json')
        assert status == 400 and json.loads(text)['isAccepted'] is False
    # urllib may see the connection close before the answer.
    try:
        assert page.request('/ask', b'x' * 100_000, Origin=f'http://{page.host}',
                            Content_Type='application/json')[0] in (400, 413)
    except OSError:
        pass


@with_token
def test_without_the_token_there_is_nothing(page):
    status, _, text = page.request()
    assert status == 401 and 'type="password"' in text and 'do-enable' not in text
    assert page.ask({'planner': '/planner', 'kind': 'disable'})[0] == 401
    with pytest.raises(Exception, match='401'):
        asyncio.run(_open(page))
    assert page.asked == []


@with_token
def test_the_token_is_exchanged_for_a_cookie_and_leaves_the_address(page):
    status, headers, _ = page.request(f'/?token={TOKEN}', follow=False)
    assert (status, headers['Location']) == (303, '/')
    cookie = headers['Set-Cookie']
    assert 'HttpOnly' in cookie and 'SameSite=Strict' in cookie and TOKEN not in cookie
    session = cookie.partition(';')[0]
    assert page.request(Cookie=session)[0] == 200
    assert page.ask({'planner': '/planner', 'kind': 'disable'}, Cookie=session)[0] == 200
    assert page.request(Cookie=session[:-1])[0] == 401


@with_token
def test_the_form_takes_the_token_and_a_wrong_one_waits(page):
    def login(token, **headers):
        return page.request('/login', urlencode({'token': token}).encode(), follow=False,
                            **{'Origin': f'http://{page.host}', **headers})
    assert login(TOKEN)[0] == 303
    assert login(TOKEN, Origin='http://evil.example')[0] == 403
    before_s = time.monotonic()
    status, _, text = login(TOKEN[:-1] + 'x')
    assert status == 401 and 'not the token' in text and time.monotonic() - before_s >= 1.0


async def _open(page, **headers):
    connection = await page.connect(**headers)
    connection.close()


async def _next(connection, key):
    """Return the next message with a key."""
    while True:
        text = await asyncio.wait_for(connection.read_message(), LIMIT_S)
        assert text is not None
        if key in (values := json.loads(text)):
            return values


def test_a_tab_gets_the_list_and_the_planner_that_it_chooses(page):
    async def follow():
        connection = await page.connect()
        names = [each['name'] for each in (await _next(connection, 'planners'))['planners']]
        assert names == ['/car/planner', '/planner']
        await connection.write_message(json.dumps({'planner': '/car/planner'}))
        assert (await _next(connection, 'view'))['view']['routeId'] == '<b>two</b>'
        await connection.write_message(json.dumps({'planner': '/planner'}))
        first = await _next(connection, 'history')
        assert first['planner'] == '/planner' and first['history']['measured'] == [-7.0]
        with page.source.lock:
            page.source.boards['/planner'].see_battery(START_S + 1.0, -6.5, 0.9, 101.0)
        assert (await _next(connection, 'history'))['history']['measured'] == [-6.5]
        connection.close()
    asyncio.run(follow())


@pytest.mark.parametrize('headers', [{'Origin': 'http://evil.example'}, {'Host': 'evil.example'}])
def test_a_websocket_from_another_page_is_refused(page, headers):
    with pytest.raises(Exception, match='403|421'):
        asyncio.run(_open(page, **headers))
    assert page.server.tabs == 0


@pytest.mark.parametrize('text', ['', 'x', '[]', '{}', 'null', '[' * 500])
def test_a_tab_that_talks_nonsense_is_closed(page, text):
    async def talk():
        connection = await page.connect()
        await connection.write_message(text)
        while await asyncio.wait_for(connection.read_message(), LIMIT_S) is not None:
            pass
    asyncio.run(talk())


def test_only_so_many_tabs(page):
    async def crowd():
        connections = [await page.connect() for _ in range(server.MOST_TABS)]
        with pytest.raises(Exception, match='503'):
            await page.connect()
        # The others go on.
        await connections[0].write_message(json.dumps({'planner': '/planner'}))
        await _next(connections[0], 'view')
        for connection in connections:
            connection.close()
    asyncio.run(crowd())
    poll_until(lambda: page.server.tabs == 0, 'no tab')


def test_a_tab_that_never_reads_is_closed_and_delays_no_other(page, monkeypatch):
    monkeypatch.setattr(server, 'TAB_CLOSED_AFTER_S', 0.5)
    monkeypatch.setattr(server, 'EVENT_PERIOD_S', 0.02)
    times = tuple(START_S + second for second in range(240))
    big = a_plan(times_s=times, temperatures_c=(1.0,) * 240, socs=(0.5,) * 240, powers_w=(0.0,) * 239,
                 explanation='x' * 2000)
    with closing(_raw_tab(page)) as silent:
        _send_text(silent, json.dumps({'planner': '/planner'}))

        async def follow():
            connection = await page.connect()
            await connection.write_message(json.dumps({'planner': '/planner'}))
            await _next(connection, 'view')
            assert page.server.tabs == 2
            end_s, seen = time.monotonic() + LIMIT_S, 0
            at_s = START_S
            while page.server.tabs > 1 and time.monotonic() < end_s:
                # A history that is whole again fills the buffers of the silent tab quickly.
                with page.source.lock:
                    board = page.source.boards['/planner']
                    board.forget()
                    for _ in range(2000):
                        at_s += 1.0
                        board.see_battery(at_s, 1.234567, 0.56789, at_s)
                    board.see_plan(big, at_s)
                await _next(connection, 'view')
                seen += 1
            connection.close()
            return seen
        assert asyncio.run(follow()) > 3
        poll_until(lambda: page.server.tabs == 0, 'no tab')


@pytest.mark.parametrize('address', ['127.0.0.1', '0.0.0.0'])
def test_the_address_that_is_logged_opens(address):
    made = PageServer(Access(address, TOKEN), 0, LiveSource(), print)
    made.start()
    try:
        assert (urlsplit(made.url).hostname == '127.0.0.1') == (address == '127.0.0.1')
        assert urlsplit(made.url).hostname != '0.0.0.0'
        opener = build_opener(HTTPCookieProcessor())
        with opener.open(f'{made.url}?token={TOKEN}', timeout=LIMIT_S) as answer:
            assert answer.status == 200 and 'figure-battery' in answer.read().decode()
    finally:
        made.stop()


def test_without_a_network_the_address_is_this_computers_name(monkeypatch):
    assert server.own_address('::') != '::'
    # The kernel refuses to connect to it.
    monkeypatch.setitem(server.ELSEWHERE, 4, (socket.AF_INET, '255.255.255.255'))
    assert server.own_address('0.0.0.0') == socket.gethostname()
    assert server.own_address('192.168.1.7') == '192.168.1.7'


def _raw_tab(page):
    """Return a socket with small buffers that has become a WebSocket and is not read."""
    raw = socket.socket()
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    raw.settimeout(LIMIT_S)
    raw.connect(('127.0.0.1', page.server.port))
    raw.sendall((f'GET /tab HTTP/1.1\r\nHost: {page.host}\r\nOrigin: http://{page.host}\r\nUpgrade: websocket\r\n'
                 'Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
                 'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n').encode())
    assert raw.recv(12) == b'HTTP/1.1 101'
    return raw


def _send_text(raw, text):
    """Send a short masked text frame; the mask is 0."""
    raw.sendall(struct.pack('!BB4x', 0x81, 0x80 | len(text)) + text.encode())
