# SPDX-License-Identifier: Apache-2.0
"""The supervisor: the permitted heater power for every state of its inputs; in doubt 0 W."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import problems_of
from steady_drives import at, measured, NOW_NS, ns, outcome, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.decision import Command
from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import goal_of_leg, Measurement
from bev_preheat.control.settings import Settings
from bev_preheat.control.state_bytes import state_bytes
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import METHODS
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

# The effect of the inputs on the command; the estimate is tested in test_estimating.py.
MEASURED = Settings(estimation=False, minimum_on_time_s=0.0, minimum_off_time_s=0.0)
SETTINGS = replace(MEASURED, battery_state_timeout_s=4.0, clock_tolerance_s=0.5, command_lease_s=1.5)
CABIN_W = 1500.0
FULL_POWER_W = 7000.0 - CABIN_W


def make_supervisor(temperature_c=-7.0, stamp_ns=NOW_NS, settings=SETTINGS, **mission):
    """Return a supervisor with valid inputs that has planned at NOW_NS."""
    supervisor = Stepwise(VEHICLE, settings)
    supervisor.accept_mission(steady_mission(**mission))
    supervisor.accept_battery(measured(stamp_ns, temperature_c), NOW_NS)
    return supervisor


def feed(supervisor, now_ns, **measurement):
    supervisor.accept_battery(measured(now_ns, **measurement), now_ns)


def heats_after_pause(supervisor, from_s):
    """Return whether valid states from a second [s] on lead to heat after 10 s, and not before."""
    powers_w = []
    for second in range(12):
        now_ns = at(from_s + second)
        feed(supervisor, now_ns)
        powers_w.append(outcome(supervisor, now_ns)[0])
    assert powers_w[:9] == [0.0] * 9
    return powers_w[-1] > 0.0


# Missing inputs, too little charge, failures

@pytest.mark.parametrize('has_route, has_battery, reason', [
    (False, False, Status.NO_ROUTE), (False, True, Status.NO_ROUTE), (True, False, Status.NO_BATTERY_STATE)])
def test_one_input_alone_does_not_heat(has_route, has_battery, reason):
    supervisor = Stepwise(VEHICLE, SETTINGS)
    if has_route:
        supervisor.accept_mission(steady_mission())
    if has_battery:
        feed(supervisor, NOW_NS)
    assert outcome(supervisor) == (0.0, reason)


@pytest.mark.parametrize('method', METHODS)
def test_a_battery_that_does_not_carry_the_trip_is_not_heated_within_the_least_time_on(method):
    supervisor = make_supervisor(settings=replace(SETTINGS, method=method, minimum_on_time_s=60.0))
    assert outcome(supervisor)[0] == FULL_POWER_W
    # 20 min at 22 kW take 7 kWh, of the pack's 75 some 10 %: the rest is for driving.
    feed(supervisor, at(1.0), soc=0.05)
    assert outcome(supervisor, at(1.0)) == (0.0, Status.OUT_OF_CHARGE)


def test_surplus_goes_to_the_heater_though_the_charge_does_not_carry():
    # At -22 degC the battery may take 3 kW or so; of 30 kW the heater can have the rest.
    supervisor = Stepwise(VEHICLE, SETTINGS)
    supervisor.accept_mission(steady_mission(
        ambient_temperature_c=[-22.0], propulsion_power_w=[-30e3] * 5 + [30e3] * 35))
    feed(supervisor, NOW_NS, temperature_c=-22.0, soc=0.06)
    assert outcome(supervisor) == (FULL_POWER_W, Status.OUT_OF_CHARGE)
    feed(supervisor, at(151.0), temperature_c=-20.0, soc=0.06)
    assert outcome(supervisor, at(151.0)) == (0.0, Status.OUT_OF_CHARGE)


@pytest.mark.parametrize('what', ['planning.planner.plan_case', 'control.forecast_plan.explain'])
def test_an_exception_that_nobody_foresaw_switches_off_and_is_told_once(monkeypatch, what):
    """Raised in a plan, or in its sentence, which is built on reading."""
    def fail(*_, **named):
        raise ZeroDivisionError('by chance')
    supervisor = make_supervisor()
    assert outcome(supervisor)[0] > 0.0
    monkeypatch.setattr(f'bev_preheat.{what}', fail)
    state = BatteryStateArrived(measured(at(1.0), -6.0))
    output = supervisor.step(at(1.0), state)
    assert (output.command, output.failure) == (
        Command(0.0, at(2.5), Status.INTERNAL_ERROR), 'ZeroDivisionError: by chance')
    output = supervisor.step(at(2.0))
    assert (output.command.battery_heating_power_w, output.decision.explanation) == (
        0.0, 'Planning failed: ZeroDivisionError: by chance')


@pytest.mark.parametrize('stage', ['knowledge.Knowledge.seen', 'decision_maker.DecisionMaker.decide'])
def test_nothing_is_lost_or_piles_up_while_a_stage_fails(monkeypatch, stage):
    """A route that arrives then is followed afterwards; battery states that nobody could use are not kept."""
    supervisor = make_supervisor()
    sizes = []
    with monkeypatch.context() as broken:
        def fail(*_):
            raise ZeroDivisionError('by chance')
        broken.setattr(f'bev_preheat.control.{stage}', fail)
        for second in range(1, 12):
            now_ns = at(float(second))
            events = [BatteryStateArrived(measured(now_ns))]
            if second == 5:
                events.append(RouteArrived(replace(supervisor.state.mission, route_id='elsewhere')))
            output = supervisor.step(now_ns, *events)
            assert output.failure and output.command.battery_heating_power_w == 0.0
            sizes.append(len(state_bytes(supervisor.state)))
    assert max(sizes[6:]) <= min(sizes[6:]) + 200
    supervisor.step(at(12.0), BatteryStateArrived(measured(at(12.0))))
    assert not supervisor.state.inbox.changes.measurements
    assert supervisor.state.mission.route_id == 'elsewhere'
    assert supervisor.state.decision.status.meaning.is_of_plan


# The lease

# 3.1 s of the 4 s that a state is fresh leave less than the lease.
@pytest.mark.parametrize('at_s, until_s', [(0.0, 1.5), (0.2, 1.7), (0.7, 2.2), (3.1, 4.0)])
def test_lease_ends_after_its_length_and_no_later_than_the_battery_state_is_stale(at_s, until_s):
    command = make_supervisor().command(at(at_s))
    assert (command.battery_heating_power_w > 0.0, command.valid_until_ns) == (True, at(until_s))


def test_a_command_from_outside_is_0_w_with_a_lease():
    assert Stepwise(VEHICLE, SETTINGS).stop(NOW_NS).command == Command(
        0.0, at(1.5), Status.SHUTTING_DOWN)


# A current that is filled in some of the states

def test_a_current_of_0_between_others_is_not_filled_but_one_that_stays_is():
    supervisor, known_a = Stepwise(VEHICLE, SETTINGS), []
    for second, current_a in enumerate([0.0, 50.0, 0.0, 0.0, 45.0, 0.0, 0.0, 0.0, 0.0]):
        supervisor.accept_battery(replace(measured(at(second)), voltage_v=420.0, current_a=current_a), at(second))
        known_a.append(supervisor.state.measurement.current_a)
    assert known_a == [None, 50.0, None, 0.0, 45.0, None, 0.0, 0.0, 0.0]


# Age

@pytest.mark.parametrize('now_s, power_w, reason', [
    (3.999, FULL_POWER_W, Status.TARGET_UNREACHABLE), (4.0, 0.0, Status.STALE_INPUT),
    # The clock was set back, and the state comes from its future.
    (-0.6, 0.0, Status.STALE_INPUT), (-300.0, 0.0, Status.STALE_INPUT)])
def test_a_battery_state_heats_until_its_timeout_and_never_before_its_stamp(now_s, power_w, reason):
    assert outcome(make_supervisor(), at(now_s)) == (pytest.approx(power_w), reason)


@pytest.mark.parametrize('now_ns, stamp_ns, message', [
    (NOW_NS, NOW_NS - ns(4.25), 'header.stamp: the state is 4.25 s old; at most 4 s are allowed'),
    (NOW_NS, at(0.75), 'header.stamp: the state is 0.75 s ahead of the clock; at most 0.5 s are allowed'),
    # The age is shown finely enough to be beyond the limit.
    (NOW_NS, NOW_NS - ns(4.0) - 1, 'header.stamp: the state is 4.000000001 s old; at most 4 s are allowed'),
    (0, 0, 'use_sim_time is set and no /clock has arrived: time stands at 0')])
def test_a_state_of_another_time_is_refused_by_its_age(now_ns, stamp_ns, message):
    supervisor = Stepwise(VEHICLE, SETTINGS)
    assert problems_of(supervisor.accept_battery, measured(stamp_ns=stamp_ns), now_ns) == [message]


def test_a_stamp_a_little_ahead_of_the_clock_heats_now():
    # Clocks of two computers differ: the heater must not wait for the stamp at every state.
    assert outcome(make_supervisor(stamp_ns=at(0.4)))[0] == pytest.approx(FULL_POWER_W)


def test_stamps_that_go_back_are_refused_and_switch_off():
    # Of a battery that another temperature tells apart; of the same battery it would have been overtaken.
    supervisor = make_supervisor()
    assert problems_of(supervisor.accept_battery, measured(NOW_NS - ns(1.001), 3.0), at(1.0)) == [
        'header.stamp: the state is 1.001 s older than the previous one; stamps must not go back']
    assert outcome(supervisor, at(1.0)) == (0.0, Status.INVALID_INPUT)


@pytest.mark.parametrize('late_s', [1e-9, 0.05, 1.0])
def test_a_state_that_was_overtaken_is_dropped_without_a_word_and_counted(late_s):
    supervisor = make_supervisor()
    power_w, reason = outcome(supervisor)
    assert power_w > 0.0
    for count, after_s in enumerate((0.1, 0.2), start=1):
        supervisor.step_through(at(after_s), BatteryStateArrived(
            measured(NOW_NS - ns(late_s), 20.0)))
        assert supervisor.output.refusals == ()
        assert outcome(supervisor, at(after_s)) == (power_w, reason)
        state = supervisor.state
        assert (state.temperature_c, state.inbox.overtaken_states) == (-7.0, count)


@pytest.mark.parametrize('back_ns, restarted', [
    (0, False), (NS_PER_S // 2, False), (NS_PER_S, False), (NS_PER_S + 1, True), (40 * NS_PER_S, True)])
def test_a_clock_that_falls_back_by_more_than_a_second_was_restarted(back_ns, restarted):
    inbox, _ = Inbox(VEHICLE, Settings()).taken(BatteryStateArrived(measured()), NOW_NS)
    assert not inbox.changes.clock_restarted
    # With the previous stamp, because stamps must not go back unless the clock does.
    measurement = measured(NOW_NS - back_ns if restarted else NOW_NS)
    inbox, _ = inbox.taken(BatteryStateArrived(measurement), NOW_NS - back_ns)
    assert inbox.changes.clock_restarted is restarted
    assert inbox.measurement == measurement


# Refusals


@pytest.mark.parametrize('hint', ['', 'percentage must be 0 ... 1, not 0 ... 100'])
def test_a_value_that_follows_a_refused_one_in_percent_is_refused_too(hint):
    inbox, sentences = Inbox(VEHICLE, Settings()), []
    for second, soc in ((0.0, 1.2), (8.0, 0.8), (9.0, 0.7)):
        inbox, refusal = inbox.taken(BatteryStateArrived(measured(at(second), soc=soc), hint), at(second))
        sentences.append(str(refusal))
    assert hint in sentences[0]
    assert 'percentage: 0.8 follows 1.2, which is on a scale of 100' in sentences[1]
    assert inbox.scale_verdict.since_ns == at(8.0)


@pytest.mark.parametrize('hint', ['', 'percentage must be 0 ... 1, not 0 ... 100'])
def test_a_refused_state_switches_off_and_is_told_by_its_source_until_a_good_one(hint):
    supervisor = make_supervisor()
    before = supervisor.state.measurement
    supervisor.step_through(NOW_NS, BatteryStateArrived(measured(soc=2.0), hint))
    assert outcome(supervisor) == (0.0, Status.INVALID_INPUT)
    assert supervisor.state.measurement is before
    assert supervisor.state.decision.explanation == '; '.join(filter(None, [
        'battery_state refused: state of charge: 2 is not allowed; it must be 0 ... 1', hint]))
    assert heats_after_pause(supervisor, 0.1)


@pytest.mark.parametrize('events', [
    [BatteryStateArrived(measured(NOW_NS - ns(0.5)))], [RouteArrived(steady_mission())],
    [RouteArrived(steady_mission(minimum_arrival_soc=2.0)), RouteArrived(steady_mission())]],
    ids=['overtaken state', 'route', 'refused route and a mended one'])
def test_nothing_but_a_new_state_excuses_a_refused_one(events):
    supervisor = make_supervisor()
    for event in (BatteryStateArrived(measured(soc=2.0)), *events):
        supervisor.step_through(NOW_NS, event)
    assert outcome(supervisor) == (0.0, Status.INVALID_INPUT)


# Time and the route


PATIENT = replace(MEASURED, battery_state_timeout_s=5000.0)


@pytest.mark.parametrize('minimum_off_s, power_w', [(120.0, FULL_POWER_W), (0.0, 0.0)])
def test_noise_does_not_pause_a_heater_that_could_not_be_switched_on_again_in_time(minimum_off_s, power_w):
    supervisor = make_supervisor(temperature_c=20.0, settings=replace(PATIENT, minimum_off_time_s=minimum_off_s))
    plan = supervisor.state.decision.plan
    start_c = float(np.interp(plan.heating_start_s, plan.time_s, plan.battery_temperature_c))
    for later_s, more_k, wanted_w in ((1.0, -0.1, FULL_POWER_W), (2.0, 0.1, power_w)):
        now_ns = at(plan.heating_start_s + later_s)
        feed(supervisor, now_ns, temperature_c=start_c + more_k)
        assert outcome(supervisor, now_ns)[0] == pytest.approx(wanted_w)


def test_time_alone_switches_on_at_full_power():
    supervisor = make_supervisor(temperature_c=20.0, settings=PATIENT)
    start_s = supervisor.state.decision.plan.heating_start_s
    # Within a step, so that the partial step is in it.
    assert 0.0 < start_s % 30.0 < 29.0
    assert [outcome(supervisor, at(start_s + later_s)) for later_s in (-0.001, 0.001)] == [
        (0.0, Status.WAITING), (pytest.approx(FULL_POWER_W), Status.HEATING)]


def test_the_cabin_comes_first_in_each_segment():
    # The cabin takes all, then nearly all, then nothing.
    cabin_w = [7500.0, 6900.0, 0.0] + [CABIN_W] * 37
    supervisor = make_supervisor(cabin_heating_power_w=cabin_w, settings=PATIENT)
    powers_w = [outcome(supervisor, at(at_s))[0] for at_s in (15.0, 45.0, 75.0)]
    assert powers_w == pytest.approx([0.0, 100.0, 7000.0])


@pytest.mark.parametrize('of_route_c, of_settings_c, expected_c', [
    (18.0, 21.0, 18.0), (None, 21.0, 21.0), (None, None, 25.0), (0.0, 21.0, 0.0)],
    ids=['route', 'settings', 'vehicle', 'route_at_zero'])
def test_target_comes_from_route_then_settings_then_vehicle(
        of_route_c, of_settings_c, expected_c):
    settings = replace(MEASURED, target_battery_temperature_c=of_settings_c)
    goal = goal_of_leg(steady_mission(target_temperature_c=of_route_c).legs[0], VEHICLE, settings)
    assert goal.target_temperature_c == expected_c


def test_margin_is_left_on_top_of_the_reserve_that_a_route_asks_for():
    settings = replace(MEASURED, arrival_soc_margin=0.07)
    goals = [goal_of_leg(steady_mission(minimum_arrival_soc=reserve).legs[0], VEHICLE, settings)
             for reserve in (0.0, 0.31, 0.98)]
    # Without a request the reserve is 0; a reserve above 1 cannot be met.
    assert [goal.minimum_arrival_soc for goal in goals] == [0.0, pytest.approx(0.38), 1.0]


@pytest.mark.parametrize('charges', [True, False])
def test_a_battery_that_charges_beside_the_route_is_not_expected_to_warm_as_if_it_were_driven(charges):
    """In 10 min 60 kW give 4.8 kW of drivetrain heat, 7 K; charging at 34 kW gives 0.5 kW of Joule heat, 0.8 K."""
    supervisor, soc, doubted = Stepwise(VEHICLE, Settings()), 0.7, set()
    supervisor.accept_mission(steady_mission(propulsion_power_w=[60e3]))
    for second in range(0, 900, 2):
        power_w, voltage_v = -34e3 if charges and second >= 60 else 62e3, 365.0 + 75.0 * soc + 15.0 * soc**3
        current_a, now_ns = power_w / voltage_v, at(second)
        soc -= 2.0 * current_a / 720e3
        supervisor.accept_battery(Measurement(
            BatteryState(7.0, soc), now_ns, voltage_v - 0.083 * current_a, current_a), now_ns)
        doubted |= {verdict.signal for verdict in supervisor.state.signal_verdicts}
    assert ('battery_temperature' in doubted) == (not charges)
