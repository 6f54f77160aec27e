# SPDX-License-Identifier: Apache-2.0
"""Rules of the gate and of the inbox, one by one: switch-ons of an hour, times left, sentences, scales, counts."""

from dataclasses import replace

import pytest

from bev_preheat.control.admitted import find_obstacle
from bev_preheat.control.command import Commander
from bev_preheat.control.decision import Decision
from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import check_mission, Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
NOW_NS = 1_700_000_000 * NS_PER_S
COLD = BatteryState(-7.0, 0.8)


def at(second):
    return NOW_NS + round(second * NS_PER_S)


def a_leg():
    columns = {'duration_s': [30.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
               'ambient_temperature_c': [-7.0]}
    return Leg(make_route(columns, VEHICLE.defaults), NOW_NS, True, 25.0)


def inbox_with(second, state):
    inbox, _ = Inbox(VEHICLE, Settings()).taken(RouteArrived(Mission('home', (a_leg(),))), NOW_NS)
    inbox, _ = inbox.taken(BatteryStateArrived(Measurement(state, at(second))), at(second))
    return inbox


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


@pytest.mark.parametrize('later_s, left_s', [(0.0, 20.0), (19.5, 0.5), (20.0, 0.0), (500.0, 0.0)])
def test_no_time_is_left_once_the_least_time_has_passed(later_s, left_s):
    switch = HeaterSwitch().asked(NOW_NS, 5e3, 5e3, 20.0, 120.0)
    assert switch.held_for_s(at(later_s), 20.0, 120.0) == left_s


def test_a_managed_node_that_may_not_heat_says_so():
    inputs = inbox_with(0.0, COLD).admitted()._replace(inactive='The node is inactive.')
    obstacle = find_obstacle(inputs, NOW_NS)
    assert (obstacle.status, obstacle.explanation) == (Status.DISABLED, 'The node is inactive.')


def test_a_status_that_is_still_shown_keeps_its_sentence():
    inputs, trip = inbox_with(0.0, COLD).admitted(), a_leg()
    inputs = inputs._replace(measurement=Measurement(COLD, NOW_NS))
    # The target is below the battery's temperature: nothing to heat.
    plan = plan_preheating(VEHICLE, trip.route, COLD, Goal(-20.0))
    waiting = Decision(Status.WAITING, 'Heating starts later.', plan, NOW_NS, trip)
    not_needed = replace(waiting, status=Status.NOT_NEEDED, sentence='No heating is needed.')
    commander, shown = Commander(), []
    for second, decision in ((0.0, waiting), (1.0, not_needed), (2.0, not_needed), (11.5, not_needed)):
        commander, command = commander.give(at(second), inputs, decision, None)
        commander, said = commander.in_words(at(second), inputs, decision)
        assert command.reason is said.status
        shown.append((said.status, said.explanation))
    assert shown == [(Status.WAITING, 'Heating starts later.')] * 3 + [
        (Status.NOT_NEEDED, 'No heating is needed.')]


# The inbox


def refused(inbox, second, soc, hint=''):
    """Return the inbox after a battery state that must be refused, and the sentence."""
    inbox, refusal = inbox.taken(BatteryStateArrived(
        Measurement(BatteryState(-7.0, soc), at(second)), hint), at(second))
    return inbox, str(refusal)


@pytest.mark.parametrize('hint', ['', 'percentage must be 0 ... 1, not 0 ... 100'])
def test_a_value_that_follows_a_refused_one_in_percent_is_refused_too(hint):
    inbox, sentence = refused(Inbox(VEHICLE, Settings()), 0.0, 1.2, hint)
    assert hint in sentence
    inbox, sentence = refused(inbox, 8.0, 0.8, hint)
    assert 'percentage: 0.8 follows 1.2, which is on a scale of 100' in sentence
    inbox, _ = refused(inbox, 9.0, 0.7, hint)
    assert inbox.scale_verdict.since_ns == at(8.0)


def test_each_overtaken_state_counts():
    inbox = inbox_with(0.0, COLD)
    for late_s in (0.3, 0.2, 0.1):
        inbox, _ = inbox.taken(BatteryStateArrived(Measurement(COLD, at(-late_s))), NOW_NS)
    assert inbox.overtaken_states == 3


def test_the_problems_of_all_legs_are_named():
    legs = [replace(a_leg(), target_temperature_c=target_c) for target_c in (98.0, 25.0, 99.0)]
    with pytest.raises(InvalidInput) as refusal:
        check_mission(VEHICLE, Mission('home', tuple(legs)), 25.0)
    assert [problem.partition(':')[0] for problem in refusal.value.problems] == ['leg 1', 'leg 3']
