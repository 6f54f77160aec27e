# SPDX-License-Identifier: Apache-2.0
"""Cooling before a fast charge in the planner's step: chosen if it pays, under the same gate as heat."""

from dataclasses import replace
from itertools import pairwise
import math

import numpy as np
import pytest
from refusals import problems_of
from simulated_drives import drive, with_source
from steady_drives import moment_of, NOW_NS, ns

from bev_preheat.charging.stop import Charger
from bev_preheat.control.command import Commander
from bev_preheat.control.events import BatteryStateArrived, RouteArrived, SourceStatusArrived
from bev_preheat.control.heater import HeaterStatus
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.inputs import check_mission, Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.control.target import TargetSource
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.messages.diagnostics import planner_diagnostics
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.recording.explanation import why
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heater_controller import Refusal

COOLED_THERE = load_vehicle('heat_pump_car')
# Its chiller rests at a charger, so much cooling before it pays.
CAR = replace(COOLED_THERE, charging=replace(COOLED_THERE.charging, cooling=None))
ROUTE = make_route({
    'duration_s': [60.0] * 14, 'speed_mps': [30.0] * 14, 'propulsion_power_w': [18e3] * 14,
    'ambient_temperature_c': [35.0] * 14, 'cabin_heating_power_w': [0.0] * 14, 'auxiliary_power_w': [1500.0] * 14},
    CAR.defaults)
CHILLER_ALONE = {'chiller'}


def driven(until_s=838.0, car=CAR, goal=Goal(math.nan), charger=Charger(150e3, 0.8), start_c=49.0, route=ROUTE,
           sensors=Sensors(period_s=4.0), **how):
    """Yield a Seen for each command of a drive to a charger of 150 kW."""
    return drive(car, DrivePhase(route, goal, charger=charger), BatteryState(start_c, 0.5), until_s,
                 sensors=sensors, **how)


@pytest.mark.parametrize('minimum_on_s', [0.0, 200.0])
def test_it_waits_cools_and_arrives_at_the_chosen_temperature(minimum_on_s):
    steps = list(driven(minimum_on_time_s=minimum_on_s, minimum_off_time_s=minimum_on_s))
    statuses = [seen.decision.status for seen in steps]
    first = next(number for number, seen in enumerate(steps) if seen.command.total_w > 0.0)
    assert Status.WAITING_TO_COOL in statuses[:first] and Status.HEATING not in statuses
    assert statuses[first] is steps[first].command.reason is Status.COOLING
    for seen in steps:
        assert {name for name, _ in seen.command.sources_w} <= CHILLER_ALONE
        # The minimum time on of cooling is no reason to heat.
        assert seen.command.battery_heating_power_w == 0.0 and seen.command.total_w <= 3000.0 + 1e-6
    chosen_c = next(seen.decision.target.target_c for seen in reversed(steps) if seen.decision.target)
    assert 30.0 < chosen_c < 48.0
    plant = steps[-1].car.plant
    assert plant.temperature_c == pytest.approx(chosen_c, abs=0.7)
    assert plant.sources.energy_wh['chiller'] > 100.0


def test_gates_of_heating_do_not_stop_it():
    gated = replace(CAR, heating_gates=replace(CAR.heating_gates, maximum_temperature_c=20.0))
    *_, last = driven(car=gated)
    assert last.car.plant.sources.energy_wh['chiller'] > 100.0


@pytest.mark.parametrize('target_c', [25.0, math.nan])
@pytest.mark.parametrize('charger', [None, Charger(150e3, 0.8)])
def test_a_highest_temperature_on_arrival_is_cooled_to_and_no_further(target_c, charger):
    steps = list(driven(goal=Goal(target_c, maximum_arrival_temperature_c=42.0), charger=charger))
    decision = steps[-1].decision
    assert steps[-1].car.plant.temperature_c == pytest.approx(42.0, abs=0.5)
    assert Status.WAITING_TO_COOL in {seen.decision.status for seen in steps}
    assert decision.target.source is TargetSource.GIVEN and decision.plan.maximum_arrival_temperature_c == 42.0
    if charger is not None:
        # The chiller's energy is bought there.
        assert decision.target.bought_energy_wh > decision.target.unheated_bought_energy_wh + 50.0


