# SPDX-License-Identifier: Apache-2.0
"""The gate between plans and the heater: forbidden heat, limits, least times, pauses, and their words."""

from dataclasses import replace

import numpy as np
import pytest
from steady_drives import at, measured, moment_of, NOW_NS, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.command import Commander
from bev_preheat.control.heater_switch import HeaterSwitch, HeatingPause
from bev_preheat.control.settings import Settings
from bev_preheat.planning.status import Status
from bev_preheat.tunables import MOST_SWITCH_ONS

HEATING = HeaterSwitch().asked(NOW_NS, 5e3, 5e3, 0.0, 0.0)


def heating_state(vehicle=VEHICLE):
    """Return the State of a planner that heats with the 5500 W that the cabin leaves, at NOW_NS."""
    planner = Stepwise(vehicle, Settings(estimation=False, minimum_on_time_s=60.0))
    planner.accept_mission(steady_mission())
    planner.accept_battery(measured(), NOW_NS)
    return planner.state


@pytest.mark.parametrize('changes', [
    {'status': Status.NO_CHARGING_PLANNED}, {'status': Status.NOT_WORTH_IT}, {'plan_start_ns': at(1.001)}],
    ids=['no charging', 'not worth it', 'before the trip'])
def test_a_plan_that_must_not_heat_ends_the_least_time_on(changes):
    state = heating_state()
    moment = moment_of(state, now_ns=at(1.0))
    heats, changed = (state.commander.give(moment, decision, None)[1] for decision in (
        state.decision, replace(state.decision, **changes)))
    assert heats.battery_heating_power_w == pytest.approx(5500.0)
    assert (changed.battery_heating_power_w, changed.reason) == (0.0, changes.get('status', heats.reason))


def test_a_plan_that_has_ended_heats_no_more():
    state = heating_state()
    ended_s = state.decision.plan.arrival_time_s
    commands = [state.commander.give(moment_of(state, now_ns=at(after_s)), state.decision, None)[1]
                for after_s in (ended_s - 1.0, ended_s)]
    assert [command.reason for command in commands] == [state.decision.status, Status.ARRIVED]
    assert [command.battery_heating_power_w for command in commands] == [pytest.approx(5500.0), 0.0]


@pytest.mark.parametrize('planned_w, share, steps_w, power_w', [
    *((share * 4000.0, share, (1500.0, 4000.0), 4000.0) for share in (0.54, 0.81, 1.0)),
    (5500.001, 1.0, (), 5500.0)], ids=['step, 54 %', 'step, 81 %', 'step', 'left by the cabin'])
def test_a_plan_whose_power_rounds_beside_a_limit_is_given_the_limit(planned_w, share, steps_w, power_w):
    # In all cases but the whole step it rounds to another power.
    assert share == 1.0 or planned_w / share < power_w
    state = heating_state(replace(VEHICLE, heating_gates=replace(VEHICLE.heating_gates, power_steps_w=steps_w)))
    plan = replace(state.decision.plan, hvch_battery_power_w=np.full(40, planned_w))
    _, command = state.commander.give(
        state.moment, replace(state.decision, plan=plan, command_share=share), None)
    assert command.battery_heating_power_w == power_w


@pytest.mark.parametrize('sentence, cause', [
    ('Signal in doubt: current.', 'A signal was in doubt'), ('', 'The input was refused')])
def test_a_pause_names_the_input_that_interrupted_heat(sentence, cause):
    paused, _ = Commander(HEATING).off(at(1.0), Settings(), Status.INVALID_INPUT, sentence)
    assert paused.switch.pause.cause == cause


@pytest.mark.parametrize('reason, waits', [
    (Status.WAITING, True), (Status.OUT_OF_CHARGE, True), (Status.NOT_WORTH_IT, True), (Status.DISABLED, False),
    (Status.NO_ROUTE, False), (Status.ARRIVED, False), (Status.NO_CHARGING_PLANNED, False)])
def test_the_least_time_off_begins_only_with_an_off_by_a_plan(reason, waits):
    switch = Commander(HEATING).off(at(1.0), Settings(), reason)[0].switch
    assert [switch.asked(at(second), 5e3, 5e3, 0.0, 120.0).power_w for second in (2.0, 121.0)] == [
        0.0 if waits else 5e3, 5e3]


RESTS = HEATING.turned_off(NOW_NS)
# Switched on too often within an hour.
WORN_OUT = HeaterSwitch(pause=HeatingPause(NOW_NS, switch_ons=(0,) * MOST_SWITCH_ONS))


@pytest.mark.parametrize('switch, status, reason, shown', [
    (RESTS, Status.HEATING, Status.WAITING, Status.WAITING),
    (RESTS, Status.TARGET_UNREACHABLE, Status.TARGET_UNREACHABLE, Status.TARGET_UNREACHABLE),
    (WORN_OUT, Status.TARGET_UNREACHABLE, Status.WAITING, Status.TARGET_UNREACHABLE)],
    ids=['heats', 'misses its target', 'worn out'])
def test_a_command_of_0_w_says_that_the_heater_waits_where_it_was_to_heat(switch, status, reason, shown):
    state = heating_state()
    moment, decision = moment_of(state, now_ns=at(1.0)), replace(state.decision, status=status)
    commander, command = Commander(switch, Status.STALE_INPUT).give(moment, decision, None)
    _, told = commander.in_words(moment, decision)
    assert (command.battery_heating_power_w, command.reason, told.status) == (0.0, reason, shown)
