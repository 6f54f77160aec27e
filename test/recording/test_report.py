# SPDX-License-Identifier: Apache-2.0
"""The report is one page that works offline: its figures are those of the drive, and a browser draws them."""

from array import array
import base64
import html
import json
import math
import re
import subprocess
import sys

from left_out import program
import pytest
from recorded_drive import LENGTH_S, record_drive, TARGET_C

from bev_preheat.commands.main import main
from bev_preheat.monitoring.pages import report_text, ReportText
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.history import History
from bev_preheat.recording.replay import Played, Player
from bev_preheat.simulation.supervised_drive import START_NS

pytestmark = [pytest.mark.needs('mcap', 'rclpy', 'jinja2'), pytest.mark.costly]
QUIET = ('--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
         '--disable-background-networking', '--disable-component-update', '--disable-sync')


def numbers(text, kind='f'):
    """Return the numbers of base64 of little-endian floats."""
    values = array(kind, base64.b64decode(text))
    if sys.byteorder == 'big':
        values.byteswap()
    return values.tolist()


def contents_of(page):
    [data] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    return json.loads(data)


@pytest.fixture(scope='module')
def page(recorded, tmp_path_factory):
    """Return the recorded drive, and the path of a report on it that asks what if."""
    path = tmp_path_factory.mktemp('report') / 'drive.html'
    assert main(['replay', str(recorded[1]), '--set', 'estimation=false', '--report', str(path)]) == 0
    return recorded[0], path


def test_columns_are_those_of_the_drive(page):
    outputs, path = page
    contents = contents_of(path.read_text(encoding='utf-8'))
    assert contents['courses'] == ['recorded', 'changed']
    columns = contents['recorded']['columns']
    time_s = numbers(contents['recorded']['time'], 'd')
    assert time_s == sorted(time_s) and time_s[0] * NS_PER_S == START_NS
    commands_w = {now_ns: output.command.battery_heating_power_w for now_ns, output in outputs}
    for now_s, power_w in zip(time_s, numbers(columns['commanded'])):
        # The last step of an instant may come after the row; power changes seldom.
        assert commands_w[round(now_s * NS_PER_S)] == pytest.approx(power_w, abs=1.0) or power_w in (0.0, 5022.0)
    statuses = [change[1] for change in contents['recorded']['sentences']]
    assert 'HEATING' in statuses and statuses[-1] == 'ARRIVED'
    _, label, start_s, times_s, temperatures_c, *_ = contents['recorded']['plans'][0]
    assert label.startswith('HEATING: heating now') and start_s == START_NS / NS_PER_S
    # A plan leads from the battery as it is to its target at the end of the route.
    assert numbers(times_s)[-1] == LENGTH_S and numbers(temperatures_c)[-1] == pytest.approx(TARGET_C, abs=1.0)


def test_the_power_of_each_of_several_heat_sources_adds_up_to_the_command(page, tmp_path):
    record_drive(tmp_path, 16.0, 120, vehicle='heat_pump_car', most_c=18.0)
    path = tmp_path / 'drive.html'
    assert main(['replay', str(tmp_path), '--report', str(path)]) == 0
    text = path.read_text(encoding='utf-8')
    recorded = contents_of(text)['recorded']
    sources = {name: numbers(powers_w) for name, powers_w in recorded['sources'].items()}
    assert list(sources) == ['hvch', 'motor', 'heat_pump', 'chiller']
    together_w = [sum(powers_w) for powers_w in zip(*sources.values(), strict=True)]
    assert together_w == pytest.approx(numbers(recorded['columns']['commanded']), abs=0.1)
    assert max(sources['heat_pump']) == 2500.0 and max(sources['motor']) > 0.0 and not any(sources['chiller'])
    assert '<td>heat_pump commanded [Wh]</td>' in text
    # The sources heat together: 3 kW by the motor, 4.5 kW by the HVCH and some 5 kW by the heat pump.
    columns = recorded['columns']
    warmer_k = [measured_c - unheated_c for measured_c, unheated_c in zip(
        numbers(columns['measured']), numbers(columns['unheated'])) if not math.isnan(unheated_c)]
    efficiency, capacity_j_per_k = 0.9, 380e3
    heat_per_w = {'hvch': efficiency, 'motor': 0.75, 'heat_pump': 2.0, 'chiller': 0.0}
    expected_k = sum(heat_per_w[name] * sum(powers_w) for name, powers_w in sources.items()) / capacity_j_per_k
    assert warmer_k[-1] == pytest.approx(expected_k, abs=0.6) and expected_k > 3.0
    assert numbers(columns['most']) == pytest.approx([2.0 + target_c for target_c in numbers(
        columns['target'])], nan_ok=True) and 18.0 in numbers(columns['most'])
    plain = contents_of(page[1].read_text(encoding='utf-8'))['recorded']
    assert plain['sources'] == {} and all(map(math.isnan, numbers(plain['columns']['most'])))


