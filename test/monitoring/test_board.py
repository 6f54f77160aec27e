# SPDX-License-Identifier: Apache-2.0
"""The state of the page for one planner, and its history."""

import json
import math

from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
import pytest
from seen_examples import a_board, a_plan, NAN, START_S

from bev_preheat.control.heater import HeaterStatus
from bev_preheat.messages.diagnostics import entry, OK, WARN
from bev_preheat.monitoring.board import change_of, Trail
from bev_preheat.monitoring.seen import RouteSeen
from bev_preheat.monitoring.source import Cursor, message, view_values
from bev_preheat.planning.status import Status
from bev_preheat.recording.battery_response import Unheated
from bev_preheat.vehicle import load_vehicle


def test_the_view_has_the_values_of_the_messages():
    board = a_board()
    board.see_route(RouteSeen((), 0, 0.2))
    view = view_values(board, 100.5)
    expected = {'at': START_S, 'temperature': -7.0, 'soc': 0.9, 'power': 0.0, 'status': 'WAITING',
                'predicted': 24.5, 'deviation': 0.4, 'target': 25.0, 'arrivalSoc': 0.61,
                'arrival': START_S + 1800.0,
                'heatingStart': START_S + 600.0, 'charging': 1800.0, 'chargingUnheated': 2520.0, 'reserve': 0.2,
                'banner': None, 'late': [], 'tripFrom': START_S}
    assert {key: view[key] for key in expected} == expected
    assert view['ages']['battery'] == 0.5
    assert view['most'] is None
    assert view_values(a_board(maximum_arrival_temperature=36.0), 100.5)['most'] == 36.0


@pytest.mark.parametrize('later, reserve', [(0, 0.25), (1, 0.15), (2, 0.1), (5, 0.25)])
def test_the_reserve_is_that_of_the_current_leg(later, reserve):
    assert RouteSeen((0.1, 0.15), 2, 0.25).reserve_of_leg(later) == reserve


def test_unknown_values_are_null_and_the_json_is_valid():
    board = a_board(predicted_arrival_temperature=NAN, predicted_arrival_temperature_deviation=math.inf,
                    target_battery_temperature=-math.inf, predicted_arrival_soc=NAN, charging_time=math.inf,
                    heating_start_s=None, arrival=Time(), temperatures_c=(NAN, -5.0, 1e300))
    text = message('/planner', board, Cursor(), 100.0)
    values = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    assert values['view']['predicted'] is values['view']['charging'] is values['view']['arrival'] is None
    assert values['plan']['planned'] == [None, -5.0, None]


def test_text_of_any_publisher_cannot_leave_its_place_and_is_short():
    evil = '</script><script>alert(1)</script>'
    board = a_board(route_id=evil + 'x' * 5000, explanation=evil + 'y' * 100_000)
    text = message('/planner', board, Cursor(), 100.0)
    assert '<' not in text and len(text) < 10_000
    assert json.loads(text)['view']['sentence'].startswith(evil)


def test_a_tab_gets_only_what_it_does_not_have():
    board, cursor = a_board(), Cursor()
    first = json.loads(message('/planner', board, cursor, 100.0))
    assert first['history']['isWhole'] and first['history']['time'] == [START_S]
    again = json.loads(message('/planner', board, cursor, 100.5))
    assert set(again) == {'planner', 'view'}
    board.see_battery(START_S + 1.0, -6.9, 0.9, 101.0)
    more = json.loads(message('/planner', board, cursor, 101.0))
    assert not more['history']['isWhole'] and more['history']['measured'] == [-6.9]
    # Another tab gets all.
    assert json.loads(message('/planner', board, Cursor(), 101.0))['history']['time'] == [START_S, START_S + 1.0]


def test_the_trajectories_come_at_most_once_a_second():
    board, cursor = a_board(), Cursor()
    message('/planner', board, cursor, 100.0)
    board.see_plan(a_plan(START_S + 1.0), 100.2)
    assert 'plan' not in json.loads(message('/planner', board, cursor, 100.2))
    assert 'plan' in json.loads(message('/planner', board, cursor, 101.1))


