# SPDX-License-Identifier: Apache-2.0
"""
The page of `dashboard` in Chromium, beside the installed planner and the simulated vehicle.

With BEV_PREHEAT_PICTURES=docs/pictures these tests write the pictures of the documentation.
"""

import os
import signal
import time

from browser import browser, DESKTOP, PHONE, PICTURES
from planner_car import set_parameters
import pytest
from sensor_msgs.msg import BatteryState
from test_dashboard import page_of

from bev_preheat_msgs.msg import PreheatPlan

pytestmark = [pytest.mark.needs('selenium', 'chromium', 'chromedriver', 'tornado')]
# 1 s of simulated time is 10 ms here: the lease lasts longer than usual.
PLANNER = ('-p', 'use_sim_time:=true', '-p', 'command_lease:=20.0', '-p', 'command_period:=5.0',
           '-p', 'battery_state_timeout:=60.0', '-p', 'clock_tolerance:=10.0')
SIMULATOR = ('-p', 'wait_for_planner:=true', '-p', 'charger_power:=150000.0', '-p', 'minimum_arrival_soc:=0.2',
             '-p', 'start_time:=1700000000.0', '-p', 'battery_state_period:=2.0',
             '-p', 'heater_status:=true')
# A quarter of an hour that leaves time to wait, and the hour of the pictures.
START_C, START_SOC = 14.0, 0.5
QUARTER = ('-p', f'initial_battery_temperature:={START_C}', '-p', f'initial_soc:={START_SOC}')
HOUR = ('-p', 'initial_soc:=0.75')
FIGURES = ('temperature', 'predicted', 'soc', 'saved')
# Resident memory of the process [MB] and of the page's scripts [MB] after the first drive may grow by so much.
MOST_GROWTH_MB, MOST_HEAP_GROWTH_MB = 12.0, 8.0
ROUTE = """duration_s,speed_mps,propulsion_power_w,propulsion_power_rms_w,ambient_temperature_c
300,14,12000,16000,-7
300,25,24000,27000,-7
300,20,18000,20000,-7
"""


# Visible controls and regions that a screen reader has no name for.
UNNAMED = """
    return [...document.querySelectorAll('button, select, input, [role=group], section')].filter((e) =>
      e.offsetParent !== null && !(e.innerText || '').trim() && !e.getAttribute('aria-label')
      && !e.getAttribute('aria-labelledby') && !(e.labels && e.labels.length)).map((e) => e.outerHTML)"""


# Legends that are wider than their place, or higher than a line.
CUT_LEGENDS = """
    return [...document.querySelectorAll('.bev-legend')].filter((e) => e.scrollWidth > e.clientWidth
      || new Set([...e.children].map((each) => each.offsetTop)).size > 1).map((e) => e.innerText)"""


@pytest.fixture(scope='module')
def chromium(tmp_path_factory):
    """Give a Browser; its console must have stayed silent."""
    with browser(tmp_path_factory.mktemp('profile')) as made:
        yield made


@pytest.fixture
def page(chromium):
    """Give the Browser to a test; fail if its console has a message that the test has not taken."""
    chromium.new_messages()
    yield chromium
    assert chromium.new_messages() == []
    chromium.open('about:blank')


