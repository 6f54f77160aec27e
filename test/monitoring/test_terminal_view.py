# SPDX-License-Identifier: Apache-2.0
"""The view in a terminal: its contents, and robustness against any message."""

from array import array
import io
from math import inf, nan

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rich.cells import cell_len
from rich.console import Console
from seen_examples import a_board, START_S

from bev_preheat.control.heater_power import HeaterStatus
from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.health import Surroundings
from bev_preheat.monitoring.seen import entries_seen, EntrySeen, plan_seen, RouteSeen
from bev_preheat.monitoring.terminal_view import course, line, page
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import PreheatPlan

NOW_S = 100.0


@pytest.fixture
def board():
    """Return the Board of a planner ten minutes before it heats."""
    board = a_board(sessions=('27:47 min, 51.34 kWh', '31:37 min, 50.94 kWh'), target_reason='Worth it: cold.')
    board.see_command(START_S, 0.0, int(Status.WAITING), NOW_S, START_S + 2.5)
    board.see_route(RouteSeen((), 0, 0.25))
    board.see_diagnostics(START_S, [
        EntrySeen('heater', 2, 'dead: x', {}),
        EntrySeen('departures', 0, '', {'next departure': 'work, Mon 07:10', 'state': 'is planned'})], NOW_S)
    return board


def text(board, width=100, height=None, now_s=NOW_S):
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(page(board, now_s, '/planner', height))
    return console.export_text()


@pytest.mark.parametrize('words', [
    'Battery          -7.0 degC', 'Target           25.0 degC', 'Predicted        24.5 degC +- 0.4',
    'State of charge  90.0 %', 'On arrival       61.0 %', '25.0 %, spare 36.0 %', '0 W, lease 2.5 s',
    'starts in 10:00 min', 'Arrival          in 30:00 min', 'WAITING: Heating starts in 10:00 min.',
    'Charging         27:47 min, 51.34 kWh', 'Unheated         31:37 min, 50.94 kWh', 'Target: Worth it: cold.',
    'Departure        work, Mon 07:10', 'Preparation      is planned', 'heater      ERROR  dead: x',
    'Planned          ▁▁█  -7.0 to 24.5 degC', 'battery 0.0 s', '/planner'])
def test_a_waiting_planner(board, words):
    assert words in text(board)


def test_a_heating_planner_says_when_it_ends_and_what_the_heater_delivers(board):
    board.see_command(START_S, 5022.0, int(Status.HEATING), NOW_S, START_S + 2.5)
    board.see_answer(HeaterStatus(round(START_S * 1e9), 5022.0, 4980.0))
    shown = text(board)
    for words in ('5022 W, lease 2.5 s', 'on; ends in 30:00 min', 'Delivered        4980 W'):
        assert words in shown


def test_ages_are_those_of_arrival_and_a_silent_planner_is_named(board):
    shown = text(board, now_s=NOW_S + 7.5)
    assert 'command 7.5 s' in shown and 'The planner is silent: no message for 8 s.' in shown
    board.around = Surroundings(is_there=False)
    assert 'The planner has disappeared.' in text(board)


def test_what_was_never_heard_is_said():
    shown = text(Board())
    assert 'battery never' in shown and 'diagnostics never' in shown and 'Departure' not in shown


def test_unknown_figures_are_no_numbers():
    shown = text(a_board(predicted_c=nan, deviation_k=nan, arrival_soc=nan, target_c=nan, arrival_s=None,
                         heating_start_s=None, times_s=(), temperatures_c=(), socs=(), powers_w=()))
    assert 'nan' not in shown and 'none planned' in shown and '-, spare -' in shown and 'Charging' not in shown


def test_a_reason_that_the_sentence_has_is_not_told_twice():
    board = a_board(sentence='Worth it: for a good reason. So it is.', target_reason='for a good reason.')
    assert text(board).count('for a good reason') == 1
    board.see_diagnostics(START_S, [EntrySeen(
        'preheating', 0, 'WAITING: Worth it: for a good reason. So it is.', {})], NOW_S)
    assert text(board).count('for a good reason') == 1 and 'preheating  OK  as above' in text(board)


