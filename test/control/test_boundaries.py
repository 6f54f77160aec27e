# SPDX-License-Identifier: Apache-2.0
"""Boundary values, and the rules of gate and inbox: behaviour exactly at a limit, and just beyond it."""
from dataclasses import replace

import numpy as np
import pytest
from steady_drives import at, measured, NOW_NS, steady_leg, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.command import Commander
from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status

STATE = BatteryState(-7.0, 0.8)


@pytest.mark.parametrize('back_ns, restarted', [
    (0, False), (NS_PER_S // 2, False), (NS_PER_S, False), (NS_PER_S + 1, True),
    (40 * NS_PER_S, True)])
def test_a_clock_that_falls_back_by_more_than_a_second_was_restarted(back_ns, restarted):
    inbox, _ = Inbox(VEHICLE, Settings()).taken(BatteryStateArrived(Measurement(STATE, NOW_NS)), NOW_NS)
    assert not inbox.changes.clock_restarted
    # With the previous stamp, because stamps must not go back unless the clock does.
    measurement = Measurement(STATE, NOW_NS - back_ns if restarted else NOW_NS)
    inbox, _ = inbox.taken(BatteryStateArrived(measurement), NOW_NS - back_ns)
    assert inbox.changes.clock_restarted is restarted
    assert inbox.measurement == measurement


def test_the_least_power_switches_the_heater_on_and_none_does_not():
    switch = HeaterSwitch().asked(NOW_NS, 0.5, 5e3, 0.0, 0.0)
    assert (switch.is_on, switch.power_w) == (True, 0.5)
    switch = switch.asked(NOW_NS + 1, 0.0, 5e3, 0.0, 0.0)
    assert (switch.is_on, switch.power_w) == (False, 0.0)
    # A goal below 0 means no heating.
    switch = switch.asked(NOW_NS + 2, -1.0, 5e3, 0.0, 0.0)
    assert (switch.is_on, switch.power_w) == (False, 0.0)


@pytest.mark.parametrize('later_ns, power_w', [
    (0, 3e3), (1, 3e3), (20 * NS_PER_S - 1, 3e3), (20 * NS_PER_S, 0.0), (-1, 0.0)])
def test_the_least_time_on_lasts_from_the_very_instant_to_its_end(later_ns, power_w):
    switch = HeaterSwitch().asked(NOW_NS, 3e3, 5e3, 20.0, 120.0)
    assert switch.asked(NOW_NS + later_ns, 0.0, 5e3, 20.0, 120.0).power_w == power_w


@pytest.mark.parametrize('before_ns, heats', [(NS_PER_S // 2, False), (1, False), (0, True)])
def test_a_trip_that_begins_in_a_moment_is_not_heated_for_before_it_does(before_ns, heats):
    """Heating all the way is not even enough."""
    supervisor = Supervisor(VEHICLE, Settings(estimation=False))
    now_ns = NOW_NS - before_ns
    supervisor.step(now_ns, RouteArrived(steady_mission()))
    supervisor.step(now_ns, BatteryStateArrived(Measurement(STATE, now_ns)))
    assert (supervisor.state.latest_command.battery_heating_power_w > 0.0) is heats


# The gate


def test_after_twenty_switch_ons_the_next_one_comes_an_hour_after_the_first():
    switch = HeaterSwitch()
    for number in range(20):
        switch = switch.asked(at(180.0 * number), 5e3, 5e3, 0.0, 0.0)
        assert switch.power_w == 5e3
        switch = switch.asked(at(180.0 * number + 90.0), 0.0, 5e3, 0.0, 0.0)
        assert switch.power_w == 0.0
    switch = switch.asked(at(3599.999), 5e3, 5e3, 0.0, 0.0)
    assert switch.power_w == 0.0
    assert switch.pause.left_s == pytest.approx(0.001)
    assert switch.asked(at(3600.0), 5e3, 5e3, 0.0, 0.0).power_w == 5e3


@pytest.mark.parametrize('changes', [
    {'status': Status.NO_CHARGING_PLANNED}, {'status': Status.NOT_WORTH_IT}, {'plan_start_ns': at(1.001)}],
    ids=['no charging', 'not worth it', 'before the trip'])
def test_a_plan_that_must_not_heat_ends_the_least_time_on(changes):
    planner = Stepwise(VEHICLE, Settings(estimation=False, minimum_on_time_s=60.0))
    planner.accept_mission(steady_mission())
    planner.accept_battery(measured(), NOW_NS)
    state = planner.state
    moment = replace(state.moment, now_ns=at(1.0))
    heats, changed = (state.commander.give(moment, decision, None)[1] for decision in (
        state.decision, replace(state.decision, **changes)))
    assert heats.battery_heating_power_w == pytest.approx(5500.0)
    assert (changed.battery_heating_power_w, changed.reason) == (0.0, changes.get('status', heats.reason))


@pytest.mark.parametrize('sentence, cause', [
    ('Signal in doubt: current.', 'A signal was in doubt'), ('', 'The input was refused')])
def test_a_pause_names_the_input_that_interrupted_heat(sentence, cause):
    heating = Commander(HeaterSwitch().asked(NOW_NS, 5e3, 5e3, 0.0, 0.0))
    paused, _ = heating.off(at(1.0), Settings(), Status.INVALID_INPUT, sentence)
    assert paused.switch.pause.cause == cause


@pytest.mark.parametrize('reason, waits', [
    (Status.WAITING, True), (Status.OUT_OF_CHARGE, True), (Status.NOT_WORTH_IT, True), (Status.DISABLED, False),
    (Status.NO_ROUTE, False), (Status.ARRIVED, False), (Status.NO_CHARGING_PLANNED, False)])
def test_the_least_time_off_begins_only_with_an_off_by_a_plan(reason, waits):
    heating = Commander(HeaterSwitch().asked(NOW_NS, 5e3, 5e3, 0.0, 0.0))
    switch = heating.off(at(1.0), Settings(), reason)[0].switch
    assert [switch.asked(at(second), 5e3, 5e3, 0.0, 120.0).power_w for second in (2.0, 121.0)] == [
        0.0 if waits else 5e3, 5e3]


@pytest.mark.parametrize('share', [0.54, 0.81, 1.0])
def test_a_power_that_rounds_to_less_than_a_step_is_the_step(share):
    assert share == 1.0 or share * 4000.0 / share < 4000.0
    planner = Stepwise(replace(VEHICLE, heating_gates=replace(
        VEHICLE.heating_gates, power_steps_w=(1500.0, 4000.0))), Settings(estimation=False))
    planner.accept_mission(steady_mission())
    planner.accept_battery(measured(), NOW_NS)
    state = planner.state
    plan = replace(state.decision.plan, hvch_battery_power_w=np.full(40, share * 4000.0))
    _, command = state.commander.give(
        state.moment, replace(state.decision, plan=plan, command_share=share), None)
    assert command.battery_heating_power_w == 4000.0


# The inbox


@pytest.mark.parametrize('hint', ['', 'percentage must be 0 ... 1, not 0 ... 100'])
def test_a_value_that_follows_a_refused_one_in_percent_is_refused_too(hint):
    inbox, sentences = Inbox(VEHICLE, Settings()), []
    for second, soc in ((0.0, 1.2), (8.0, 0.8), (9.0, 0.7)):
        inbox, refusal = inbox.taken(BatteryStateArrived(measured(at(second), soc=soc), hint), at(second))
        sentences.append(str(refusal))
    assert hint in sentences[0]
    assert 'percentage: 0.8 follows 1.2, which is on a scale of 100' in sentences[1]
    assert inbox.scale_verdict.since_ns == at(8.0)


@pytest.mark.parametrize('status', [Status.HEATING, Status.TARGET_UNREACHABLE])
def test_a_command_of_0_w_says_that_it_waits_only_where_it_was_to_heat(status):
    """A heater that was switched off a moment ago waits, regardless of the plan's status."""
    trip, target_c = steady_leg(480.0), 25.0
    # So cold that heating all the way misses the target by a tenth of a kelvin, or by a kelvin more.
    cold_c = 10.0
    for _ in range(3):
        cold_c += plan_preheating(VEHICLE, trip.route, BatteryState(cold_c, 0.8),
                                  Goal(target_c)).shortfall_k - 0.1
    cold_c -= status is Status.TARGET_UNREACHABLE
    supervisor = Supervisor(VEHICLE, Settings(
        estimation=False, minimum_on_time_s=0.0, minimum_off_time_s=120.0))
    warm = BatteryState(target_c + 1.0, 0.8)

    def step(after_s, *events):
        supervisor.step(NOW_NS + after_s * NS_PER_S, *events)
        return supervisor.state.latest_command

    def state(after_s, battery):
        return BatteryStateArrived(Measurement(battery, NOW_NS + after_s * NS_PER_S))

    step(0, RouteArrived(Mission('home', (trip,))))
    assert step(0, state(0, BatteryState(cold_c, 0.8))).battery_heating_power_w > 0.0
    assert step(1, state(1, warm)).battery_heating_power_w == 0.0
    # Another status must hold for 10 s. Warmed as if heated meanwhile, or the target would be out of reach.
    for after_s in (2, 12):
        command = step(after_s, state(after_s, BatteryState(cold_c + 0.015 * after_s, 0.8)))
    waits = Status.WAITING if status is Status.HEATING else status
    shown = supervisor.state.decision.status
    assert (command.battery_heating_power_w, command.reason, shown) == (0.0, waits, waits)