def test_a_clock_set_back_starts_another_drive():
    board, cursor = a_board(), Cursor()
    board.see_battery(START_S + 300.0, 3.0, 0.8, 130.0)
    message('/planner', board, cursor, 130.0)
    board.see_battery(START_S + 10.0, -9.0, 0.95, 131.0)
    values = json.loads(message('/planner', board, cursor, 131.0))
    assert values['history']['isWhole'] and values['history']['measured'] == [-9.0]
    assert values['events'] == {'marks': [], 'regimes': [], 'doubts': [], 'lapses': []}
    assert values['view']['at'] == START_S + 10.0 and values['view']['status'] is None


def test_memory_is_bounded_over_a_week():
    board = a_board()
    for second in range(0, 7 * 86400, 20):
        at_s = START_S + second
        board.see_battery(at_s, 20.0 + second % 7, 0.5, at_s)
        board.see_command(at_s, 1000.0 * (second % 3), int(Status.HEATING), at_s)
        if second % 300 == 0:
            board.see_plan(a_plan(at_s, status=second // 300 % 8, explanation=f'{second}'), at_s)
            board.see_diagnostics(at_s, {'signals': entry('signals', OK, '', {'regime': f'{second}'})}, at_s)
    assert len(message('/planner', board, Cursor(), 1e6)) < 250_000


@pytest.mark.parametrize('changed, text', [
    ({'status': int(Status.HEATING), 'explanation': 'Heats.'}, 'Heats.'),
    ({'target_battery_temperature': 20.0}, 'Target 20.0 instead of 25.0 degC.'),
    ({'heating_start_s': START_S + 300.0}, 'Heating starts 5:00 min earlier than planned before.'),
    ({'heating_start_s': START_S + 900.0}, 'Heating starts 5:00 min later than planned before.'),
    ({'predicted_arrival_temperature': 22.0}, 'Arrival at 22.0 instead of 24.5 degC.'),
    ({'predicted_arrival_temperature': 24.0, 'heating_start_s': START_S + 630.0,
      'target_battery_temperature': 24.8}, None),
    ({'target_battery_temperature': NAN, 'predicted_arrival_temperature': NAN, 'heating_start_s': None}, None)])
def test_a_changed_plan_is_marked_with_its_change(changed, text):
    mark = change_of(a_plan(), a_plan(START_S + 1.0, **changed))
    assert (None if mark is None else mark.text) == text


def test_regimes_and_doubts_are_periods():
    board = a_board()
    for second, regime, doubt in ((0, 'driving', {}), (10, 'driving', {'current in doubt since [s]': '0'}),
                                  (30, 'charging', {})):
        board.see_diagnostics(
            START_S + second, {'signals': entry('signals', WARN, '', {'regime': regime, **doubt})}, 100.0)
    events = board.events()
    assert events['regimes'] == [[START_S, START_S + 30, 'driving'], [START_S + 30, None, 'charging']]
    assert events['doubts'] == [[START_S + 10, START_S + 30, 'current']]


def test_without_heating_the_battery_is_colder_by_the_stored_heat():
    vehicle = load_vehicle('reference')
    board = a_board()
    board.unheated = Unheated(vehicle)
    heated_s, power_w = 600.0, 5000.0
    for second in range(0, int(heated_s) + 1, 10):
        board.see_command(START_S + second, power_w, int(Status.HEATING), 100.0 + second)
        # The sensor shows no heat at all yet; plans start from the battery's own temperature.
        board.see_plan(a_plan(START_S + second, times_s=(START_S + second, START_S + 1800.0),
                              temperatures_c=(0.01 * second, 6.0), socs=(0.8, 0.7), powers_w=(power_w,)), 100.0)
        board.see_battery(START_S + second, 0.0, 0.8, 100.0 + second)
    gained_k = 0.01 * heated_s - board.temperatures.since(0)[-1][3]
    without_leakage_k = vehicle.hvch.efficiency * power_w * heated_s / vehicle.battery.heat_capacity_j_per_k
    # Some of the heat leaks: by less than gamma_0 times the gain.
    lost_k = vehicle.battery.leakage.gamma_0_w_per_k * heated_s / vehicle.battery.heat_capacity_j_per_k * gained_k
    assert without_leakage_k - lost_k < gained_k < without_leakage_k
    # The plan goes on from there.
    at_s = START_S + heated_s
    board.see_plan(a_plan(at_s, times_s=(at_s, at_s + 600.0), temperatures_c=(6.0, 6.0), socs=(0.8, 0.7),
                          powers_w=(0.0,)), 800.0)
    now_c, later_c = board.plan_curves()['planUnheated']
    assert now_c == pytest.approx(6.0 - gained_k, abs=0.01) and now_c < later_c < 6.0
    # It is continuous at that instant, whatever the sensor shows.
    assert now_c == pytest.approx(board.temperatures.since(0)[-1][3], abs=0.01)


def test_the_delivered_power_counts_for_the_heat_and_a_lapsed_command_is_a_span():
    board = a_board()
    board.unheated = Unheated(load_vehicle('reference'))
    gained_k = []
    for share in (1.0, 0.5):
        board.forget()
        for second in range(0, 301, 5):
            at_s = START_S + second
            board.see_command(at_s, 4000.0, int(Status.HEATING), at_s, at_s + (5.0 if second != 100 else 2.0))
            board.see_answer(HeaterStatus(round(at_s * 1e9), 4000.0, share * 4000.0))
            board.see_plan(a_plan(at_s, temperatures_c=(0.0, 0.0, 0.0)), at_s)
            board.see_battery(at_s, 0.0, 0.8, at_s)
        gained_k.append(-board.temperatures.since(0)[-1][3])
    assert gained_k[0] > 2.0 and gained_k[1] == pytest.approx(0.5 * gained_k[0], rel=0.01)
    assert board.history()['delivered'] == [2000.0] and board.delivered_w(board.at_s) == 2000.0
    assert board.events()['lapses'] == [[START_S + 102.0, START_S + 105.0, 'no valid command']]
    board.see_battery(at_s + 30.0, 0.0, 0.8, at_s)
    # The heater's answers and the commands are missing for a while.
    assert math.isnan(board.delivered_w(board.at_s))
    assert board.events()['lapses'][-1] == [at_s + 5.0, None, 'no valid command']


def test_powers_of_sources_are_rows_of_one_length_by_name_and_bounded():
    board, cursor = a_board(sources_w={'hvch': (0.0, 4000.0), 'heat_pump': (0.0, 1000.0)}), Cursor()
    message('/planner', board, cursor, 100.0)
    for second, hvch_w, others in ((1.0, 4000.0, {'heat_pump': 1000.0, 'motor': 0.0}),
                                   (2.0, 4000.0, {'heat_pump': NAN, 'motor': 2.0}),
                                   (3.0, 5000.0, {'motor': 3000.0}), (4.0, 5000.0, {'motor': 3000.0}),
                                   (5.0, 6000.0, {'motor': 3000.0})):
        for name, power_w in others.items():
            board.see_source(START_S + second, name, power_w)
        board.see_command(START_S + second, hvch_w, int(Status.HEATING), 100.0)
    # Of no planner.
    for at_s in (0.0, NAN, math.inf, START_S - 1e9, START_S + 100.0):
        board.see_source(at_s, 'motor', 1.0)
    values = json.loads(message('/planner', board, cursor, 102.0))
    assert values['view']['sources'] == [['hvch', 5000.0], ['heat_pump', 1000.0], ['motor', 3000.0]]
    assert values['history']['mixTime'] == [START_S + 1.0, START_S + 3.0]
    assert values['history']['mix'] == [[4000.0, 1000.0, 0.0], [5000.0, 1000.0, 3000.0]]
    assert values['plan']['planMix'] == {'hvch': [0.0, 4000.0, None], 'heat_pump': [0.0, 1000.0, None]}
    for number in range(5000):
        board.see_source(START_S + 6.0 + number // 200, f'{number}' * 99, 1e3)
    assert len(message('/planner', board, Cursor(), 103.0)) < 50_000


@pytest.mark.parametrize('ambient_c, per_watt', [((0.0, -10.0), 2.0), ((0.0, 10.0), 3.1), ((), NAN)])
def test_without_heating_counts_the_heat_of_each_source_in_the_air_of_the_route(ambient_c, per_watt):
    vehicle, power_w = load_vehicle('heat_pump_car'), 2000.0
    board = a_board()
    # The second segment begins at the start.
    board.see_route(RouteSeen((), 0, 0.2, (START_S, START_S + 1800.0)[:len(ambient_c)], ambient_c))
    board.unheated = Unheated(vehicle)
    for at_s in (START_S + second for second in range(0, 601, 10)):
        board.see_source(at_s, 'heat_pump', power_w)
        board.see_command(at_s, 0.0, int(Status.HEATING), 100.0)
        board.see_plan(a_plan(at_s, times_s=(at_s, at_s + 300.0), temperatures_c=(0.0, 0.0), socs=(0.8, 0.7),
                              powers_w=(0.0,), sources_w={'hvch': (0.0,), 'heat_pump': (power_w,)}), 100.0)
        board.see_battery(at_s, 0.0, 0.8, 100.0)
    now_c, later_c = board.temperatures.since(0)[-1][3], board.plan_curves()['planUnheated'][-1]
    for seconds, unheated_c in (600.0, now_c), (900.0, later_c):
        # Less than 3 % leak in that time.
        stored_k = per_watt * power_w * seconds / vehicle.battery.heat_capacity_j_per_k
        assert math.isnan(per_watt) or unheated_c == pytest.approx(-stored_k, rel=0.03)
    assert (math.isnan(now_c), later_c is None) == (math.isnan(per_watt),) * 2


# --- The history: bounded, recent points whole, older ones further apart ---


def test_a_day_at_one_hertz_stays_small_and_keeps_its_latest_minutes_whole():
    trail = Trail(most=1000)
    for second in range(100_000):
        trail.add((float(second), 2.0 * second))
        assert len(trail) <= 1000
    times = [at_s for at_s, _ in trail.since(0)]
    assert times[-60:] == [float(second) for second in range(100_000 - 60, 100_000)]
    # Not only the latest: hours back without a large gap, but not beyond the horizon.
    assert 100_000 - 86400 - 200 <= times[0] < 100_000 - 80_000
    # On a screen a gap of 6 % of the age is a few points wide.
    assert all(after - before <= 1.0 + 0.06 * (100_000 - before) for before, after in zip(times, times[1:]))
    assert all(value == 2.0 * at_s for at_s, value in trail.since(0))


@given(st.lists(st.floats(0.0, 1e6, allow_nan=False), max_size=300), st.integers(4, 50))
def test_instants_rise_and_the_size_is_bounded_whatever_comes(instants, most):
    trail = Trail(most=most, horizon_s=1e5)
    for at_s in instants:
        trail.add((at_s,))
        rows = list(trail.since(0))
        assert rows[-1] == (at_s,) and len(rows) <= most
        assert all(before < after for before, after in zip(rows, rows[1:]))


@given(st.lists(st.floats(0.0, 1e4, allow_nan=False), max_size=200))
def test_a_reader_that_heeds_the_generation_has_all(instants):
    trail, known, generation = Trail(most=20), [], 0
    for at_s in instants:
        trail.add((at_s,))
        if trail.generation != generation:
            known, generation = [], trail.generation
        known += trail.since(len(known))
        assert known == list(trail.since(0))
