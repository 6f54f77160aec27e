# SPDX-License-Identifier: Apache-2.0
"""The token goes through the page's own form in Chromium, as on a phone; forms of other origins are refused."""

from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import secrets
from threading import Thread

from browser import browser, PHONE
import pytest
from seen_examples import a_board

from bev_preheat.monitoring.access import Access
from bev_preheat.monitoring.server import PageServer
from bev_preheat.monitoring.source import LiveSource

pytestmark = [pytest.mark.needs('selenium', 'chromium', 'chromedriver', 'tornado')]
TOKEN = secrets.token_urlsafe(24)


@pytest.fixture(scope='module')
def server():
    """Give a PageServer for other devices, with one planner."""
    source = LiveSource()
    source.boards = {'/planner': a_board()}
    made = PageServer(Access('0.0.0.0', TOKEN), 0, source, print)
    made.start()
    yield made
    made.stop()


@pytest.fixture(scope='module')
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp('profile')) as made:
        yield made


@pytest.fixture
def phone(chromium, server):
    """Give a browser of a phone's size without cookies, at the form; the car has a name of its network."""
    chromium.size(*PHONE)
    chromium.forget_cookies()
    chromium.open(f'http://car.test:{server.port}/')
    assert chromium.is_visible('token') and chromium.overflow_px() <= 0
    return chromium


def test_the_form_takes_the_token_and_the_page_goes_live(phone):
    phone.type('token', TOKEN[:-1])
    phone.press('ENTER')
    phone.wait(lambda: 'This is not the token.' in phone.page_text(), 'that a wrong token is refused', 20.0)
    phone.type('token', TOKEN)
    phone.press('ENTER')
    # Values come over the WebSocket, which needs cookie and origin too.
    phone.wait(lambda: not phone.is_visible('token') and phone.text('status') == 'Waiting to heat', 'the page')
    assert TOKEN not in phone.run('return document.URL')


class _Foreign(BaseHTTPRequestHandler):
    """A page of another site that sends its form with the right token at once."""

    def __init__(self, target, *arguments):
        self._target = target
        super().__init__(*arguments)

    def do_GET(self):
        self.send_response(200)
        self.send_header('Content-Type', 'text/html')
        if self.path == '/sandboxed':
            self.send_header('Content-Security-Policy', 'sandbox allow-forms allow-scripts')
        self.end_headers()
        self.wfile.write(f'<form method="post" action="{self._target}/login"><input name="token" value="{TOKEN}">'
                         '</form><script>document.forms[0].submit()</script>'.encode())

    def log_message(self, *arguments):
        pass


@pytest.mark.parametrize('address', ['http://evil.test:{port}/', 'http://car.test:{port}/',
                                     'http://evil.test:{port}/sandboxed', 'http://car.test:{port}/sandboxed'])
def test_a_form_of_another_origin_is_refused_even_with_the_token(phone, server, address):
    with ThreadingHTTPServer(('127.0.0.1', 0), partial(_Foreign, f'http://car.test:{server.port}')) as foreign:
        Thread(target=foreign.serve_forever, daemon=True).start()
        phone.open(address.format(port=foreign.server_address[1]))
        phone.wait(lambda: 'Not from this page' in phone.page_text(), 'that it is refused', 20.0)
        foreign.shutdown()
    phone.open(f'http://car.test:{server.port}/')
    assert phone.is_visible('token')