def test_without_heating_it_would_be_colder_once_it_has_heated(page):
    columns = contents_of(page[1].read_text(encoding='utf-8'))['recorded']['columns']
    # It is known from the first plan to the last one.
    gaps_k = [measured_c - unheated_c for measured_c, unheated_c in zip(
        numbers(columns['measured']), numbers(columns['unheated'])) if not math.isnan(unheated_c)]
    assert abs(gaps_k[0]) < 0.5 and gaps_k[-1] > 1.0 and len(gaps_k) > 0.9 * LENGTH_S


def test_spans_without_a_valid_command_are_shaded(page):
    text = ReportText('drive', (), None, ('recorded',), (), (), (), ((1.0, 2.5),))
    assert contents_of(report_text(text, History(NS_PER_S)))['lapses'] == [[1.0, 2.5]]
    assert contents_of(page[1].read_text(encoding='utf-8'))['lapses'] == []


def test_the_page_needs_no_network_and_escapes_what_recordings_say():
    evil = '</script><script>alert(1)</script><b>'
    history = History(NS_PER_S)
    page = report_text(ReportText(evil, (evil,), None, ('recorded',), ((evil, evil),), (evil,), ((evil, evil),)),
                       history)
    assert '<b>' not in page and 'alert(1)</script>' not in page
    assert html.escape(evil) in page
    # The address in a comment of uPlot, and the names of namespaces, are not fetched.
    assert not re.search(r'(src|href)\s*=|@import|url\(', page)


@pytest.mark.needs('chromium')
def test_a_browser_draws_it(page, tmp_path):
    dom = subprocess.run(
        [program('chromium'), *QUIET, f'--user-data-dir={tmp_path}', '--virtual-time-budget=2000', '--dump-dom',
         page[1].as_uri()], capture_output=True, text=True, timeout=120).stdout
    # Temperature, heater, charge, power, regime.
    assert dom.count('<canvas') == 5
    for words in ('measured, changed', 'predicted on arrival', 'HEATING: heating now'):
        assert words in dom
    # Rows of the tables are made by the page's script.
    assert re.search(r'<td>ARRIVED</td>', dom) and '>2 of 2<' not in dom
    assert 'Click into the curves' in dom


def test_a_clock_that_jumps_is_drawn_as_one_drive(recorded):
    """Back by ten seconds, on by ten years, and again right."""
    history, flight = History(NS_PER_S), read_flight(recorded[1])
    player = Player(flight)
    for index, given in enumerate(flight.given[:80]):
        off_s = -10 if 20 <= index < 30 else 315360000 if 40 <= index < 50 else 0
        played = player.play(given)
        history.add(Played(played.now_ns + off_s * NS_PER_S, played.output, played.state))
    time_s = list(history.columns['time'])
    assert history.jumps == 2 and time_s == sorted(time_s)
    # Two steps a second, and a row for each second.
    assert time_s[-1] - time_s[0] == (flight.given[79].step.now_ns - START_NS) / NS_PER_S
    assert max(after - before for before, after in zip(time_s, time_s[1:])) <= 2.0
