# SPDX-License-Identifier: Apache-2.0
"""Unforeseen exceptions, injected into the planner's own functions: in doubt the heater is off and stays off."""

from itertools import count

from planner_car import PlannerCar
import pytest

from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status

START_S = 1_700_000_000


@pytest.fixture
def planner(rehearsal):
    planner = PlannerCar(rehearsal)
    planner.at(START_S * NS_PER_S)
    planner.start()
    planner.send_route()
    assert after_state(planner, 0)[0] > 5000.0
    return planner


def after_state(planner, second):
    """Return power and reason after a state, measured this time after the start [s], at that instant."""
    command = planner.after_state((START_S + second) * NS_PER_S)
    return command.battery_heating_power, Status(command.reason)


def heats_after_pause(planner, second):
    """Return whether it heats 10 s after a failure, 1 s before `second`; until then there is no heat."""
    for pausing in range(second, second + 9):
        assert after_state(planner, pausing)[0] == 0.0
    return after_state(planner, second + 9)[0] > 5000.0


def fail(*_, **__):
    raise ZeroDivisionError('by chance')


@pytest.mark.parametrize('where', [
    'messages.battery_state.measurement_from_message', 'control.inbox.check_situation',
    'control.forecast_plan.plan_preheating', 'nodes.planner_node.plan_message'])
def test_an_exception_that_nobody_foresaw_switches_off_until_states_are_valid_again(
        planner, monkeypatch, where):
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(f'bev_preheat.{where}', fail)
        assert after_state(planner, 1) == (0.0, Status.INTERNAL_ERROR)
    planner.repeat()
    assert 'ZeroDivisionError: by chance' in planner.plans.latest.explanation
    assert heats_after_pause(planner, 2)


@pytest.mark.parametrize('where', [
    'plan_message', 'temperature_message', 'planner_diagnostics', 'PlannerLog.log_findings'])
def test_what_fails_after_the_command_each_time_lets_no_heat_through_in_between(planner, monkeypatch, where):
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(f'bev_preheat.nodes.planner_node.{where}', fail)
        planner.repeat()
        after_state(planner, 1)
        planner.commands.clear()
        for second in range(2, 6):
            after_state(planner, second)
            planner.repeat()
    powers_w = [command.battery_heating_power for command in planner.commands.messages]
    assert powers_w == [0.0] * len(powers_w)
    assert len(powers_w) >= 8
    assert heats_after_pause(planner, 6)


def test_where_no_command_can_be_made_no_exception_leaves_a_callback(planner, monkeypatch):
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr('bev_preheat.nodes.topics.command_message', fail)
        given = len(planner.commands.messages)
        after_state(planner, 1)
        planner.repeat()
        planner.send_route()
        # No command was sent: the lease of the previous command ends.
        assert len(planner.commands.messages) == given
    assert heats_after_pause(planner, 2)


@pytest.mark.parametrize('failing', [1, 2])
def test_the_last_words_are_off_and_all_else_is_done_where_one_of_them_fails(planner, monkeypatch, failing):
    from bev_preheat.nodes import topics
    calls, saved, command_message = count(1), [], topics.command_message

    def fail_now_and_then(*arguments):
        if next(calls) == failing:
            fail()
        return command_message(*arguments)

    monkeypatch.setattr(topics, 'command_message', fail_now_and_then)
    monkeypatch.setattr(
        'bev_preheat.nodes.state_keeper.StateKeeper.save', lambda keeper, state: saved.append(state))
    monkeypatch.setattr('bev_preheat.nodes.prepare_action.PrepareAction.shut_down', fail)
    planner.process.end()
    assert planner.commands.latest.battery_heating_power == 0.0
    assert len(saved) == 1
