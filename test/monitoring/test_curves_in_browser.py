# SPDX-License-Identifier: Apache-2.0
"""The curves of the live page in Chromium: a power that changes rarely is shown from the left edge on."""

from contextlib import ExitStack

from browser import browser
import pytest
from seen_examples import a_board, a_plan, START_S

from bev_preheat.monitoring.access import Access
from bev_preheat.monitoring.server import PageServer
from bev_preheat.monitoring.source import LiveSource
from bev_preheat.planning.status import Status

pytestmark = [pytest.mark.needs('selenium'), pytest.mark.needs('chromium'), pytest.mark.needs('chromedriver'),
              pytest.mark.needs('tornado')]
# The page shows the last hours, and a trip from a little before its start on.
WAITED_S = 5 * 3600


def test_a_command_from_before_the_window_holds_until_it_changes(tmp_path):
    board = a_board()
    now_s = START_S + WAITED_S
    board.see_battery(now_s - 600.0, -7.0, 0.9, 100.0)
    board.see_command(now_s, 3000.0, int(Status.HEATING), 100.0)
    board.see_battery(now_s, -7.0, 0.9, 100.0)
    board.see_plan(a_plan(now_s, times_s=(now_s, now_s + 600.0), temperatures_c=(-7.0, 0.0), socs=(0.9, 0.8),
                          powers_w=(3000.0,), heating_start_s=now_s, arrival_s=now_s + 600.0), 100.0)
    source = LiveSource()
    source.boards = {'/planner': board}
    server = PageServer(Access('127.0.0.1'), 0, source, print)
    server.start()
    with ExitStack() as stack:
        stack.callback(server.stop)
        page = stack.enter_context(browser(tmp_path))
        page.open(server.url)
        page.wait(lambda: page.run('return document.querySelectorAll(".bev-legend").length') == 3, 'the curves')
        page.run('document.querySelector(".bev-curves").focus()')
        page.press('HOME')
        page.wait(lambda: 'commanded 0.0 kW' in page.page_text(), 'the command at the left edge', 10.0)
        # The curves begin with the first battery state.
        assert 'measured -7.0 °C' in page.page_text()
