# SPDX-License-Identifier: Apache-2.0
"""The monitor's page: its contents, and robustness against any message."""

from array import array
import io
from math import inf, nan
import sys

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rich.cells import cell_len
from rich.console import Console
from sensor_msgs.msg import BatteryState, Temperature

from bev_preheat.monitoring.chart import round_numbers
from bev_preheat.monitoring.heard import Heard
from bev_preheat.monitoring.view import line, page, waiting
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan


class Clock:
    """Real time, set by hand."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


def stamped(message, sec):
    message.header.stamp = Time(sec=sec)
    return message


def plan_message(**fields):
    return stamped(PreheatPlan(**{
        'status': PreheatPlan.WAITING, 'explanation': 'Heating starts in 2:00 min.',
        'heating_planned': True, 'heating_start': Time(sec=1120), 'heating_end': Time(sec=1500),
        'arrival': Time(sec=1600), 'predicted_arrival_temperature': 24.5,
        'predicted_arrival_soc': 0.43, 'target_battery_temperature': 25.0,
        'time': array('d', [0.0, 300.0, 600.0]),
        'battery_temperature': array('d', [-3.0, 10.0, 24.5]), 'soc': array('d', [0.8, 0.6, 0.43]),
        'hvch_power': array('d', [0.0, 5000.0]), **fields}), 1000)


def command_message(power_w, **fields):
    message = stamped(HvchCommand(battery_heating_power=power_w, **fields), 1000)
    message.valid_until = Time(sec=1002, nanosec=500_000_000)
    return message


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def heard(clock):
    """Return the data from a planner two minutes before it heats."""
    heard = Heard(clock_s=clock)
    heard.hear('battery_state', stamped(BatteryState(temperature=-3.25, percentage=0.8), 1000))
    heard.hear('route_plan', RoutePlan(minimum_arrival_soc=0.25, segment_duration=[600.0]))
    heard.hear('hvch_command', command_message(0.0, reason=HvchCommand.WAITING))
    heard.hear('preheat_plan', plan_message())
    heard.hear('predicted_arrival_temperature', Temperature(temperature=24.5, variance=0.49))
    heard.hear('/diagnostics', DiagnosticArray(status=[
        DiagnosticStatus(name='planner: heater', level=DiagnosticStatus.ERROR, message='dead: x'),
        DiagnosticStatus(name='vehicle_simulator: trip', message='driving')]))
    return heard


def text(heard, width=100, height=None):
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(page(heard, width, height))
    return console.export_text()


@pytest.mark.costly
@pytest.mark.parametrize('words', [
    'Battery    -3.2 degC', 'Target     25.0 degC', 'Predicted  24.5 degC +- 0.7',
    'State of charge  80.0 %', 'On arrival       43.0 %', '25.0 %, spare 18.0 %',
    '0 W, lease 2.5 s', 'starts in 2:00 min', 'in 10:00 min', 'WAITING',
    'Heating starts in 2:00 min.', 'planner: heater  ERROR  dead: x'])
def test_a_waiting_planner(heard, words):
    assert words in text(heard)


def test_a_heating_planner_says_when_it_ends(heard):
    heard.hear('hvch_command', command_message(5022.0, reason=HvchCommand.HEATING))
    page_text = text(heard)
    assert '5022 W, lease 2.5 s' in page_text and 'on; ends in 8:20 min' in page_text


def test_others_diagnostics_are_not_the_planners(heard):
    assert 'driving' not in text(heard)


def test_ages_are_those_of_arrival(heard, clock):
    clock.now_s += 7.5
    assert 'hvch_command 7.5 s' in text(heard)


def test_what_was_never_heard_is_said():
    page_text = text(Heard())
    assert 'battery_state never' in page_text and '/diagnostics never' in page_text


def test_unknown_figures_are_no_numbers(heard):
    heard.hear('preheat_plan', plan_message(
        predicted_arrival_temperature=nan, predicted_arrival_soc=nan,
        target_battery_temperature=nan, time=array('d'), battery_temperature=array('d'),
        arrival=Time(), heating_planned=False))
    page_text = text(heard)
    assert 'nan' not in page_text and 'none planned' in page_text


def test_the_session_and_the_reason_of_a_chosen_target_are_shown(heard):
    assert 'Charging' not in text(heard) and 'chosen' not in text(heard)
    chosen = {'target_source': PreheatPlan.TARGET_CHOSEN, 'target_reason': 'Worth it: for a good reason.',
              'charging_time': 1667.0, 'bought_energy': 51340.0, 'charging_time_unheated': 1897.0,
              'bought_energy_unheated': 50940.0}
    heard.hear('preheat_plan', plan_message(**chosen))
    page_text = text(heard)
    for words in ('25.0 degC, chosen', '27:47 min, 51.34 kWh', '31:37 min, 50.94 kWh',
                  'Target: Worth it: for a good reason.'):
        assert words in page_text
    # The explanation already contains the reason for 0 W.
    heard.hear('preheat_plan', plan_message(**{
        **chosen, 'explanation': 'Worth it: for a good reason. So it is.'}))
    assert text(heard).count('for a good reason') == 1


def test_a_cancelled_trip_has_no_reserve(heard):
    heard.hear('route_plan', RoutePlan())
    assert '25.0 %, spare' not in text(heard) and '-, spare -' in text(heard)


def test_an_endless_explanation_does_not_fill_the_screen(heard):
    heard.hear('preheat_plan', plan_message(explanation='x' * 1_000_000))
    assert len(text(heard)) < 10_000 and len(line(heard)) < 3000


def test_one_line_says_the_same(heard):
    assert line(heard) == ('battery -3.2 degC  arrival 24.5 degC +- 0.7  heater 0 W  WAITING: '
                           'Heating starts in 2:00 min.')


def test_what_is_missing_is_named():
    sentence = waiting(Heard(), lambda topic: 2 if topic == 'battery_state' else 0, '42')
    assert 'ROS domain 42' in sentence
    assert 'battery_state: 2 publishers, no message yet' in sentence
    assert 'hvch_command: no publisher' in sentence


@pytest.mark.parametrize('width, height', [
    (80, 24), (40, 10), (60, 12), (120, 50), (80, 15), (40, 24), (110, 33), (12, 5), (1, 2)])
def test_the_page_fits_the_terminal(heard, width, height):
    lines = text(heard, width, height).splitlines()
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width


@pytest.mark.needs('plotext')
def test_a_usual_terminal_has_room_for_everything_and_a_chart(heard):
    lines = text(heard, 80, 24)
    for words in ('Battery    -3.2 degC', 'Heating starts in 2:00 min.', 'battery (degC)',
                  'planner: heater  ERROR  dead: x', '/diagnostics 0.0 s'):
        assert words in lines


def test_a_narrow_terminal_shows_the_figures_one_below_the_other(heard):
    lines = [line.strip('│ ') for line in text(heard, 40, 14).splitlines()]
    for words in ('Battery          -3.2 degC', 'State of charge  80.0 %',
                  'Heating          starts in 2:00 min'):
        assert words in lines


@pytest.mark.needs('plotext')
def test_the_heater_is_drawn_on_a_scale_from_0(heard):
    panel = text(heard).split('heater (kW)')[1]
    labels = [line.strip('│ ').partition('┤')[0] for line in panel.splitlines() if '┤' in line]
    # 5 kW are planned.
    assert labels == ['5', '2.5', '0']


CURVE = set('▄▀▟▙▛▜▞▚█▌▐▖▗▘▝')


@pytest.mark.needs('plotext')
@pytest.mark.parametrize('power_w, label', [(0.0, '0'), (5000.0, '5')])
def test_a_command_is_drawn_where_the_scale_says_it_is(power_w, label):
    heard = Heard()
    for second in range(60):
        heard.hear('battery_state', stamped(BatteryState(temperature=-3.0), 1000 + second))
        heard.hear('hvch_command', stamped(command_message(power_w), 1000 + second))
    panel = text(heard).split('heater (kW)')[1]
    rows = dict(line.strip('│ ').split('┤') for line in panel.splitlines() if '┤' in line)
    assert {name for name, row in rows.items() if CURVE & set(row)} == {label}, panel


def test_what_the_plan_says_is_not_said_twice(heard):
    heard.hear('/diagnostics', DiagnosticArray(status=[DiagnosticStatus(
        name='planner: preheating', message='WAITING: Heating starts in 1:59 min.')]))
    page_text = text(heard)
    assert page_text.count('Heating starts in') == 1
    assert 'planner: preheating  OK     as above' in page_text


def test_without_plotext_the_rest_is_there(heard, monkeypatch):
    monkeypatch.setitem(sys.modules, 'plotext', None)
    page_text = text(heard)
    assert 'python3 -m pip install plotext' in page_text
    assert 'Battery    -3.2 degC' in page_text and 'battery (degC)' not in page_text


@pytest.mark.parametrize('low, high, most, numbers', [
    (0.0, 30.0, 4, [0, 10, 20, 30]), (-7.0, 25.0, 4, [0, 10, 20]), (-7.0, 25.0, 2, [0, 20]),
    (24.6, 25.6, 4, [25.0, 25.5]), (-1e6, 1e6, 3, [-1e6, 0.0, 1e6])])
def test_axes_are_labelled_with_round_numbers(low, high, most, numbers):
    assert round_numbers(low, high, most) == pytest.approx(numbers)


ANY = st.floats(allow_nan=True, allow_infinity=True)
TIMES = st.builds(Time, sec=st.integers(-2**31, 2**31 - 1), nanosec=st.integers(0, 2**32 - 1))


@pytest.mark.needs('plotext')
@pytest.mark.parametrize('stamp_s', [0, 2**31 - 1])
def test_a_command_of_another_time_is_not_drawn(heard, stamp_s):
    before = text(heard)
    # Drawing the line to it would exhaust the memory.
    heard.hear('hvch_command', stamped(command_message(5000.0), stamp_s))
    drawn = text(heard)
    assert 'heater (kW)' in before and 'heater (kW)' in drawn
    assert len(drawn) < 2 * len(before)


@pytest.mark.costly
@given(values=st.lists(ANY, min_size=3, max_size=3), times=st.lists(TIMES, min_size=3, max_size=3),
       numbers=st.lists(st.integers(0, 255), min_size=3, max_size=3),
       columns=st.lists(st.lists(ANY, max_size=5), min_size=3, max_size=3),
       words=st.text(max_size=40))
def test_no_message_ends_it(values, times, numbers, columns, words):
    heard = Heard()
    float32 = [value if abs(value) < 3e38 else inf for value in values]
    battery = BatteryState(temperature=float32[0], percentage=float32[1])
    battery.header.stamp = times[0]
    heard.hear('battery_state', battery)
    heard.hear('route_plan', RoutePlan(minimum_arrival_soc=values[0]))
    command = HvchCommand(battery_heating_power=values[1], reason=numbers[0])
    command.header.stamp, command.valid_until = times[1], times[2]
    heard.hear('hvch_command', command)
    time, temperature, power = (array('d', column) for column in columns)
    heard.hear('preheat_plan', PreheatPlan(
        status=numbers[1], explanation=words, heating_planned=True, heating_start=times[0],
        heating_end=times[1], arrival=times[2], predicted_arrival_temperature=values[2],
        target_battery_temperature=values[0], time=time, battery_temperature=temperature,
        hvch_power=power))
    heard.hear('predicted_arrival_temperature', Temperature(variance=values[1]))
    heard.hear('/diagnostics', DiagnosticArray(status=[DiagnosticStatus(
        name=f'planner: {words}', message=words, level=bytes([numbers[2]]))]))
    assert len(text(heard, 80, 24).splitlines()) <= 24
    assert line(heard)
