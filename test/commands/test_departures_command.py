# SPDX-License-Identifier: Apache-2.0
"""
`preheat prepare --departures`: a week without a planner, as table, JSON and picture, and its refusals.

With --skip-next and --skip-none: what the planner is asked, and what its answers become. Over DDS:
test_planner_departures.py.
"""

from contextlib import contextmanager
from datetime import datetime
import json
from types import SimpleNamespace
from zoneinfo import ZoneInfo

import pytest
from rclpy.task import Future
from std_srvs.srv import SetBool

from bev_preheat.commands.main import main
from bev_preheat.console.program import FAILED
from bev_preheat.monitoring import departure_skip

WEEK = """
time_zone: Europe/Berlin
ambient_temperature_c: -5
departures:
- {name: work, weekdays: [friday], time: '07:30', plugged_in: true}
- {name: sports, weekdays: [saturday], time: '10:00', target_battery_temperature_c: 20, plugged_in: false}
"""
PRICES = """
time_zone: Europe/Berlin
currency: EUR
daily:
- {from: '22:00', price_per_kwh: 0.18}
- {from: '06:00', price_per_kwh: 0.34}
"""


@pytest.fixture
def prepare(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '200')
    (tmp_path / 'week.yaml').write_text(WEEK)
    (tmp_path / 'tariff.yaml').write_text(PRICES)
    return lambda *arguments: main(['prepare', *arguments])


OFFLINE = ('--departures', 'week.yaml', '--vehicle', 'small_car', '--from', '2026-11-26 12:00')


def test_costs_are_the_heating_times_at_the_tariff(prepare, tmp_path, capfd):
    assert prepare(*OFFLINE, '--prices', 'tariff.yaml', '--json', 'week.json') == 0
    result = json.loads((tmp_path / 'week.json').read_text())
    work, sports = result['departures']
    zone = ZoneInfo('Europe/Berlin')
    assert work['departure_s'] == datetime(2026, 11, 27, 7, 30, tzinfo=zone).timestamp()
    assert sports['departure_s'] == datetime(2026, 11, 28, 10, 0, tzinfo=zone).timestamp()
    assert work['temperature_c'] == pytest.approx(work['target_c'], abs=0.01)
    # Full power throughout, so energy is shared by time between the prices.
    dear_s = datetime(2026, 11, 27, 6, 0, tzinfo=zone).timestamp()
    heated_s = sum(end - begin for begin, end in work['heating_s'])
    cheap_s = sum(max(0.0, min(end, dear_s) - begin) for begin, end in work['heating_s'])
    mean_price = (0.18 * cheap_s + 0.34 * (heated_s - cheap_s)) / heated_s
    assert work['cost'] == pytest.approx(work['hvch_electric_wh'] / 1000.0 * mean_price, rel=0.02)
    assert work['cost'] < work['latest_cost']
    assert sports['cost'] is None


def test_the_week_is_drawn(prepare, tmp_path):
    assert prepare(*OFFLINE, '--prices', 'tariff.yaml', '--plot', 'week.svg') == 0
    labels = (tmp_path / 'week.svg').read_text()
    assert all(f'<!-- {label} -->' in labels for label in ('2026-11-27', 'heater [kW]', 'price [EUR/kWh]'))


@pytest.mark.parametrize('arguments, problem', [
    (('--prices', 'tariff.yaml'), '--prices: is for --departures only'),
    (('--from', '2026-11-26 12:00'), '--from: is for --departures only'),
    ((*OFFLINE, '--skip-next'), '--skip-next: is not allowed with --departures'),
    ((*OFFLINE, '--in', '40'), '--in: is not allowed with --departures'),
    ((*OFFLINE[:-1], '26.11.2026'), '--from: '),
    ((*OFFLINE, '--ambient', 'nan'), '--ambient: nan degC is not allowed'),
    (('--departures', 'missing.yaml'), 'missing.yaml'),
    ((*OFFLINE, '--json', 'week.yaml'), 'week.yaml'),
])
def test_arguments_that_cannot_be_used_are_named(prepare, tmp_path, arguments, problem, capfd):
    assert prepare(*arguments) == 2
    assert problem in capfd.readouterr().err
    assert (tmp_path / 'week.yaml').read_text() == WEEK


class Planner:
    """In place of a Listener and its node: a planner whose service comes and answers as time passes."""

    def __init__(self, there_after_s, answer_after_s, response):
        self._there_s, self._answer_s, self._response = there_after_s, there_after_s + answer_after_s, response
        self.now_s, self.asked, self.node = 0.0, [], self

    def create_client(self, service_type, name):
        assert service_type is SetBool
        self.service = name
        return SimpleNamespace(service_is_ready=lambda: self.now_s >= self._there_s, call_async=self._ask)

    def _ask(self, request):
        self.asked.append(request.data)
        self._answer = Future()
        return self._answer

    def monotonic(self):
        return self.now_s

    def listen(self, duration_s):
        self.now_s += duration_s
        if self.asked and self.now_s >= self._answer_s and not self._answer.done():
            self._answer.set_result(self._response)


@pytest.fixture
def skip(monkeypatch, capfd):
    """`skip(planner, *arguments)` runs the command with a Planner: its exit status, output and errors."""
    def skip(planner, *arguments):
        @contextmanager
        def listening(name, namespace):
            planner.namespace = namespace
            yield planner

        monkeypatch.setattr('bev_preheat.nodes.listening.listening', listening)
        monkeypatch.setattr(departure_skip, 'time', planner)
        monkeypatch.setenv('COLUMNS', '200')
        return main(['prepare', *arguments]), *capfd.readouterr()

    return skip


@pytest.mark.parametrize('option, is_skipped', [('--skip-next', True), ('--skip-none', False)])
def test_the_planner_is_asked_once_and_its_sentence_is_printed(skip, option, is_skipped):
    planner = Planner(0.5, 0.5, SetBool.Response(success=True, message='Skipped: work.'))
    assert skip(planner, option, '--namespace', '/car') == (0, 'Skipped: work.\n', '')
    assert (planner.service, planner.asked) == ('/car/planner/skip_departure', [is_skipped])


def test_a_skip_that_is_not_done_fails_with_the_planners_sentence(skip):
    planner = Planner(0.0, 0.0, SetBool.Response(success=False, message='There is no departure to skip.'))
    assert skip(planner, '--skip-next') == (FAILED, 'There is no departure to skip.\n', '')


def test_a_planner_that_is_not_there_gets_no_request(skip):
    planner = Planner(1e9, 0.0, None)
    status, _, errors = skip(planner, '--skip-next')
    assert (status, planner.asked) == (2, [])
    assert 'no planner answers as /planner: is it running' in errors
    assert planner.now_s < 60.0


def test_a_planner_that_does_not_answer_gets_no_second_request(skip):
    # It would skip another departure.
    planner = Planner(0.0, 1e9, None)
    status, _, errors = skip(planner, '--skip-next')
    assert (status, planner.asked) == (2, [True])
    assert '/planner has not answered' in errors
    assert planner.now_s < 60.0
