# SPDX-License-Identifier: Apache-2.0
"""The heater's energy as commanded and as delivered, the spans without a valid command, and results in words."""

import json
from math import inf
from pathlib import Path
from types import SimpleNamespace

import pytest
from recorded_drive import record_drive

from bev_preheat.control.decision import Command
from bev_preheat.control.heater import Answers, HeaterStatus
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.recording.course import TripResults
from bev_preheat.recording.flight import Period
from bev_preheat.recording.heater_account import HeaterAccount
from bev_preheat.recording.replay import Played
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heater_controller import Refusal

START_S = 1_700_000_000


def ns(second):
    return round((START_S + second) * NS_PER_S)


def test_a_command_counts_until_its_lease_ends_and_the_rest_is_a_span():
    account = HeaterAccount()
    # 3600 W: one Wh a second. The lease ends 2.5 s after each command.
    for second in (0.0, 1.0, 2.0, 6.0, 7.0):
        account.command(ns(second), 3600.0, ns(second + 2.5))
    assert account.commanded_wh == pytest.approx(1.0 + 1.0 + 2.5 + 1.0)
    assert account.without_command == [Period(ns(4.5), ns(6.0))]
    assert account.delivered_wh is None


def test_answers_tell_what_was_delivered_and_that_the_heater_had_no_command():
    account = HeaterAccount()
    account.answer(HeaterStatus(ns(-1.0), 0.0, 0.0, Refusal.NO_COMMAND))
    for second in range(10):
        account.command(ns(second), 3600.0, ns(second + 2.5))
        is_lost = 3 <= second < 5
        answer = HeaterStatus(ns(second), 0.0 if is_lost else 3600.0, 0.0 if is_lost else 1800.0,
                              Refusal.NO_COMMAND if is_lost else Refusal.NOT_REFUSED)
        # Each is seen at two steps.
        account.answer(answer)
        account.answer(answer)
    assert account.commanded_wh == pytest.approx(9.0)
    # Half the power for 7 s, two ramps of a second, and the second before the first command with one.
    assert account.delivered_wh == pytest.approx(0.5 * (6.0 + 3 * 0.5))
    assert account.without_command == [Period(ns(3.0), ns(5.0))]


PLAN = SimpleNamespace(target_temperature_c=25.0, arrival_temperature_c=24.8, maximum_arrival_temperature_c=inf)
COMMAND = Command(3600.0, ns(1e6), Status.HEATING)
VEHICLE = load_vehicle('reference')
OBEYS = HeaterReport(Heater.ANSWERS, 1.0, 1.0)


def step(second, status, temperature_c, plan=PLAN, heater=OBEYS):
    return Played(ns(second), None, SimpleNamespace(
        decision=SimpleNamespace(status=status, plan=plan), latest_command=COMMAND, answers=Answers(),
        vehicle=VEHICLE,
        measurement=SimpleNamespace(state=SimpleNamespace(temperature_c=temperature_c)),
        estimate=SimpleNamespace(heater=heater)))


@pytest.mark.parametrize('arrival_c, between, told', [
    (25.2, [], 'Arrived after 5:00 min at 25.2 degC, target 25.0 degC.'),
    (27.0, [], '2.0 K above the target of 25.0 degC.'),
    (20.0, [], '5.0 K short of the target of 25.0 degC: the recording names no obstacle; the last plan predicted '
               '24.8 degC.'),
    (20.0, [step(second, Status.DISABLED, 9.0, None) for second in range(60, 181, 5)],
     '5.0 K short of the target of 25.0 degC: preheating was switched off for 3:00 min.'),
    (20.0, [step(30, Status.HEATING, 9.0, heater=HeaterReport(Heater.DEAD, 1.0, 1.0))], ': heater dead: ')])
def test_each_trip_ends_with_its_result_in_words(arrival_c, between, told):
    results = TripResults()
    for each in (step(-100, Status.NO_BATTERY_STATE, 8.0, None), step(0, Status.HEATING, 8.0), *between,
                 step(299, Status.HEATING, arrival_c), step(300, Status.ARRIVED, arrival_c, None),
                 step(400, Status.ARRIVED, 0.0, None)):
        results.add(each)
    [trip] = results.trips
    arrival, energy = trip.sentences()
    assert told in arrival
    assert energy == 'The heater was commanded 300 Wh; the delivered energy is not recorded (hvch_status).'


@pytest.mark.parametrize('arrival_c, told', [
    (37.2, 'at 37.2 degC, 2.2 K above the 35.0 degC allowed: the recording names no obstacle'),
    (35.3, 'at 35.3 degC, allowed 25.0 … 35.0 degC.'), (30.0, 'at 30.0 degC, allowed 25.0 … 35.0 degC.'),
    (20.0, '5.0 K short of the target of 25.0 degC')])
def test_an_arrival_is_compared_with_the_highest_temperature_allowed(arrival_c, told):
    results, plan = TripResults(), SimpleNamespace(**{**vars(PLAN), 'maximum_arrival_temperature_c': 35.0})
    for each in (step(0, Status.WAITING_TO_COOL, 40.0, plan), step(299, Status.COOLING, arrival_c, plan),
                 step(300, Status.ARRIVED, arrival_c, None)):
        results.add(each)
    assert told in results.trips[0].sentences()[0]


@pytest.mark.needs('mcap', 'rclpy')
def test_each_heat_source_has_an_account(tmp_path, said):
    outputs = record_drive(tmp_path, 40.0, 120, vehicle='heat_pump_car')
    commands = [output.command for _, output in outputs if output.command is not None]
    replayed = json.loads(said('replay', tmp_path, '--json', '-')[1])
    assert replayed['reproduced'] is True
    # Two commands a second.
    for name in ('hvch', 'motor', 'heat_pump', 'chiller'):
        assert replayed['recorded'][f'{name}_commanded_wh'] == pytest.approx(
            sum(command.power_w(name) for command in commands) / 7200.0, rel=0.03), name
    assert replayed['recorded']['heat_pump_commanded_wh'] > 75.0
    assert any(told.startswith('The heat_pump was commanded 8') for told in replayed['recorded']['results'][0])
    assert said('replay', tmp_path, '--write-expected', 'expected.json')[0] == 0
    assert json.loads(Path('expected.json').read_text())['expected']['heat_pump_commanded_wh'] == {
        'value': pytest.approx(replayed['recorded']['heat_pump_commanded_wh'], abs=1e-3), 'tolerance': 20.0}
    status, output, _ = said('replay', tmp_path, '--expect', 'expected.json')
    assert status == 0 and 'heat_pump commanded [Wh]' in output
