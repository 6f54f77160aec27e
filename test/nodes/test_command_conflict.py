# SPDX-License-Identifier: Apache-2.0
"""Two planners that command the same heater: both stay off until one ends; one pair is over DDS."""

import signal

from diagnostic_msgs.msg import DiagnosticStatus
from planner_car import driving, has_entry, heats, is_off_for, QUICK
import pytest

from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand

# The graph shows a killed node for some 20 s.
GRAPH_FORGETS_S = 20.0
is_in_conflict = is_off_for(Status.COMMAND_CONFLICT)


def in_conflict_until_one_is_gone(bench, end):
    """Start two planners that see each other; `end(the first)`."""
    with driving(bench) as car:
        commands, diagnostics = car.commands, car.diagnostics
        first = bench.start('planner', *QUICK, '-r', '__node:=front')
        commands.wait_for(heats, 'heat of the first')
        bench.start('planner', *QUICK, '-r', '__node:=rear')
        for name, other in (('front', 'rear'), ('rear', 'front')):
            diagnostics.wait_for(has_entry(
                f'{name}: preheating', f'COMMAND_CONFLICT: Heat is also commanded by /{other}',
                DiagnosticStatus.ERROR), f'{name} says so')
        # Commands from before may arrive after the diagnostics.
        bench.wait_until(lambda: len(commands.messages) >= 20
                         and all(map(is_in_conflict, commands.messages[-20:])), 'both in conflict')
        commands.clear()
        assert all(map(is_in_conflict, commands.wait_for_count(20)))
        end(first)
        commands.clear()
        # A lease and one or two checks.
        commands.wait_for(heats, 'heat of the second', timeout_s=GRAPH_FORGETS_S)
        diagnostics.clear()
        diagnostics.wait_for(has_entry('rear: setup', level=DiagnosticStatus.OK))


@pytest.mark.deep
def test_two_installed_planners_stay_off_until_one_is_killed(bench):
    def kill(planner):
        planner.send_signal(signal.SIGKILL)
        planner.wait()
    in_conflict_until_one_is_gone(bench, kill)


def test_two_planners_stay_off_until_one_ends(rehearsal):
    in_conflict_until_one_is_gone(rehearsal, lambda planner: planner.end())


def test_a_stranger_that_commands_switches_the_heater_off(rehearsal):
    with driving(rehearsal) as car:
        commands, plans = car.commands, car.plans
        planner = rehearsal.start('planner', *QUICK)
        commands.wait_for(heats)
        stranger = rehearsal.publisher(HvchCommand, 'hvch_command', 10)
        stranger.wait_for_subscription(2)
        # Advertised but silent: the planner keeps heating.
        commands.clear()
        assert all(map(heats, commands.wait_for_count(20)))

        def is_in_conflict():
            # Messages sent before the planner has discovered the other publisher are lost.
            stranger.publish(HvchCommand(battery_heating_power=1000.0))
            return plans.comes_to(lambda plan: plan.status == Status.COMMAND_CONFLICT, 0.2)

        rehearsal.wait_until(is_in_conflict, 'the conflict')
        plan = plans.wait_for(lambda plan: plan.status == Status.COMMAND_CONFLICT)
        assert plan.explanation == ('Heat is also commanded by /tester; the heater is off '
                                    'until only one is left.')
        plans.clear()
        plans.wait_for(lambda plan: plan.status != Status.COMMAND_CONFLICT)
        commands.clear()
        commands.wait_for(heats, 'heat again')
        assert '/tester also commands heat: the heater is off.' in planner.output()


def test_a_stranger_that_commands_a_heat_source_of_the_vehicle_switches_all_off(rehearsal):
    with driving(rehearsal) as car:
        rehearsal.start('planner', *QUICK, '-p', 'vehicle:=heat_pump_car')
        car.commands.wait_for(heats)
        stranger = rehearsal.publisher(HeatSourceCommand, 'heat_source_command', 10)
        stranger.wait_for_subscription()

        def is_in_conflict(name):
            stranger.publish(HeatSourceCommand(name=name, battery_heating_power=1000.0))
            return car.plans.comes_to(lambda plan: plan.status == Status.COMMAND_CONFLICT, 0.2)
        assert not any(is_in_conflict('cabin_ptc') for _ in range(10))
        rehearsal.wait_until(lambda: is_in_conflict('heat_pump'), 'the conflict')
        stranger.destroy()
        car.commands.clear()
        car.commands.wait_for(heats, 'heat again', timeout_s=GRAPH_FORGETS_S)


def test_two_planners_of_one_name_stay_off_and_name_it(rehearsal):
    with driving(rehearsal) as car:
        commands, diagnostics = car.commands, car.diagnostics
        rehearsal.start('planner', *QUICK)
        rehearsal.start('planner', *QUICK)
        diagnostics.wait_for(has_entry(
            'planner: preheating', 'COMMAND_CONFLICT: Heat is also commanded by another node named /planner',
            DiagnosticStatus.ERROR))
        # One detects the other slightly earlier; together they send 40 commands per second.
        rehearsal.wait_until(lambda: len(commands.messages) >= 40
                             and all(map(is_in_conflict, commands.messages[-40:])), 'both in conflict')
        commands.clear()
        assert all(map(is_in_conflict, commands.wait_for_count(40)))