def test_an_endless_explanation_does_not_fill_the_screen():
    board = a_board(sentence='x' * 1_000_000)
    assert len(text(board)) < 10_000 and len(line(board.view(NOW_S))) < 3000


def test_one_line_says_the_same(board):
    assert line(board.view(NOW_S)) == ('battery -7.0 degC  arrival 24.5 degC +- 0.4  heater 0 W  WAITING: '
                                       'Heating starts in 10:00 min.')


@pytest.mark.parametrize('width, height', [
    (80, 24), (40, 10), (60, 12), (120, 50), (80, 15), (40, 24), (110, 33), (12, 5)])
def test_the_page_fits_the_terminal(board, width, height):
    lines = text(board, width, height).splitlines()
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width


def test_a_usual_terminal_has_room_for_everything(board):
    shown = text(board, 80, 24)
    for words in ('Battery          -7.0 degC', 'Heating starts in 10:00 min.', 'heater      ERROR  dead: x',
                  'diagnostics 0.0 s'):
        assert words in shown


def test_a_narrow_terminal_shows_the_figures_one_below_the_other(board):
    lines = [each.strip('│ ') for each in text(board, 50, 20).splitlines()]
    for words in ('Battery          -7.0 degC', 'State of charge  90.0 %', 'Heating          starts in 10:00 min'):
        assert words in lines


@pytest.mark.parametrize('values, drawn', [
    ((0.0, 7.0), '▁█'), ((3.0, nan, 4.0), '▄ ▅'), (range(8), '▁▂▃▄▅▆▇█'), ((5.0,), '▆')])
def test_a_course_rises_with_its_values(values, drawn):
    assert course(values, 0.0, 7.0) == drawn
    assert len(course(range(1000), 0.0, 999.0)) == 24


ANY = st.floats(allow_nan=True, allow_infinity=True)
TIMES = st.builds(Time, sec=st.integers(-2**31, 2**31 - 1), nanosec=st.integers(0, 2**32 - 1))


@pytest.mark.costly
@given(values=st.lists(ANY, min_size=3, max_size=3), times=st.lists(TIMES, min_size=3, max_size=3),
       numbers=st.lists(st.integers(0, 255), min_size=3, max_size=3),
       columns=st.lists(st.lists(ANY, max_size=5), min_size=3, max_size=3),
       words=st.text(max_size=40))
def test_no_message_ends_it(values, times, numbers, columns, words):
    board, float32 = Board(), [value if abs(value) < 3e38 else inf for value in values]
    time, temperature, power = (array('d', column) for column in columns)
    board.see_battery(values[0], float32[0], float32[1], NOW_S)
    board.see_battery(values[0] + 1.0, -1e308, float32[1], NOW_S)
    board.see_battery(values[0] + 2.0, 1e308, float32[1], NOW_S)
    board.see_route(RouteSeen((), 0, values[0]))
    board.see_command(values[1], values[1], numbers[0], NOW_S, values[2])
    board.see_plan(plan_seen(PreheatPlan(
        status=numbers[1], explanation=words, heating_planned=True, heating_start=times[0], heating_end=times[1],
        arrival=times[2], predicted_arrival_temperature=values[2], target_battery_temperature=values[0],
        predicted_arrival_temperature_deviation=values[1], time=time, battery_temperature=temperature,
        soc=temperature, hvch_power=power)), NOW_S)
    board.see_diagnostics(values[2], entries_seen(DiagnosticArray(status=[DiagnosticStatus(
        name=f'planner: {words}', message=words, level=bytes([numbers[2]]))]), 'planner'), NOW_S)
    assert len(text(board, 80, 24).splitlines()) <= 24
    assert line(board.view(NOW_S))
