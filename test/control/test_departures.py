# SPDX-License-Identifier: Apache-2.0
"""Recurring departures and prices by local clocks, over clock changes, and their files."""

from datetime import datetime, time, timedelta, UTC
from itertools import islice
from zoneinfo import ZoneInfo

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.control.departures import (
    DailyPrice,
    Departure,
    Departures,
    GridPrices,
    load_departures,
    load_grid_prices,
    PricePeriod,
)
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import NS_PER_S

BERLIN = ZoneInfo('Europe/Berlin')
ZONES = tuple(map(ZoneInfo, (
    'Europe/Berlin', 'America/New_York', 'Australia/Lord_Howe', 'Asia/Kathmandu', 'Pacific/Apia')))
EVERY_DAY = frozenset(range(7))
zones = st.sampled_from(ZONES)
clocks = st.times().map(lambda clock: clock.replace(second=0, microsecond=0, fold=0))
# Years with clock changes of today's rules; Samoa skipped a whole day in 2011.
moments = st.datetimes(datetime(2011, 12, 20), datetime(2030, 1, 1)).map(
    lambda moment: moment.replace(microsecond=0, fold=0))


def ns(moment, zone=UTC):
    return round(moment.replace(tzinfo=zone).timestamp()) * NS_PER_S


def shown(instant_ns, zone):
    return datetime.fromtimestamp(instant_ns / NS_PER_S, zone)


def departures_at(*clocks, zone=BERLIN, weekdays=EVERY_DAY):
    return Departures(zone, tuple(
        Departure(f'number {number}', weekdays, clock, None, False) for number, clock in enumerate(clocks)))


@given(zones, clocks, st.frozensets(st.integers(0, 6), min_size=1), moments)
@settings(max_examples=150)
def test_each_departure_is_at_its_local_time_unless_the_clock_skips_it(zone, clock, weekdays, moment):
    from_ns = ns(moment)
    found = list(islice(departures_at(clock, zone=zone, weekdays=weekdays).after(from_ns), 20))
    before_ns = from_ns
    for occurrence in found:
        assert before_ns < occurrence.instant_ns <= before_ns + 8 * 86400 * NS_PER_S + 86400 * NS_PER_S
        before_ns = occurrence.instant_ns
        local = shown(occurrence.instant_ns, zone)
        if local.time() == clock and local.weekday() in weekdays:
            # The first of two.
            assert local.fold == 0
        else:
            # Skipped: that local time, taken back to UTC and forth, is another one.
            wanted = next(day for day in (local.date(), local.date() - timedelta(days=1))
                          if day.weekday() in weekdays)
            there = datetime.combine(wanted, clock, zone)
            again = there.astimezone(UTC).astimezone(zone)
            assert again.replace(tzinfo=None) != there.replace(tzinfo=None)


@given(zones, clocks, moments)
@settings(max_examples=50)
def test_every_day_has_its_departure(zone, clock, moment):
    found = list(islice(departures_at(clock, zone=zone).after(ns(moment)), 40))
    gaps_h = np.diff([occurrence.instant_ns for occurrence in found]) / NS_PER_S / 3600.0
    # A clock change moves it by an hour at most; Samoa has no 30 December 2011.
    assert ((np.abs(gaps_h - 24.0) <= 1.0) | (zone.key == 'Pacific/Apia') & (gaps_h <= 48.0)).all()


@pytest.mark.parametrize('day, clock, utc', [
    # Skipped: read with the offset before the gap. Twice: the first. (RFC 5545, section 3.3.5.)
    ((2027, 3, 28), time(2, 30), (1, 30)), ((2026, 10, 25), time(2, 30), (0, 30)),
    ((2027, 3, 28), time(7, 30), (5, 30)), ((2026, 10, 25), time(7, 30), (6, 30))])
def test_clock_changes_follow_rfc_5545(day, clock, utc):
    midnight_ns = ns(datetime(*day), BERLIN)
    [occurrence] = departures_at(clock).until(midnight_ns, midnight_ns + 20 * 3600 * NS_PER_S)
    assert occurrence.instant_ns == ns(datetime(*day, *utc))


# Prices


price_lists = st.lists(st.tuples(clocks, st.floats(-1.0, 1.0)), max_size=5, unique_by=lambda pair: pair[0]).map(
    lambda pairs: tuple(DailyPrice(*pair) for pair in sorted(pairs)))


