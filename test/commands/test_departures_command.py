# SPDX-License-Identifier: Apache-2.0
"""`preheat prepare --departures`: a week without a planner, as table, JSON and picture, and its refusals."""

from datetime import datetime
import json
import re
from zoneinfo import ZoneInfo

import pytest

from bev_preheat.files.input_files import configuration_folder

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


@pytest.fixture(autouse=True)
def files(tmp_path):
    (tmp_path / 'week.yaml').write_text(WEEK)
    (tmp_path / 'tariff.yaml').write_text(PRICES)


OFFLINE = ('prepare', '--departures', 'week.yaml', '--vehicle', 'small_car', '--from', '2026-11-26 12:00')


def test_costs_are_the_heating_times_at_the_tariff(said, tmp_path):
    assert said(*OFFLINE, '--prices', 'tariff.yaml', '--json', 'week.json')[0] == 0
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


def test_a_departure_that_stays_cold_says_why(said, tmp_path):
    text = (configuration_folder('vehicles') / 'small_car.yaml').read_text()
    (tmp_path / 'gated.yaml').write_text(f'{text}heating_gates: {{maximum_temperature_c: 5}}\n')
    assert 'work:' not in said(*OFFLINE)[1]
    lines = said(*OFFLINE, '--vehicle', './gated.yaml')[1].splitlines()
    for name in ('work', 'sports'):
        told = [line for line in lines if line.startswith(f'{name}: ')]
        assert len(told) == 1 and told[0].endswith('The vehicle does not heat from 5 degC on.')


def test_a_warm_battery_is_cooled_to_the_highest_temperature_of_the_departure(said, tmp_path):
    (tmp_path / 'week.yaml').write_text(WEEK.replace('e_c: -5', 'e_c: 35').replace(
        'plugged_in: true', 'plugged_in: true, maximum_arrival_temperature_c: 28'))
    lines = said(*OFFLINE, '--vehicle', 'heat_pump_car', '--json', 'week.json')[1].splitlines()
    work, sports = json.loads((tmp_path / 'week.json').read_text())['departures']
    assert work['temperature_c'] == pytest.approx(28.0, abs=0.01) and work['heating_s'] == []
    assert sports['temperature_c'] > 34.0
    [told] = [line for line in lines if line.startswith('work: ')]
    assert 'cooling' in told.lower() and 'leaves at 28.0 degC' in told
    # A car that cannot cool says so.
    assert 'The battery cannot be cooled: the battery leaves at 35.0 degC, 7.0 K above' in said(*OFFLINE)[1]


def test_both_hours_of_a_clock_change_and_prices_of_other_days_are_named(said, tmp_path):
    (tmp_path / 'week.yaml').write_text(WEEK.replace('friday', 'sunday').replace('07:30', '04:30'))
    (tmp_path / 'dated.yaml').write_text("""
time_zone: Europe/Berlin
dated:
- {from: '2026-10-24T22:00+02:00', price_per_kwh: 0.40}
- {from: '2026-10-25T02:00+02:00', price_per_kwh: 0.10}
- {from: '2026-10-25T02:00+01:00', price_per_kwh: 0.50, until: '2026-10-25T06:00Z'}
""")
    # The cheap hour is the first of the two.
    for begin, told in (('2026-10-24T22:00+02:00', '-02:00 CET'),
                        ('2026-11-26 12:00', 'note: dated.yaml: has no prices for 1 of 2 preparations')):
        status, output, _ = said(*OFFLINE[:-1], begin, '--prices', 'dated.yaml')
        assert status == 0 and told in output


def test_the_week_is_drawn(said, tmp_path):
    assert said(*OFFLINE, '--prices', 'tariff.yaml', '--plot', 'week.svg')[0] == 0
    labels = (tmp_path / 'week.svg').read_text()
    assert all(f'<!-- {label} -->' in labels for label in ('2026-11-27', 'heater [kW]', 'price [EUR/kWh]'))
    # Few departures are hours apart, not days.
    assert len(set(re.findall(r'<!-- (\d\d:00) -->', labels))) > 1


@pytest.mark.parametrize('arguments, problem', [
    (('prepare', '--prices', 'tariff.yaml'), '--prices: is for --departures only'),
    (('prepare', '--from', '2026-11-26 12:00'), '--from: is for --departures only'),
    ((*OFFLINE, '--skip-next'), '--skip-next: is not allowed with --departures'),
    ((*OFFLINE, '--in', '40'), '--in: is not allowed with --departures'),
    ((*OFFLINE, '--node', 'other'), '--node: is not allowed with --departures'),
    (('prepare', '--node', ''), "--node: '' is not allowed"),
    (('prepare', '--skip-next', '--in', '40'), '--in: is not allowed with --skip-next'),
    (('prepare', '--skip-none', '--ambient', '0'), '--ambient: is not allowed with --skip-none'),
    (('prepare', '--max-arrival-temperature', 'nan'), '--max-arrival-temperature: nan is not allowed'),
    ((*OFFLINE[:-1], '26.11.2026'), '--from: '),
    ((*OFFLINE, '--ambient', 'nan'), '--ambient: nan degC is not allowed'),
    (('prepare', '--departures', 'missing.yaml'), 'missing.yaml'),
    ((*OFFLINE, '--json', 'week.yaml'), 'week.yaml'),
])
def test_arguments_that_cannot_be_used_are_named(refused, tmp_path, arguments, problem):
    assert problem in refused(*arguments)
    assert (tmp_path / 'week.yaml').read_text() == WEEK
