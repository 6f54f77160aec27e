# SPDX-License-Identifier: Apache-2.0
"""Unforeseen exceptions, injected into the planner's own functions: in doubt the heater is off and stays off."""

from itertools import count

from builtin_interfaces.msg import Time
import pytest
from rehearsed_planner import RehearsedPlanner
from sensor_msgs.msg import BatteryState

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import RoutePlan

START_S = 1_700_000_000


@pytest.fixture
def planner(rehearsal):
    return RehearsedPlanner(rehearsal, START_S * NS_PER_S)


def short_route():
    """Return a route of 20 min, too short to reach 25 degC: heats at once."""
    message = RoutePlan(
        route_id='home', segment_duration=[30.0] * 40, speed=[20.0], propulsion_power=[20e3],
        ambient_temperature=[-7.0], charging_planned=True, target_battery_temperature=25.0)
    message.header.stamp = Time(sec=START_S)
    return message


def give_state(planner, second):
    """Publish a cold battery's state, measured this time after the start [s], at that instant."""
    planner.set_clock((START_S + second) * NS_PER_S)
    message = BatteryState(temperature=-7.0, percentage=0.8)
    message.header.stamp = Time(sec=START_S + second)
    planner.give(message)


def command(planner):
    return planner.commands.latest.battery_heating_power, Status(planner.commands.latest.reason)


def after_state(planner, second):
    give_state(planner, second)
    return command(planner)


def after_pause(planner, second):
    """Return the command 10 s after a failure, 1 s before `second`; until then there is no heat."""
    for pausing in range(second, second + 9):
        assert after_state(planner, pausing)[0] == 0.0
    return after_state(planner, second + 9)


def fail(*_, **__):
    raise ZeroDivisionError('by chance')


@pytest.mark.parametrize('where', [
    'messages.battery_state.measurement_from_message', 'control.inbox.check_situation',
    'control.forecast_plan.plan_preheating', 'nodes.planner_node.plan_message'])
def test_an_exception_that_nobody_foresaw_switches_off_until_states_are_valid_again(
        planner, monkeypatch, where):
    planner.give(short_route())
    heats = after_state(planner, 0)
    assert heats[0] > 5000.0
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(f'bev_preheat.{where}', fail)
        assert after_state(planner, 1) == (0.0, Status.INTERNAL_ERROR)
    planner.repeat()
    assert 'ZeroDivisionError: by chance' in planner.plans.latest.explanation
    assert after_pause(planner, 2) == heats


@pytest.mark.parametrize('where', [
    'plan_message', 'temperature_message', 'planner_diagnostics', 'PlannerLog.log_findings'])
def test_what_fails_after_the_command_each_time_lets_no_heat_through_in_between(planner, monkeypatch, where):
    planner.give(short_route())
    assert after_state(planner, 0)[0] > 5000.0
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(f'bev_preheat.nodes.planner_node.{where}', fail)
        planner.repeat()
        give_state(planner, 1)
        planner.commands.clear()
        for second in range(2, 6):
            give_state(planner, second)
            planner.repeat()
    powers_w = [command.battery_heating_power for command in planner.commands.messages]
    assert powers_w == [0.0] * len(powers_w)
    assert len(powers_w) >= 8
    assert after_pause(planner, 6)[0] > 5000.0


def test_where_no_command_can_be_made_no_exception_leaves_a_callback(planner, monkeypatch):
    planner.give(short_route())
    heats = after_state(planner, 0)
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr('bev_preheat.nodes.planner_node.command_message', fail)
        given = len(planner.commands.messages)
        give_state(planner, 1)
        planner.repeat()
        planner.give(short_route())
        # No command was sent: the lease of the previous command ends.
        assert len(planner.commands.messages) == given
    assert after_pause(planner, 2) == heats


@pytest.mark.parametrize('failing', [1, 2])
def test_the_last_words_are_off_and_all_else_is_done_where_one_of_them_fails(planner, monkeypatch, failing):
    from bev_preheat.nodes import planner_node

    planner.give(short_route())
    assert after_state(planner, 0)[0] > 5000.0
    calls, saved, command_message = count(1), [], planner_node.command_message

    def fail_now_and_then(*arguments):
        if next(calls) == failing:
            fail()
        return command_message(*arguments)

    monkeypatch.setattr(planner_node, 'command_message', fail_now_and_then)
    monkeypatch.setattr(
        'bev_preheat.nodes.state_keeper.StateKeeper.save', lambda keeper, state: saved.append(state))
    monkeypatch.setattr('bev_preheat.nodes.prepare_action.PrepareAction.shut_down', fail)
    planner.process.end()
    assert planner.commands.latest.battery_heating_power == 0.0
    assert len(saved) == 1


def test_a_route_at_which_the_planner_fails_is_not_told_as_taken(planner, monkeypatch):
    planner.give(short_route())
    assert planner.process.output().count("Route 'home': ") == 1
    monkeypatch.setattr('bev_preheat.control.inbox.check_mission', fail)
    planner.give(short_route())
    assert planner.process.output().count("Route 'home': ") == 1
    assert command(planner)[1] is Status.INTERNAL_ERROR
