# SPDX-License-Identifier: Apache-2.0
"""A what-if counts the share of its command that the recorded heater delivered."""

from math import nan
from types import SimpleNamespace

import pytest
from recorded_drive import LONG_S, LONG_TARGET_C, record_drive

from bev_preheat.control.heater import Answers, HeaterAnswers, HeaterStatus
from bev_preheat.control.settings import Settings
from bev_preheat.estimation.hypotheses import Heater, HeaterReport, SuspectedFault
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.battery_response import BatteryResponse, SourceHeat
from bev_preheat.recording.changes import Changes, SignalChange
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.heater_account import alter_status, HeaterShares
from bev_preheat.recording.records import RecordedStep
from bev_preheat.recording.replay import replay, replay_changed
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heater_controller import Refusal
from bev_preheat_msgs.msg import HvchStatus

pytestmark = [pytest.mark.needs('mcap', 'rclpy')]
HEALTHY = HeaterReport(Heater.ANSWERS, 1.0, 1.0)
SUSPECTED = HeaterReport(Heater.ANSWERS, 1.0, 1.0, SuspectedFault(Heater.DERATED, 0.9, 0.5, 2.0, 1.0, None))
WEAK = HeaterReport(Heater.DERATED, 1.0, 0.4)
# A step of the reference route's plan, 30 s of the heater's power beside the cabin, 5022 W.
FULL_STEP_WH = 5022.0 * 30.0 / 3600.0


def shares_of(*states, heated_from=1, seconds=1):
    """Return the shares of steps that come every `seconds`, and the sentence."""
    steps = [SimpleNamespace(step=RecordedStep(
        number * seconds * NS_PER_S, command=(4000.0 if number >= heated_from else 0.0, 0, 0)))
        for number in range(len(states))]
    shares = HeaterShares(SimpleNamespace(given=steps, is_log=False))
    for answer, report in states:
        shares.add(SimpleNamespace(state=SimpleNamespace(
            answers=Answers(answer or HeaterAnswers()), now_ns=0, settings=Settings(),
            estimate=None if report is None else SimpleNamespace(heater=report))))
    return [shares.at(number) for number in range(len(states))], shares.sentence


def answer(requested_w, active_w, measured_w=None, refusal=Refusal.NOT_REFUSED, **said):
    return HeaterAnswers(
        status=HeaterStatus(0, requested_w, active_w, refusal, '', measured_w), **said), HEALTHY


REPORTS = [(None, report) for report in (
    None, HEALTHY, HEALTHY, SUSPECTED, SUSPECTED, WEAK, WEAK, HeaterReport(Heater.DEAD, 1.0, 0.0), HEALTHY)]


def test_a_fault_found_soon_counts_from_the_beginning_of_heating_on():
    shares, sentence = shares_of(*REPORTS)
    assert shares == [1.0, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 0.0, 1.0]
    assert 'no heat for its command' in sentence and '1970-01-01 00:00:01' in sentence


def test_a_fault_found_late_counts_from_the_suspicion_on():
    """Suspected for 2 s when it is reported after an hour of heating."""
    late = [(None, HEALTHY)] * 3600
    shares, _ = shares_of(*late, *REPORTS[1:])
    assert shares[3598:] == [1.0, 1.0, 1.0, 1.0, 0.4, 0.4, 0.4, 0.4, 0.0, 1.0]


def test_the_answers_of_the_controller_come_before_the_estimate():
    shares, sentence = shares_of(
        answer(4000.0, 4000.0), answer(4000.0, 1000.0), answer(4000.0, 4000.0, measured_w=3000.0),
        # Neither a request of 0 W nor a rising power says anything.
        answer(0.0, 0.0), answer(4000.0, 500.0, refusal=Refusal.RATE_LIMITED),
        answer(0.0, 0.0, refusal=Refusal.LOW_CHARGE), answer(4000.0, 4000.0, doubt='it lies'))
    assert shares == [1.0, 0.25, 0.75, 0.75, 0.75, 0.0, 1.0]
    assert shares_of(answer(4000.0, 4000.0)) == ([1.0], '') and sentence


@pytest.mark.parametrize('recorded, command_w, share, expected', [
    # Requested, active and measured power [W], refusal.
    ((0.0, 0.0, None, Refusal.NO_COMMAND), 3000.0, 0.5, (3000.0, 1500.0, 0.0, Refusal.NOT_REFUSED)),
    ((4000.0, 4000.0, 2000.0, Refusal.NOT_REFUSED), 0.0, 0.5, (0.0, 0.0, 0.0, Refusal.NOT_REFUSED)),
    ((4000.0, 4000.0, 2000.0, Refusal.NOT_REFUSED), 3000.0, 0.5, (3000.0, 3000.0, 1500.0, Refusal.NOT_REFUSED)),
    ((0.0, 0.0, 0.0, Refusal.HOT_BATTERY), 3000.0, 0.0, (3000.0, 0.0, 0.0, Refusal.HOT_BATTERY))])
def test_answers_are_those_to_the_changed_command(recorded, command_w, share, expected):
    requested_w, active_w, measured_w, refusal = recorded
    message = HvchStatus(
        requested_power=requested_w, active_power=active_w, measured_power=measured_w or 0.0,
        measured_power_known=measured_w is not None, refusal=int(refusal))
    alter_status(message, command_w, share)
    assert (message.requested_power, message.active_power, message.measured_power, message.refusal) == expected


