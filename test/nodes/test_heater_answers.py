# SPDX-License-Identifier: Apache-2.0
"""Planner and heater_controller together: refusals, clocks that jump, kills; in make test-deep, over DDS, lies."""

import re

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from planner_car import driving, has_entry, LEASE_S, QUICK
from rosgraph_msgs.msg import Clock

from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan

HEATER = ('-p', f'command_deadline:={LEASE_S + 1.0}')


def is_heating(status):
    return status.active_power > 0.0


def test_refusal_is_in_the_plan_and_in_one_entry(rehearsal, car_with_gates):
    plans = rehearsal.record(PreheatPlan, 'preheat_plan', 100)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 100)
    with driving(rehearsal):
        # The fed battery is at 80 %, and the planner's own file does not know the gate.
        rehearsal.start('planner', *QUICK)
        plans.wait_for(lambda plan: plan.status in (PreheatPlan.HEATING, PreheatPlan.TARGET_UNREACHABLE))
        rehearsal.start('heater_controller', *HEATER, '-p', 'battery_state_timeout:=60.0', '-p',
                        f'vehicle:={car_with_gates("minimum_soc: 0.95")}')
        plan = plans.wait_for(lambda plan: plan.explanation.startswith(
            'The heater does not heat (LOW_CHARGE): the state of charge is 80.0 %'))
        assert plan.status == PreheatPlan.TARGET_UNREACHABLE
        assert plan.hvch_electric_energy == 0.0
        diagnostics.wait_for(has_entry('planner: heater status', 'LOW_CHARGE', DiagnosticStatus.WARN))


# A step of the planner's clock [s]; the messages of planner and heater controller.
CLOCK_STEPS = [
    (3600, r'INVALID_INPUT: battery_state refused: header.stamp: the state is 3[56]\d\d(\.\d+)? s old; ',
     r'INVALID_LEASE: header.stamp: is 3[56]\d\d\.\d+ s ahead of the clock; '),
    (-3600, r'INVALID_INPUT: battery_state refused: header.stamp: the state is 3[56]\d\d(\.\d+)? s ahead of the ',
     r'INVALID_LEASE: valid_until: is 3[56]\d\d\.\d+ s in the past')]


def is_only_error(name, text):
    """Return a condition: a node's diagnostics have one ERROR, with this name and text."""
    def condition(array):
        errors = [status for status in array.status if status.level == DiagnosticStatus.ERROR]
        return [status.name for status in errors] == [name] and re.match(text, errors[0].message)
    return condition


def test_clock_steps_and_kills_of_planner_and_heater_end_in_0_w_and_heat_again(rehearsal):
    statuses = rehearsal.record(HvchStatus, 'hvch_status', 100)
    commands = rehearsal.record(HvchCommand, 'hvch_command', 100)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 100)
    clock, ahead_ns = rehearsal.publisher(Clock, '/clock', 10), [0]
    tick = rehearsal.repeating(
        lambda: clock.publish(Clock(clock=time_message(rehearsal.now_ns + ahead_ns[0]))), 0.05)
    with driving(rehearsal), tick:
        # Its clock may jump, and that of the car does not.
        planner = rehearsal.start('planner', *QUICK, '-p', 'use_sim_time:=true')
        heater = rehearsal.start('heater_controller', *HEATER)
        statuses.wait_for(is_heating, 'heat')
        for step_s, planner_says, heater_says in CLOCK_STEPS:
            diagnostics.clear()
            ahead_ns[0] = step_s * NS_PER_S
            diagnostics.wait_for(is_only_error('planner: preheating', planner_says), planner_says)
            diagnostics.wait_for(is_only_error('heater_controller: command', heater_says), heater_says)
            statuses.clear()
            assert not any(map(is_heating, statuses.wait_for_count(4)))
            ahead_ns[0] = 0
            statuses.wait_for(is_heating, 'heat after the clock is right again')
        planner.kill()
        statuses.clear()
        ended = statuses.wait_for(lambda status: status.refusal == HvchStatus.NO_COMMAND)
        assert not is_heating(ended)
        lease_end_ns = max(nanoseconds(command.valid_until) for command in commands.messages)
        assert not any(is_heating(status) and nanoseconds(status.header.stamp) > lease_end_ns
                       for status in statuses.messages)
        rehearsal.start('planner', *QUICK)
        statuses.clear()
        statuses.wait_for(is_heating, 'heat again')
        heater.kill()
        statuses.clear()
        rehearsal.start('heater_controller', *HEATER)
        statuses.wait_for(is_heating, 'heat of the second controller')