def test_the_place_that_joule_heat_warms_most_keeps_the_highest_temperature():
    """The estimate expects 0.35 K/kW there; the prediction is that of the battery."""
    fast = replace(ROUTE, propulsion_power_w=np.full(len(ROUTE), 80e3))
    *_, last = driven(goal=Goal(25.0, maximum_arrival_temperature_c=42.0), charger=None, start_c=45.0, route=fast,
                      until_s=400.0)
    rise_k = last.decision.forecast.local_rise_k
    assert rise_k > 0.2
    assert last.decision.plan.arrival_temperature_c == pytest.approx(42.0 - rise_k, abs=0.1)
    assert last.decision.plan.maximum_arrival_temperature_c == 42.0


@pytest.mark.parametrize('estimation', [True, False])
def test_the_noise_of_a_reading_does_not_interrupt_cooling(estimation):
    """Each interruption would last for the least time off, in which the battery warms by 0.9 K."""
    steps = list(driven(goal=Goal(25.0, maximum_arrival_temperature_c=42.0), charger=None, start_c=45.0,
                        estimation=estimation, sensors=Sensors(period_s=1.0, temperature_noise_k=0.1)))
    assert sum(before.command.total_w == 0.0 < after.command.total_w for before, after in pairwise(steps)) == 1
    assert steps[-1].car.plant.temperature_c == pytest.approx(42.0, abs=0.3)


ON = HeaterSwitch().asked(NOW_NS, 3e3, 3e3, 200.0, 200.0)
HELD, RESTS = ON.asked(NOW_NS + ns(50.0), 0.0, 3e3, 200.0, 200.0), ON.turned_off(NOW_NS)


def planned_at(temperature_c, most_c=42.0, car=CAR):
    """Return a Supervisor that has planned at NOW_NS."""
    supervisor = Supervisor(car, Settings(
        estimation=False, minimum_on_time_s=200.0, minimum_off_time_s=200.0))
    supervisor.step(NOW_NS, RouteArrived(Mission('', (Leg(
        ROUTE, NOW_NS, target_temperature_c=25.0, maximum_arrival_temperature_c=most_c),))))
    supervisor.step(NOW_NS, BatteryStateArrived(Measurement(BatteryState(temperature_c, 0.5), NOW_NS)))
    return supervisor


@pytest.mark.parametrize('temperature_c, most_c, begins, change', [
    (49.0, 42.0, 'in ', 'A warmer battery or a lower highest'),
    (55.0, 25.0, 'now', 'More time, more power for it or')])
def test_the_answer_to_why_speaks_of_cooling(temperature_c, most_c, begins, change):
    sections = why(planned_at(temperature_c, most_c).state, NOW_NS).sections
    assert dict(sections['plan'])['target [degC]'] == f'25.00 … {most_c:.2f}'
    assert dict(sections['plan'])['cooling begins'].startswith(begins)
    (_, sentence), = sections['what would have to change']
    assert sentence.startswith(change)


@pytest.mark.parametrize('commander, status, begin, end', [
    (Commander(HELD, reason=Status.COOLING, cools=True), Status.NOT_NEEDED,
     'The cooling stays on for its minimum time, 150 s more: arrival at ', ', at most 42.0 degC.'),
    (Commander(RESTS, reason=Status.WAITING_TO_COOL), Status.COOLING,
     'The cooling stays off for its minimum time, 150 s more. Cool', ' Sources: chiller.'),
    # Another status has held for a moment only.
    (Commander(ON, reason=Status.COOLING, cools=True, words='As before.'), Status.NOT_NEEDED, 'As before.', '')],
    ids=['held', 'rests', 'moment'])
def test_a_sentence_on_the_least_times_of_cooling_speaks_of_cooling(commander, status, begin, end):
    state = planned_at(49.0).state
    moment = moment_of(state, now_ns=NOW_NS + ns(50.0))
    _, told = commander.in_words(moment, replace(state.decision, status=status))
    assert told.status is commander.reason
    assert told.explanation.startswith(begin) and told.explanation.endswith(end)


