# SPDX-License-Identifier: Apache-2.0
"""The planner with a method of another package: over DDS, and in this process with a method that breaks."""

import os

from builtin_interfaces.msg import Time
import installed_packages
from node_bench import repeating
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rehearsed_planner import RehearsedPlanner
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat.planning import installed_methods
from bev_preheat.planning.installed_methods import InstalledMethod
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
# Messages lost on a best-effort topic are sent again after this real time.
RESEND_S = 0.2
START_S, STEPS, STEP_S = 1_700_000_000, 60, 30.0
BROKEN = """
def negative(situation):
    return -situation.heater_limit_w
"""


def route():
    """Return a route of 30 min to a fast charger."""
    message = RoutePlan(
        route_id='home', segment_duration=[STEP_S] * STEPS, speed=[20.0], propulsion_power=[20e3],
        ambient_temperature=[-7.0], cabin_heating_power=[1600.0], charging_planned=True,
        target_battery_temperature=12.0)
    message.header.stamp = Time(sec=START_S)
    return message


def battery_state(second):
    message = BatteryState(temperature=-7.0, percentage=0.8)
    message.header.stamp = Time(sec=START_S + second)
    return message


def string(name, value):
    return Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value))


def test_the_planner_heats_by_an_installed_method_and_refuses_a_broken_one(bench, tmp_path, monkeypatch):
    installed_packages.put_example(tmp_path, 'fixed_minutes_method')
    (tmp_path / 'broken_method.py').write_text(BROKEN)
    installed_packages.write_metadata(tmp_path, 'broken-method', {'negative': 'broken_method:negative'})
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')]))
    commands = bench.record(HvchCommand, 'hvch_command')
    plans = bench.record(PreheatPlan, 'preheat_plan', LATCHED)
    clock, states = bench.publisher(Clock, '/clock'), bench.publisher(BatteryState, 'battery_state')
    routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
    bench.start('planner', '-p', 'use_sim_time:=true', '-p', 'estimation:=false', '-p', 'method:=last_20_minutes')
    for sender in (clock, states, routes):
        sender.wait_for_subscription()
    routes.publish(route())

    def after(second, condition):
        """Return the first command that meets a condition after a battery state."""
        def ask():
            clock.publish(Clock(clock=Time(sec=START_S + second)))
            states.publish(battery_state(second))
        with repeating(ask, RESEND_S):
            return commands.wait_for(condition)

    waits = after(1, lambda command: command.reason == int(Status.WAITING))
    assert waits.battery_heating_power == 0.0
    plan = plans.wait_for(lambda message: message.method == 'last_20_minutes')
    # The last 20 of 30 minutes.
    heated = [power for power in plan.hvch_power if power > 0.0]
    assert sum(heated) * STEP_S == pytest.approx(1200.0 * (7000.0 - 1600.0), rel=1e-3)
    heats = after(605, lambda command: command.battery_heating_power > 5000.0)
    assert heats.reason == int(Status.HEATING)

    described = bench.call(DescribeParameters, '/planner/describe_parameters',
                           DescribeParameters.Request(names=['method'])).descriptors[0]
    assert 'a method of an installed package' in described.additional_constraints
    refused, = bench.call(SetParameters, '/planner/set_parameters', SetParameters.Request(
        parameters=[string('method', 'last_25_minutes')])).results
    assert not refused.successful
    assert refused.reason == ("method: 'last_25_minutes' is not one of value_function, optimal_switch, paper, "
                              'last_10_minutes, last_20_minutes, last_30_minutes, negative')
    taken, = bench.call(SetParameters, '/planner/set_parameters', SetParameters.Request(
        parameters=[string('method', 'negative')])).results
    assert taken.successful, taken.reason
    off = after(607, lambda command: command.reason == int(Status.INVALID_INPUT))
    assert off.battery_heating_power == 0.0
    plan = plans.wait_for(lambda message: message.status == int(Status.INVALID_INPUT))
    assert plan.explanation.startswith(
        'method negative of package broken-method 1.0: the answer is refused: -5400 W')


@pytest.fixture
def planner(rehearsal):
    return RehearsedPlanner(rehearsal, START_S * 1_000_000_000)


def after_state(planner, second):
    planner.set_clock((START_S + second) * 1_000_000_000)
    planner.give(battery_state(second))
    return planner.commands.latest.battery_heating_power, Status(planner.commands.latest.reason)


def test_a_method_that_fails_during_a_drive_switches_off_and_heats_again_once_it_works(planner, monkeypatch):
    fails = []

    def full(situation):
        if fails:
            raise fails[0]
        return situation.heater_limit_w

    monkeypatch.setattr(installed_methods, '_loaded', {'full': InstalledMethod('full', 'package own 1.0', full)})
    monkeypatch.setattr('bev_preheat.planning.planner.find_methods',
                        lambda built_in: installed_methods.Found({'full': None}, {}))
    assert planner.set(method='full').successful
    planner.give(route())
    assert after_state(planner, 1)[0] > 5000.0
    for second, error in enumerate((ValueError('lost'), SystemExit(1), MemoryError('none')), start=2):
        fails[:] = [error]
        assert after_state(planner, second) == (0.0, Status.INVALID_INPUT)
        assert (f'method full of package own 1.0: raised {type(error).__name__}: {error}'
                in planner.plans.latest.explanation)
    fails.clear()
    # The pause between two switchings passes first.
    assert after_state(planner, 5)[0] == 0.0
    assert after_state(planner, 200)[0] > 5000.0