@pytest.mark.deep
@pytest.mark.parametrize(('before_c', 'after_c', 'faults'), [
    (14.0, 18.0, ()), (20.0, 15.0, ()), (20.0, 16.0, (HeaterFault(0.0, share=0.0, source='heat_pump'),))])
def test_what_if_agrees_with_a_drive_of_several_heat_sources(tmp_path, before_c, after_c, faults):
    """
    The heat pump gives 2.3 times its power; counted as the HVCH's, the battery would be degrees off.

    test_other_recordings.py asks a short drive daily.
    """
    for folder, wanted_c in (('before', before_c), ('after', after_c)):
        record_drive(tmp_path / folder, wanted_c, LONG_S, vehicle='heat_pump_car', heater_faults=faults)
    flight = read_flight(tmp_path / 'before')
    before, actual = replay(flight), replay(read_flight(tmp_path / 'after')).course
    assert bool(faults) == ('the recorded heat_pump gave no heat' in before.heater.sentence)
    changes = Changes(signals=(SignalChange('target', 1.0, after_c - before_c),))
    changed = replay_changed(flight, changes, heater=before.heater)
    # A dead source is found after some minutes; by then the two drives have tried other mixes.
    assert changed.arrival.measured_c == pytest.approx(actual.arrival.measured_c, abs=0.8 if faults else 0.3)
    assert changed.energy_wh == pytest.approx(actual.energy_wh, abs=40.0 if faults else 10.0)
    assert abs(before.course.energy_wh - actual.energy_wh) > 100.0


@pytest.mark.deep
@pytest.mark.parametrize('target_c', [14.0, 11.0])
def test_what_if_agrees_with_a_weak_heater_that_was_driven_so(tmp_path, target_c):
    """
    With the whole command counted, the changed drive would be too cold by most of the saved heat.

    The instants of heating differ by up to a step of the plan: a kelvin is worth some 480 Wh of this heater's
    commands, and 0.05 K move the start by a step, as the Joule heat of a colder battery does. Readings in steps
    of half a kelvin would move it further, so these have 0.01 K. The temperature tells the energy.
    """
    share, vehicle = 0.25, load_vehicle('reference')
    weak = {'heater_faults': (HeaterFault(0.0, share=share),), 'resolution_k': 0.01}
    for folder, wanted_c in (('before', LONG_TARGET_C), ('after', target_c)):
        record_drive(tmp_path / folder, wanted_c, LONG_S, **weak)
    flight = read_flight(tmp_path / 'before')
    before, actual = replay(flight), replay(read_flight(tmp_path / 'after')).course
    assert 'only 25 % of its command' in before.heater.sentence
    changes = Changes(signals=(SignalChange('target', 1.0, target_c - LONG_TARGET_C),))
    changed = replay_changed(flight, changes, heater=before.heater)
    whole = replay_changed(flight, changes)
    more_wh = changed.energy_wh - actual.energy_wh
    assert abs(more_wh) < FULL_STEP_WH + 1.0
    warmer_k = share * vehicle.hvch.efficiency * 3600.0 * more_wh / vehicle.battery.heat_capacity_j_per_k
    assert changed.arrival.measured_c - actual.arrival.measured_c == pytest.approx(warmer_k, abs=0.03)
    # The saved commands of both: counted whole, and as driven; the colder battery has some more Joule heat.
    too_cold_k = vehicle.hvch.efficiency * 3600.0 / vehicle.battery.heat_capacity_j_per_k * (
        before.course.energy_wh - whole.energy_wh - share * (before.course.energy_wh - actual.energy_wh))
    assert too_cold_k > 4.0
    assert actual.arrival.measured_c - whole.arrival.measured_c == pytest.approx(too_cold_k, rel=0.08)


def test_an_unknown_reading_leaves_the_difference_known():
    response = BatteryResponse(load_vehicle('reference'))
    for second, (soc, temperature_c) in enumerate([(0.5, 20.0), (nan, nan), (0.5, 20.0)]):
        response.advance(second * NS_PER_S, 1000.0, 2000.0, soc, temperature_c)
    assert response.power_w == 1000.0 and -1e-4 < response.soc < 0.0
    # 2 kW of heat for two seconds in some 380 kJ/K.
    assert response.temperature_k == pytest.approx(2000.0 * 0.87 * 2.0 / 380e3, rel=0.03)


@pytest.mark.parametrize('air_c, heat_per_watt', [(-10.0, 2.0), (nan, 2.5)])
def test_a_source_brings_its_own_heat_within_its_power(air_c, heat_per_watt):
    """The vehicle file's table for a battery of 0 degC; without a route the air is as warm as the battery."""
    drawn_w, heat_w = SourceHeat(load_vehicle('heat_pump_car')).of(
        {'hvch': 100.0, 'heat_pump': 4000.0, 'unknown': 500.0}, air_c, 0.0)
    assert drawn_w == 2600.0 and heat_w == pytest.approx(100.0 + 2500.0 * heat_per_watt / 0.9)
