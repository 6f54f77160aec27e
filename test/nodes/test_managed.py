# SPDX-License-Identifier: Apache-2.0
"""Managed nodes over DDS, through the real lifecycle services, and locked parameters in this process."""

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_bench import repeating
from planner_car import command_at, driving, heats, QUICK, set_parameters
import pytest
from test_heater_controller import OFFERED

from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan

ACTIVE = 'active'
# Transition, and the state that it leads to, through every state of a managed node.
WAY = (
    (Transition.TRANSITION_CONFIGURE, 'inactive'), (Transition.TRANSITION_ACTIVATE, ACTIVE),
    (Transition.TRANSITION_DEACTIVATE, 'inactive'), (Transition.TRANSITION_ACTIVATE, ACTIVE),
    (Transition.TRANSITION_DEACTIVATE, 'inactive'), (Transition.TRANSITION_CLEANUP, 'unconfigured'),
    (Transition.TRANSITION_CONFIGURE, 'inactive'), (Transition.TRANSITION_ACTIVATE, ACTIVE))


def goes(bench, node, transition):
    request = ChangeState.Request(transition=Transition(id=transition))
    assert bench.call(ChangeState, f'/{node}/change_state', request).success
    return state(bench, node)


def shut_down(bench, node, process):
    """Make the transition `shutdown` of an active node, and return the exit status of its process."""
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVE_SHUTDOWN))
    assert bench.call(ChangeState, f'/{node}/change_state', request).success
    return process.wait()


def state(bench, node):
    return bench.call(GetState, f'/{node}/get_state', GetState.Request()).current_state.label


def test_managed_planner_heats_only_when_active(bench):
    with driving(bench) as car:
        commands, plans = car.commands, car.plans
        process = bench.start('planner', *QUICK, '-p', 'lifecycle:=true')
        commands.wait_for_count(5)
        assert state(bench, 'planner') == 'unconfigured'
        assert plans.wait_for(lambda plan: 'not active' in plan.explanation).status == PreheatPlan.DISABLED
        for transition, expected in WAY:
            assert goes(bench, 'planner', transition) == expected
            commands.clear()
            if expected == ACTIVE:
                commands.wait_for(heats, 'heat')
            else:
                # The first one may have been under way.
                assert not any(map(heats, commands.wait_for_count(10)[1:]))
        assert shut_down(bench, 'planner', process) == 0
        assert (commands.latest.battery_heating_power, commands.latest.reason) == (0.0, Status.SHUTTING_DOWN)


def test_managed_heater_controller_heats_only_when_active(bench):
    statuses = bench.record(HvchStatus, 'hvch_status', 100)
    process = bench.start('heater_controller', '-p', 'lifecycle:=true')
    commands = bench.publisher(HvchCommand, 'hvch_command', OFFERED)
    commands.wait_for_subscription()
    with repeating(lambda: commands.publish(command_at(bench.now_ns, 2500.0)), 0.2):
        statuses.wait_for(lambda status: status.refusal == HvchStatus.NOT_ACTIVE)
        for transition, expected in WAY[:4]:
            assert goes(bench, 'heater_controller', transition) == expected
            statuses.clear()
            if expected == ACTIVE:
                statuses.wait_for(lambda status: status.active_power == 2500.0, 'heat')
            else:
                assert {status.active_power for status in statuses.wait_for_count(3)[1:]} == {0.0}
        assert shut_down(bench, 'heater_controller', process) == 0
        assert (statuses.latest.active_power, statuses.latest.refusal) == (0.0, HvchStatus.NOT_ACTIVE)


@pytest.mark.parametrize('locked', [True, False])
def test_locked_parameters_cannot_be_changed(rehearsal, locked):
    planner = rehearsal.start('planner', '-p', f'locked:={str(locked).lower()}')

    def set_one(name, value):
        return set_parameters(rehearsal, '/planner', **{name: value})

    # The last one would let anybody who publishes /clock set the time of stamps and leases.
    for name, value in (('vehicle', 'small_car'), ('command_lease', 9.0), ('battery_state_timeout', 50.0),
                        ('estimation', False), ('minimum_on_time', 600.0), ('use_sim_time', True)):
        result = set_one(name, value)
        assert result.successful is not locked
        assert not locked or f'{name}: is locked' in result.reason
    # Wishes of the driver, and a value that stays as it is.
    assert set_one('value_of_time', 20.0).successful
    assert set_one('clock_tolerance', 1.0).successful
    assert not set_one('locked', False).successful
    assert set_one('use_sim_time', not locked).successful
    assert ('use_sim_time = true: stamps and leases now follow /clock' in planner.output()) is not locked


def test_the_clock_of_a_node_whose_parameters_are_read_at_the_start_stays(bench):
    bench.start('heater_controller')
    result = set_parameters(bench, '/heater_controller', use_sim_time=True)
    assert not result.successful and 'read-only' in result.reason