@pytest.mark.parametrize('cools, power_w', [(True, 3000.0), (False, 0.0)])
def test_what_heats_rests_before_it_cools(cools, power_w):
    state = planned_at(61.0).state
    commander, command = Commander(ON, cools=cools).give(
        moment_of(state, now_ns=NOW_NS + ns(1.0)), state.decision, None)
    assert (command.power_w('chiller'), commander.direction) == (pytest.approx(power_w), -1 if cools else 0)


@pytest.mark.parametrize('chiller, temperature_c, most_c, planned, power_w, reason', [
    (RESTS, 61.0, math.inf, Status.COOLING, 0.0, Status.WAITING_TO_COOL),
    (ON, 49.0, 42.0, Status.WAITING_TO_COOL, 3000.0, Status.COOLING)], ids=['rests', 'runs'])
def test_the_least_times_of_a_chiller_outlast_the_plan(chiller, temperature_c, most_c, planned, power_w, reason):
    car = with_source(CAR, 'chiller', minimum_on_time_s=300.0, minimum_off_time_s=180.0)
    state = planned_at(temperature_c, most_c, car).state
    assert state.decision.status is planned
    _, command = Commander(sources=(('chiller', chiller),)).give(
        moment_of(state, now_ns=NOW_NS + ns(1.0)), state.decision, None)
    assert (command.total_w, command.power_w('chiller'), command.reason) == (
        pytest.approx(power_w), command.total_w, reason)


@pytest.mark.parametrize('most_c, target_c', [(20.0, None), (24.9, 25.0), (56.0, 25.0)])
def test_a_highest_temperature_below_the_target_or_above_the_battery_s_range_is_refused(most_c, target_c):
    mission = Mission('', (Leg(ROUTE, target_temperature_c=target_c, maximum_arrival_temperature_c=most_c),))
    assert problems_of(check_mission, CAR, mission, 22.0) == [
        f'maximum arrival temperature: {most_c:g} is not allowed; it must be {target_c or 22:g} ... 55 degC, from '
        'the target to the highest temperature']


@pytest.mark.parametrize('estimation', [True, False])
def test_a_battery_above_its_range_is_cooled_at_once(estimation):
    steps = list(driven(goal=Goal(25.0), charger=None, start_c=61.0, estimation=estimation))
    command = steps[5].command
    assert (command.reason, command.power_w('chiller')) == (Status.COOLING, pytest.approx(3000.0))
    # Into its range, and no further.
    assert 54.0 < steps[-1].car.plant.temperature_c <= 55.1


def test_without_a_chiller_a_battery_above_its_range_is_refused_and_told_why():
    alone = replace(CAR, heat_sources=tuple(source for source in CAR.heat_sources if not source.cools))
    *_, last = driven(until_s=20.0, car=alone, start_c=61.0)
    assert last.command.total_w == 0.0
    assert "the range of the vehicle's battery; no heat source cools it" in last.decision.explanation


@pytest.mark.parametrize('share, resolution_k, least_s, words', [
    (0.0, 0.5, 250.0, 'The chiller does not respond to its command.'),
    # A temperature that does not fall is no stuck sensor.
    (0.0, 1.0, 250.0, 'The chiller does not respond to its command.'),
    (0.5, 0.5, 500.0, 'The chiller delivers only 50 % of its command.')])
def test_a_chiller_that_does_not_cool_is_named_and_the_battery_is_as_warm_as_it_is(
        share, resolution_k, least_s, words):
    supervisor, named_s = judged(HeaterFault(0.0, share=share, source='chiller'), resolution_k=resolution_k)
    assert least_s < named_s < least_s + 300.0
    assert supervisor.state.decision.explanation.startswith(words)


def test_a_chiller_that_is_stuck_on_is_named_and_its_cold_is_known():
    supervisor, named_s = judged(HeaterFault(200.0, stuck_on=True, source='chiller'), goal=Goal(
        22.0, maximum_arrival_temperature_c=45.0))
    assert 500.0 < named_s < 830.0
    assert supervisor.state.learning.reports['chiller'].heater is Heater.STUCK_ON


def test_of_two_sources_with_the_same_heat_none_is_named_if_one_is_stuck_on():
    """6 kW of heat come from the pump, and would from the HVCH; the traffic hides the power."""
    route = replace(ROUTE, ambient_temperature_c=np.zeros(len(ROUTE)))
    supervisor, named_s = judged(HeaterFault(200.0, stuck_on=True, source='heat_pump'), route, 5.0, Goal(5.0))
    assert named_s is None
    # None is switched off to tell which.
    assert 'does not heat' not in supervisor.state.decision.explanation


