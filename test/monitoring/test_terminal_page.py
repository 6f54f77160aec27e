# SPDX-License-Identifier: Apache-2.0
"""The view in a terminal: its contents, and robustness against any message."""

from array import array
import io
from math import inf

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rich.cells import cell_len
from rich.console import Console
from seen_examples import a_board, START_S

from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.seen import entries_seen, EntrySeen, plan_seen, RouteSeen
from bev_preheat.monitoring.terminal_page import line, page
from bev_preheat.monitoring.view import Surroundings
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


def test_ages_are_those_of_arrival_and_a_silent_planner_is_named(board):
    shown = text(board, now_s=NOW_S + 7.5)
    assert 'command 7.5 s' in shown and 'The planner is silent: no message for 8 s.' in shown
    board.around = Surroundings(is_there=False)
    assert 'The planner has disappeared.' in text(board)


def test_a_lease_that_ended_ages_ago_is_no_lease(board):
    board.see_command(START_S + 1.0, 1000.0, int(Status.HEATING), NOW_S, -1.7e299)
    assert '1000 W' in text(board)


def test_what_was_never_heard_is_said():
    shown = text(Board())
    assert 'battery never' in shown and 'diagnostics never' in shown and 'Departure' not in shown


@pytest.mark.parametrize('width, height', [
    (80, 24), (40, 10), (60, 12), (120, 50), (80, 15), (40, 24), (110, 33), (12, 5)])
def test_the_page_fits_the_terminal(board, width, height):
    lines = text(board, width, height).splitlines()
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width


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
    assert line(board)


def test_each_of_several_heat_sources_has_a_line_with_its_plan_and_its_command():
    board = a_board(sources_w={'hvch': (0.0, 0.0), 'motor': (0.0, 1500.0), 'heat_pump': (3000.0, inf)})
    for at_s, motor_w in ((START_S + 1.0, 700.0), (START_S + 2.0, 700.0)):
        for name, power_w in (('motor', motor_w), ('heat_pump', 2500.0)):
            board.see_source(at_s, name, power_w)
        board.see_command(at_s, 0.0, int(Status.HEATING), NOW_S)
    shown = text(board)
    assert 'motor            ▁▅  700 W now' in shown and 'heat_pump        █▁  2500 W now' in shown
    assert 'hvch ' not in shown and 'on; ends in' in shown
    assert 'heater 0 W  motor 700 W  heat_pump 2500 W  WAITING' in line(board)
