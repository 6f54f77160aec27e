# SPDX-License-Identifier: Apache-2.0
"""Boundary values: the behaviour exactly at a limit, and just beyond it."""

from dataclasses import replace

import pytest

from bev_preheat.control.events import BatteryStateArrived, PreheatingSwitched, RouteArrived
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.inbox import Inbox, NO_CHANGES
from bev_preheat.control.inputs import check_mission, in_planning_steps, Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.step import StepOutput
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
NOW_NS = 1_700_000_000 * NS_PER_S
STATE = BatteryState(-7.0, 0.8)


def leg(**changes):
    columns = {'duration_s': [30.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
               'ambient_temperature_c': [-7.0]}
    return Leg(make_route({**columns, **changes}, VEHICLE.defaults), NOW_NS, True, 25.0)


@pytest.mark.parametrize('back_ns, restarted', [
    (0, False), (NS_PER_S // 2, False), (NS_PER_S, False), (NS_PER_S + 1, True),
    (40 * NS_PER_S, True)])
def test_a_clock_that_falls_back_by_more_than_a_second_was_restarted(back_ns, restarted):
    inbox, _ = Inbox(VEHICLE, Settings()).taken(BatteryStateArrived(Measurement(STATE, NOW_NS)), NOW_NS)
    # With the previous stamp, because stamps must not go back unless the clock does.
    measurement = Measurement(STATE, NOW_NS - back_ns if restarted else NOW_NS)
    inbox, _ = inbox._replace(changes=NO_CHANGES).taken(BatteryStateArrived(measurement), NOW_NS - back_ns)
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


def test_what_is_forced_off_keeps_no_power():
    switch = HeaterSwitch().asked(NOW_NS, 3e3, 5e3, 20.0, 120.0).forced_off()
    assert not switch.is_on
    assert switch.asked(NOW_NS, 0.0, 5e3, 20.0, 120.0).power_w == 0.0
    # It leaves no waiting time either.
    assert switch.asked(NOW_NS, 2e3, 5e3, 20.0, 120.0).power_w == 2e3


@pytest.mark.parametrize('voltage_v, current_a, power_w', [
    (360.0, 50.0, 18e3), (360.0, -50.0, -18e3), (360.0, 0.0, 0.0), (None, 50.0, None),
    (360.0, None, None), (None, None, None)])
def test_power_is_known_where_voltage_and_current_are(voltage_v, current_a, power_w):
    assert Measurement(STATE, NOW_NS, voltage_v, current_a).power_w == power_w


@pytest.mark.parametrize('after_ns, ended_for_s, ahead_s', [
    (-NS_PER_S // 2, -1200.5, 1200.0), (0, -1200.0, 1200.0), (NS_PER_S // 4, -1199.75, 1199.75),
    (1199 * NS_PER_S + NS_PER_S // 2, -0.5, 0.5), (1200 * NS_PER_S, 0.0, None),
    (1200 * NS_PER_S + NS_PER_S // 2, 0.5, None)])
def test_what_is_left_of_a_leg(after_ns, ended_for_s, ahead_s):
    drive = leg()
    assert drive.ended_for_s(NOW_NS + after_ns) == ended_for_s
    ahead = drive.route_ahead(NOW_NS + after_ns)
    assert (ahead.total_duration_s if ahead else None) == (
        None if ahead_s is None else pytest.approx(ahead_s, abs=1e-9))
    # Before the start: the whole route, unchanged.
    assert (ahead is drive.route) == (after_ns <= 0)


@pytest.mark.parametrize('count, told', [(1, ''), (2, 'leg 2: '), (3, 'leg 3: ')])
def test_the_leg_of_a_problem_is_named_where_there_are_several(count, told):
    legs = [leg() for _ in range(count)]
    legs[-1] = replace(legs[-1], target_temperature_c=99.0)
    with pytest.raises(InvalidInput) as refusal:
        check_mission(VEHICLE, Mission('home', tuple(legs)), 25.0)
    assert str(refusal.value).startswith(told)
    assert str(refusal.value).count('leg ') == bool(told)


def test_a_decision_is_marked_where_its_status_is_another_one():
    supervisor = Supervisor(VEHICLE, Settings(estimation=False))
    marks = []

    def step(after_s, *events):
        output = supervisor.step(NOW_NS + after_s * NS_PER_S, *events)
        if output.decision is not None:
            marks.append((output.decision.status, output.has_new_status))

    step(0, RouteArrived(Mission('home', (leg(),))))
    step(1, RouteArrived(Mission('home', (leg(),))))
    step(2, BatteryStateArrived(Measurement(STATE, NOW_NS + 2 * NS_PER_S)))
    step(3, PreheatingSwitched(False))
    step(4, PreheatingSwitched(False))
    # As time passes, a decision is published only when it changes.
    step(5)
    assert marks == [
        (Status.NO_BATTERY_STATE, True), (Status.NO_BATTERY_STATE, False),
        (marks[2][0], True), (Status.DISABLED, True), (Status.DISABLED, False)]
    assert marks[2][0] is Status.TARGET_UNREACHABLE
    assert not StepOutput().has_new_status


@pytest.mark.parametrize('status', [Status.HEATING, Status.TARGET_UNREACHABLE])
def test_a_command_of_0_w_says_that_it_waits_only_where_it_was_to_heat(status):
    """A heater that was switched off a moment ago waits, regardless of the plan's status."""
    trip, target_c = leg(duration_s=[30.0] * 16), 25.0
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


@pytest.mark.parametrize('duration_s, step_s, count', [(1.0, 30.0, 40), (30.0, 30.0, 40), (1.0, 300.0, 4)])
def test_a_route_is_planned_in_steps_of_the_length_asked_for(duration_s, step_s, count):
    route = leg(duration_s=[duration_s] * round(1200.0 / duration_s)).route
    assert len(in_planning_steps(route, step_s)) == count


@pytest.mark.parametrize('before_ns, heats', [(NS_PER_S // 2, False), (1, False), (0, True)])
def test_a_trip_that_begins_in_a_moment_is_not_heated_for_before_it_does(before_ns, heats):
    """Heating all the way is not even enough."""
    supervisor = Supervisor(VEHICLE, Settings(estimation=False))
    now_ns = NOW_NS - before_ns
    supervisor.step(now_ns, RouteArrived(Mission('home', (leg(),))))
    supervisor.step(now_ns, BatteryStateArrived(Measurement(STATE, now_ns)))
    assert (supervisor.state.latest_command.battery_heating_power_w > 0.0) is heats