@given(zones, price_lists, moments, st.integers(1, 40), st.integers(0, 30), st.integers(1, 30))
@settings(max_examples=100)
def test_periods_have_no_gaps_and_each_instant_has_its_price(zone, daily, moment, hours, dated_after_h, dated_h):
    from_ns = ns(moment)
    dated = (PricePeriod(from_ns + dated_after_h * 3600 * NS_PER_S,
                         from_ns + (dated_after_h + dated_h) * 3600 * NS_PER_S, 2.0),)
    until_ns = from_ns + hours * 3600 * NS_PER_S
    periods = GridPrices(zone, daily, dated).periods(from_ns, until_ns)
    assert periods[0].from_ns == from_ns and periods[-1].until_ns == until_ns
    assert all(first.until_ns == second.from_ns for first, second in zip(periods, periods[1:]))
    for period in periods:
        assert period.from_ns < period.until_ns
        middle_ns = (period.from_ns + period.until_ns) // 2
        if dated[0].from_ns <= middle_ns < dated[0].until_ns:
            assert period.price_per_kwh == 2.0
        elif not daily:
            assert period.price_per_kwh is None
        else:
            local = shown(middle_ns, zone)
            if local.utcoffset() == (local - timedelta(hours=30)).utcoffset():
                # No clock change nearby: the latest price of the day, or the last of the day before.
                expected = [price for price in daily if price.clock <= local.time()] or daily
                assert period.price_per_kwh == expected[-1].price_per_kwh


def test_mean_prices_of_steps_are_those_of_each_second():
    start_ns = ns(datetime(2026, 11, 25, 21, 17), BERLIN)
    prices = GridPrices(BERLIN, (
        DailyPrice(time(6), 0.4), DailyPrice(time(22), 0.2), DailyPrice(time(23, 5), -0.1)))
    time_s = np.array([0.0, 100.0, 4000.0, 9000.0, 20000.0])
    each_s = [0.4 if second < 43 * 60 else 0.2 if second < 108 * 60 else -0.1 for second in range(20000)]
    expected = [np.mean(each_s[int(first):int(last)]) for first, last in zip(time_s, time_s[1:])]
    np.testing.assert_allclose(prices.step_prices(start_ns, time_s), expected, atol=1e-12)


def test_where_the_table_ends_an_hour_counts_as_the_dearest():
    start_ns = ns(datetime(2026, 11, 25, 21), BERLIN)
    hour_ns = 3600 * NS_PER_S
    prices = GridPrices(BERLIN, (), (PricePeriod(start_ns, start_ns + hour_ns, 0.1),
                                     PricePeriod(start_ns + hour_ns, start_ns + 2 * hour_ns, 0.3)))
    np.testing.assert_allclose(
        prices.step_prices(start_ns, np.array([0.0, 3600.0, 7200.0, 14400.0])), [0.1, 0.3, 0.3])
    assert prices.unknown_from_ns(start_ns, start_ns + 4 * hour_ns) == start_ns + 2 * hour_ns
    assert prices.is_known(start_ns, start_ns + 1) and not prices.is_known(
        start_ns + 2 * hour_ns, start_ns + 3 * hour_ns)
    assert prices.periods(start_ns, start_ns) == ()


# Files


WEEK = """
time_zone: Europe/Berlin
ambient_temperature_c: -5
departures:
  - {name: work, weekdays: [monday, friday], time: '07:30', target_battery_temperature_c: 22, plugged_in: true}
  - {name: trip, weekdays: [sunday], time: '9:05', plugged_in: false}
"""
PRICES = """
time_zone: Europe/Berlin
currency: EUR
daily:
  - {from: '22:00', price_per_kwh: 0.24}
  - {from: '06:00', price_per_kwh: 0.38}
dated:
  - {from: '2026-11-26 01:00', price_per_kwh: 0.10}
  - {from: '2026-11-26 03:00', until: '2026-11-26 04:00', price_per_kwh: -0.02}
"""


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / 'file.yaml'
        path.write_text(text)
        return path
    return write


@pytest.mark.parametrize('zone', ['Europe/Berlin', 'America/New_York', 'UTC'])
@pytest.mark.parametrize('quote', ["'", ''])
def test_times_with_an_offset_name_their_instants_in_any_zone(file, zone, quote):
    """The hour from 02:00 to 03:00 of 2026-10-25 occurs twice in Berlin; both have their prices."""
    prices = load_grid_prices(file(f"""
time_zone: {zone}
dated:
  - {{from: '2026-10-25T02:00:00+02:00', price_per_kwh: 1}}
  - {{from: '2026-10-25T02:00+0100', price_per_kwh: 2}}
  - {{from: '2026-10-25 02:00:00.000Z', until: '2026-10-24T23:00:00 -04:00', price_per_kwh: 3}}
""".replace("'", quote)))
    hours = [datetime(2026, 10, 25, hour) for hour in range(4)]
    assert prices.dated == tuple(
        PricePeriod(ns(begin), ns(end), price) for begin, end, price in zip(hours, hours[1:], (1.0, 2.0, 3.0)))


