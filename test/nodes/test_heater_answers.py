# SPDX-License-Identifier: Apache-2.0
"""Planner and heater_controller together over DDS: a heater that refuses, and processes that are killed."""

import signal
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from test_command_conflict import feeding, LEASE_S, QUICK

from bev_preheat.files.configuration import find_configuration
from bev_preheat.nodes.convert import nanoseconds
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan

HEATER = ('-p', f'command_deadline:={LEASE_S + 1.0}')


@pytest.fixture
def careful_car(tmp_path):
    """Return a vehicle file of a car that heats from 95 % of charge on; the fed battery is at 80 %."""
    path = tmp_path / 'careful.yaml'
    path.write_text(find_configuration('vehicles', 'reference', '.yaml').read_text()
                    + '\nheating_gates: {minimum_soc: 0.95}\n')
    return path


def is_heating(status):
    return status.active_power > 0.0


def test_refusal_is_in_the_plan_and_in_one_entry(bench, careful_car):
    plans = bench.record(PreheatPlan, 'preheat_plan', 100)
    diagnostics = bench.record(DiagnosticArray, '/diagnostics', 100)
    with feeding(bench):
        # The planner's own file does not know the gate.
        bench.start('planner', *QUICK)
        plans.wait_for(lambda plan: plan.status in (PreheatPlan.HEATING, PreheatPlan.TARGET_UNREACHABLE))
        bench.start('heater_controller', *HEATER, '-p', f'vehicle:={careful_car}', '-p',
                    'battery_state_timeout:=60.0')
        plan = plans.wait_for(lambda plan: plan.explanation.startswith(
            'The heater does not heat (LOW_CHARGE): the state of charge is 80.0 %'))
        assert plan.status == PreheatPlan.TARGET_UNREACHABLE
        assert plan.hvch_electric_energy == 0.0
        diagnostics.wait_for(lambda array: any(
            status.name == 'planner: heater status' and status.level == DiagnosticStatus.WARN
            and 'LOW_CHARGE' in status.message for status in array.status))


def test_planner_and_heater_killed_and_restarted_end_in_0_w_and_heat_again(bench):
    statuses = bench.record(HvchStatus, 'hvch_status', 100)
    commands = bench.record(HvchCommand, 'hvch_command', 100)
    with feeding(bench):
        planner, heater = bench.start('planner', *QUICK), bench.start('heater_controller', *HEATER)
        statuses.wait_for(is_heating, 'heat')
        planner.send_signal(signal.SIGKILL)
        planner.wait()
        # NO_COMMAND was also the first answer, before the planner's first command.
        statuses.clear()
        ended = statuses.wait_for(lambda status: status.refusal == HvchStatus.NO_COMMAND)
        assert not is_heating(ended)
        # By the stamps, because on a busy computer messages arrive late.
        lease_end_ns = max(nanoseconds(command.valid_until) for command in commands.messages)
        assert not any(is_heating(status) and nanoseconds(status.header.stamp) > lease_end_ns
                       for status in statuses.messages)
        bench.start('planner', *QUICK)
        statuses.clear()
        statuses.wait_for(is_heating, 'heat again')
        heater.send_signal(signal.SIGKILL)
        heater.wait()
        # The last answer of the first controller may still arrive; the second one's first heat has a later stamp.
        killed_ns = time.time_ns()
        bench.start('heater_controller', *HEATER)
        statuses.wait_for(lambda status: is_heating(status) and nanoseconds(status.header.stamp) > killed_ns,
                          'heat of the second controller')
