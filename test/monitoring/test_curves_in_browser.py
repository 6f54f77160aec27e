# SPDX-License-Identifier: Apache-2.0
"""The curves of the live page in Chromium: a power that changes rarely is shown from the left edge on."""

from contextlib import contextmanager, ExitStack

from browser import browser
import pytest
from seen_examples import a_board, a_plan, START_S

from bev_preheat.monitoring.access import Access
from bev_preheat.monitoring.server import PageServer
from bev_preheat.monitoring.source import LiveSource
from bev_preheat.planning.status import Status

pytestmark = [pytest.mark.needs('selenium', 'chromium', 'chromedriver', 'tornado')]
# The page shows the last hours, and a trip from a little before its start on.
WAITED_S = 5 * 3600


@contextmanager
def curves_of(board, folder):
    """Yield the page of a board in a browser, once its curves are there."""
    source = LiveSource()
    source.boards = {'/planner': board}
    server = PageServer(Access('127.0.0.1'), 0, source, print)
    server.start()
    with ExitStack() as stack:
        stack.callback(server.stop)
        page = stack.enter_context(browser(folder))
        page.open(server.url)
        page.wait(lambda: page.run('return document.querySelectorAll(".bev-legend").length') == 3, 'the curves')
        yield page


def test_a_command_from_before_the_window_holds_until_it_changes(tmp_path):
    board = a_board()
    now_s = START_S + WAITED_S
    board.see_battery(now_s - 600.0, -7.0, 0.9, 100.0)
    board.see_command(now_s, 3000.0, int(Status.HEATING), 100.0)
    board.see_battery(now_s, -7.0, 0.9, 100.0)
    board.see_plan(a_plan(now_s, times_s=(now_s, now_s + 600.0), temperatures_c=(-7.0, 0.0), socs=(0.9, 0.8),
                          powers_w=(3000.0,), heating_start_s=now_s, arrival_s=now_s + 600.0), 100.0)
    with curves_of(board, tmp_path) as page:
        page.run('document.querySelector(".bev-curves").focus()')
        page.press('HOME')
        page.wait(lambda: 'commanded 0.0 kW' in page.page_text(), 'the command at the left edge', 10.0)
        # The curves begin with the first battery state.
        assert 'measured -7.0 °C' in page.page_text()


def test_heat_sources_are_named_with_their_power(tmp_path):
    board = a_board(sources_w={'hvch': (0.0, 0.0), 'heat_pump': (0.0, 2000.0)}, powers_w=(0.0, 0.0))
    for second, power_w in ((0.0, 1500.0), (1.0, 1500.0), (2.0, 1000.0)):
        board.see_source(START_S + second, 'heat_pump', power_w)
        board.see_command(START_S + second, 0.0, int(Status.HEATING), 100.0)
    with curves_of(board, tmp_path) as page:
        assert page.texts('title-heater', 'power', 'note-heater') == ['Heat sources', '1.5', 'heat_pump\xa01.5']
        page.wait(lambda: 'heat_pump 0.0 kW' in page.page_text(), 'the plan of now')
        page.run('document.querySelector(".bev-curves").focus()')
        page.press('END', 'ARROW_LEFT')
        page.wait(lambda: 'heat_pump 2.0 kW' in page.page_text(), 'the last step of the plan', 10.0)