@pytest.mark.parametrize('text', ['2026-10-25 02:00+25:00', '2026-10-25 02:00+2', '2026-10-25 02:00 CET',
                                  '0001-01-01 00:00+23:59', '2026-10-25 02:00:61'])
def test_times_that_are_none_are_refused_with_what_is_allowed(file, text):
    with pytest.raises(InvalidInput, match='it must be YYYY-MM-DD HH:MM, if need be with an offset'):
        load_grid_prices(file(PRICES.replace('2026-11-26 01:00', text)))


def test_a_week_is_read(file):
    week = load_departures(file(WEEK.replace("'9:05'", "'9:05', maximum_arrival_temperature_c: 35")))
    assert week == Departures(BERLIN, (
        Departure('work', frozenset((0, 4)), time(7, 30), 22.0, True),
        Departure('trip', frozenset((6,)), time(9, 5), None, False, 35.0)), -5.0)


@pytest.mark.parametrize('old, new, problem', [
    ('Europe/Berlin', 'Europe/Atlantis', "time_zone: 'Europe/Atlantis' is unknown on this computer"),
    ('Europe/Berlin', '../etc/passwd', "time_zone: '../etc/passwd' is unknown"),
    ('Europe/Berlin', 'Europe', "time_zone: 'Europe' is unknown"),
    # Without quotes YAML reads minutes of an hour: 450.
    ("'07:30'", '7:30', r'departures\[0\].time: 450 is not a string; put it in quotes'),
    ("'07:30'", "'24:00'", r"departures\[0\].time: '24:00' is not"),
    ("'07:30'", "'7.30'", "'7.30' is not allowed; it must be HH:MM"),
    ('monday', 'Monday', r'departures\[0\].weekdays'), ('[monday, friday]', '[]', r'departures\[0\].weekdays'),
    ('22,', '.nan,', 'target_battery_temperature_c: nan'), ('22,', '220,', 'target_battery_temperature_c'),
    ('plugged_in: true', 'plugged_in: 1', r'departures\[0\].plugged_in'),
    (', plugged_in: true', '', r'departures\[0\].*plugged_in'),
    ('name: trip', 'name: work', "duplicate name 'work' \\(2 times\\)"),
    ("[sunday], time: '9:05'", "[friday], time: '7:30'", '2 departures on friday at 07:30; only one is allowed'),
    ('time_zone: Europe/Berlin', '', 'time_zone'), ('-5', '-99', 'ambient_temperature_c')])
def test_what_is_wrong_with_departures_is_named(file, old, new, problem):
    path = file(WEEK.replace(old, new, 1))
    with pytest.raises(InvalidInput, match=problem) as refused:
        load_departures(path)
    assert str(refused.value).startswith(f'{path}: ')


@pytest.mark.parametrize('old, new, problem', [
    (PRICES, 'time_zone: UTC', 'daily: is missing, and so is dated'),
    ("'22:00'", "'6:00'", 'daily: 2 prices from 06:00 on'), ("'22:00'", "'25:00'", r'daily\[0\].from'),
    ('0.24', '.inf', 'price_per_kwh: inf'), ('0.24', 'cheap', r'daily\[0\].price_per_kwh'),
    (", until: '2026-11-26 04:00'", '', r'dated\[1\].until: is missing; the last price needs its end'),
    ('04:00', '02:00', r'dated\[1\]: ends Thu 2026-11-26 02:00 CET, not after its begin'),
    ('2026-11-26 03:00', '2026-11-26 00:30', r'dated\[0\]: ends'),
    ('2026-11-26 01:00', '2026-13-26 01:00', 'dated'),
    ('0.10}', "0.10, until: '2026-11-26 03:30'}", r'dated\[1\].from: Thu 2026-11-26 03:00 CET lies before')])
def test_what_is_wrong_with_prices_is_named(file, old, new, problem):
    path = file(PRICES.replace(old, new, 1))
    with pytest.raises(InvalidInput, match=problem) as refused:
        load_grid_prices(path)
    assert str(refused.value).startswith(f'{path}: ')