def rss_mb(process):
    with open(f'/proc/{process.pid}/statm', encoding='ascii') as file:
        return int(file.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 2**20


def number_of(text):
    return float('nan' if text == '–' else text.replace('\u2212', '-'))


def ask(page, button, answer, prepare=lambda: None):
    """Press a button, confirm, wait for an answer with a text, close the dialog."""
    page.wait(lambda: page.is_visible(button), f'the button {button}')
    page.click(button)
    assert page.is_visible('dialog') and not page.is_visible('dialog-answer')
    prepare()
    page.click('dialog-ask')
    page.wait(lambda: answer in page.text('dialog-answer'), f'the answer {answer!r}')
    page.click('dialog-close')
    assert not page.is_visible('dialog')


# A minute; daily a browser logs in (test_login_in_browser.py) and draws curves (test_curves_in_browser.py).
@pytest.mark.deep
def test_it_shows_a_drive_asks_back_and_survives_a_planner_that_dies(bench, page, tmp_path):
    dashboard = bench.start('dashboard', '-p', 'port:=0', '-p', 'controls:=true')
    page.open(f'http://{page_of(dashboard)}/')
    page.wait(lambda: page.text('status') == 'No planner', 'that there is no planner')
    plans, states = bench.record(PreheatPlan, 'preheat_plan', 1), bench.record(BatteryState, 'battery_state', 1)
    planner = bench.start('planner', *PLANNER)
    route = tmp_path / 'quarter.csv'
    route.write_text(ROUTE)
    car = (*SIMULATOR, *HOUR) if PICTURES else (*SIMULATOR, *QUARTER, '-p', f'route:={route}')
    start_c = -7.0 if PICTURES else START_C
    simulator = bench.start('vehicle_simulator', *car, '-p', 'speed_up:=1.0')
    page.wait(lambda: page.text('status') == 'Waiting to heat' and '–' not in page.texts(*FIGURES), 'a plan')
    # At once: on a busy computer heating begins soon.
    assert page.text('title-time') == 'Heating starts in' and page.text('power') == '0.0'
    plans.wait_for()
    states.wait_for()
    # Read one after the other, the page and the latest messages may be a state apart.
    [now_c, arrival_c, soc, saved], battery, plan = (
        list(map(number_of, page.texts(*FIGURES))), states.latest, plans.latest)
    assert now_c == pytest.approx(battery.temperature, abs=0.3)
    assert soc == pytest.approx(100.0 * battery.percentage, abs=1.5)
    assert arrival_c == pytest.approx(plan.predicted_arrival_temperature, abs=0.3) and arrival_c > now_c + 2.0
    assert saved > 0.1 and saved == pytest.approx(
        (plan.charging_time_unheated - plan.charging_time) / 60.0, abs=0.2)
    # It comes with the route, the rest with the plan.
    page.wait(lambda: 'reserve 20' in page.text('note-charge').replace('\N{NO-BREAK SPACE}', ' '), 'the reserve')
    page.wait(lambda: page.run('return document.querySelectorAll("#curves canvas").length') == 3, 'the curves')
    set_speed(bench, 100.0)
    page.wait(lambda: page.text('status') == 'Heating', 'that it heats')
    set_speed(bench, 1.0)
    page.wait(lambda: number_of(page.text('power')) > 1.0, 'the power')
    page.picture('dashboard.png', 1180, 900)
    page.picture('dashboard_phone.png', *PHONE)
    assert_fits_and_is_labelled(page)
    assert_legends_fit(page)
    set_speed(bench, 100.0)
    page.wait(lambda: page.text('status') in ('Arrived', 'Charging'), 'the arrival')
    simulator.end()
    # The planner reports on a goal every command_period.
    bench.start('vehicle_simulator', *car, '-p', 'speed_up:=5.0')
    # Time jumps back: another drive.
    page.wait(lambda: page.text('status') == 'Waiting to heat'
              and number_of(page.text('temperature')) < start_c + 1.0, 'the next drive')
    assert_answers_are_shown(page)
    planner.send_signal(signal.SIGKILL)
    page.wait(lambda: page.is_visible('banner'), 'a banner')
    assert 'late' in page.run('return document.getElementById("figure-heater").className')
    bench.start('planner', *PLANNER)
    page.wait(lambda: not page.is_visible('banner') and page.text('link-text') == 'live', 'that it is back')
    assert_a_dead_server_is_shown(page, dashboard)


def set_speed(bench, speed_up):
    assert set_parameters(bench, 'vehicle_simulator', speed_up=speed_up).successful


def assert_answers_are_shown(page):
    ask(page, 'do-disable', 'Accepted: Preheating is switched off.')
    page.wait(lambda: page.text('status') == 'Switched off', 'that it is off')
    ask(page, 'do-prepare', 'Not done: The goal was refused: Preheating is switched off',
        lambda: page.type('minutes', '30'))
    ask(page, 'do-enable', 'Accepted: Preheating is switched on.')
    page.wait(lambda: page.is_visible('do-disable'), 'the other button')

    def by_keyboard():
        # The field of the minutes has the focus; Enter asks.
        page.press('BACKSPACE', 'BACKSPACE', '4', '5', 'TAB', '3', '0', 'ENTER')
        page.wait(lambda: page.text('dialog-answer').startswith('Accepted'), 'the answer')
    page.click('do-prepare')
    by_keyboard()
    assert 'target 30.0' in page.text('dialog-answer').replace('\N{NO-BREAK SPACE}', ' ')
    page.press('ESCAPE')
    assert not page.is_visible('dialog')
    ask(page, 'do-cancel', 'Accepted: The preparation is cancelled.')
    page.wait(lambda: not page.is_visible('do-cancel'), 'that it is gone')


def assert_legends_fit(page):
    """On a phone each legend of the curves is one line, complete."""
    page.size(*PHONE)
    page.wait(lambda: page.run(CUT_LEGENDS) == [], 'that the legends fit', 10.0)
    page.size(*DESKTOP)


def assert_fits_and_is_labelled(page):
    """No horizontal scrolling at any usual width, in both schemes; each control has a name."""
    for width in (320, 390, 768, 1180, 1920):
        for dark in (False, True):
            page.size(width, 800, dark)
            page.wait(lambda: page.overflow_px() <= 0, f'that it fits into {width} px', 10.0)
    page.size(*DESKTOP)
    unnamed = page.run(UNNAMED)
    assert unnamed == []
    assert page.run('return document.getElementById("banner").getAttribute("role")') == 'alert'
    assert page.run('return document.documentElement.lang') == 'en'
    # A status that changes is spoken with its sentence.
    assert page.run('return document.getElementById("spoken").textContent').startswith('Heating. ')


def assert_a_dead_server_is_shown(page, dashboard):
    dashboard.end()
    page.wait(lambda: 'dashboard does not answer' in page.text('banner'), 'that the dashboard is gone')
    # The browser reports that it cannot connect; nothing else.
    assert all('WebSocket connection' in message or 'ERR_CONNECTION' in message for message in page.new_messages())
    page.open('about:blank')


@pytest.mark.deep
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('length_s', [36.0, 900.0])
def test_drive_after_drive_at_a_hundred_times_nothing_grows(bench, page, length_s):
    """Each drive of an hour lasts 36 s, and is followed by another one."""
    dashboard = bench.start('dashboard', '-p', 'port:=0')
    bench.start('planner', *PLANNER)
    page.open(f'http://{page_of(dashboard)}/')
    end_s, begun_s = time.monotonic() + length_s + 15.0, time.monotonic()
    before = None
    while time.monotonic() < end_s:
        simulator = bench.start('vehicle_simulator', *SIMULATOR, '-p', 'speed_up:=100.0', '-p',
                                'exit_on_arrival:=true')
        while simulator.exit_status is None and time.monotonic() < end_s:
            time.sleep(0.5)
            # After the first plans all parts of the page are there.
            if before is None and time.monotonic() - begun_s > 15.0 and page.text('predicted') != '–':
                before = rss_mb(dashboard), page.heap_mb()
        simulator.end()
    assert before is not None
    page.wait(lambda: page.is_visible('sentence'), 'the page')
    grown = rss_mb(dashboard) - before[0], page.heap_mb() - before[1]
    print(f'grown in {length_s:g} s: process {grown[0]:.1f} MB, page {grown[1]:.1f} MB; from '
          f'{before[0]:.1f}, {before[1]:.1f} MB')
    assert grown[0] < MOST_GROWTH_MB and grown[1] < MOST_HEAP_GROWTH_MB