def judged(fault, route=ROUTE, start_c=49.0, goal=Goal(25.0, maximum_arrival_temperature_c=35.0),
           resolution_k=0.5):
    """Return the Supervisor after a drive of a faulty car, and when the source was named [s]."""
    named_s = None
    for seen in driven(goal=goal, charger=None, start_c=start_c, route=route, faults=(fault,), sensors=Sensors(
            period_s=2.0, temperature_noise_k=0.1, temperature_resolution_k=resolution_k)):
        state = seen.planner.state
        assert not state.signal_verdicts
        accused = {name for name, report in state.learning.reports.items() if report.heater is not Heater.ANSWERS}
        assert accused <= {fault.source}
        if accused and named_s is None:
            named_s = seen.at_s
        if seen.at_s > 200.0 and (named_s is not None or not fault.stuck_on):
            # The true temperature is the simulated car's.
            assert abs(state.estimate.temperature_c - seen.car.plant.temperature_c) < (
                1.0 if named_s is None or fault.stuck_on else 0.5)
    return seen.planner, named_s


@pytest.mark.parametrize('estimation', [True, False])
@pytest.mark.parametrize('start_c', [49.0, 61.0])
def test_a_chiller_that_refuses_is_told_by_its_own_words(start_c, estimation):
    told = set()
    for seen in driven(700.0, goal=Goal(25.0, maximum_arrival_temperature_c=42.0), charger=None, start_c=start_c,
                       sensors=Sensors(), estimation=estimation):
        supervisor, now_ns = seen.planner, seen.planner.state.now_ns
        if seen.at_s > 600.0:
            told.add(seen.decision.explanation)
        if 500.0 < seen.at_s < 660.0:
            assert not supervisor.step(now_ns, SourceStatusArrived(HeaterStatus(
                now_ns, 0.0, 0.0, Refusal.HEATER_FAULT, 'no refrigerant'), 'chiller')).refusals
        elif 600.0 < seen.at_s:
            supervisor.step(now_ns, SourceStatusArrived(HeaterStatus(now_ns, 3000.0, 3000.0), 'chiller'))
    words = 'The chiller does not cool (HEATER_FAULT): no refrigerant.'
    assert any(sentence.startswith(words) for sentence in told)
    assert not any('heat_pump' in sentence or 'heater' in sentence for sentence in told)
    entry = next(entry for entry in planner_diagnostics(supervisor.state, supervisor.state.now_ns)
                 if entry.name.endswith('status of chiller'))
    # It serves again.
    assert entry.message == 'the command is served'
    assert supervisor.state.latest_command.power_w('chiller') == pytest.approx(3000.0)


def test_a_chiller_that_refuses_each_command_is_named_between_them_and_serves_again():
    told = {}
    goal = Goal(25.0, maximum_arrival_temperature_c=35.0)
    for seen in driven(400.0, goal=goal, charger=None, sensors=Sensors()):
        now_ns, asked_w = seen.planner.state.now_ns, seen.command.power_w('chiller')
        answer = (0.0, Refusal.OTHER, 'cold oil') if seen.at_s < 200.0 else (asked_w,)
        seen.planner.step(now_ns, SourceStatusArrived(HeaterStatus(now_ns, asked_w, *answer), 'chiller'))
        told[seen.at_s] = seen.decision.explanation
    assert all(told[at_s].startswith('The chiller does not cool (OTHER): cold oil. Without further cooling')
               for at_s in told if 10.0 < at_s < 110.0 or 140.0 < at_s < 200.0)
    assert asked_w > 0.0 and told[seen.at_s].startswith('Cooling')


def test_a_chiller_whose_least_time_exceeds_the_rest_of_the_drive_cools_until_the_arrival():
    car = with_source(CAR, 'chiller', minimum_on_time_s=900.0)
    *_, last = driven(car=car, goal=Goal(25.0, maximum_arrival_temperature_c=42.0), charger=None)
    assert last.car.plant.temperature_c == pytest.approx(42.0, abs=0.7)
