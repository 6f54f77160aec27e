# SPDX-License-Identifier: Apache-2.0
"""The planner with a method of another package, over DDS."""

import os

import installed_packages
from node_bench import repeating
from planner_car import PlannerCar, route_at, state_at
import pytest
from rcl_interfaces.srv import DescribeParameters
from rosgraph_msgs.msg import Clock

from bev_preheat.messages.fields import time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status

# Messages lost on a best-effort topic are sent again after this real time.
RESEND_S = 0.2
START_NS, STEPS, STEP_S = 1_700_000_000 * NS_PER_S, 60, 30.0
BROKEN = """
def negative(situation):
    return -situation.heater_limit_w
"""


def test_the_planner_heats_by_an_installed_method_and_refuses_a_broken_one(bench, tmp_path, monkeypatch):
    installed_packages.put_example(tmp_path, 'fixed_minutes_method')
    (tmp_path / 'broken_method.py').write_text(BROKEN)
    installed_packages.write_metadata(tmp_path, 'broken-method', {'negative': 'broken_method:negative'})
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')]))
    car, clock = PlannerCar(bench), bench.publisher(Clock, '/clock')
    commands, plans = car.commands, car.plans
    car.start('-p', 'use_sim_time:=true', '-p', 'estimation:=false', '-p', 'method:=last_20_minutes')
    for sender in (clock, *car.publishers.values()):
        sender.wait_for_subscription()
    # 30 min to a fast charger.
    car.give(route_at(START_NS, segment_duration=[STEP_S] * STEPS, cabin_heating_power=[1600.0],
                      target_battery_temperature=12.0))

    def after(second, condition):
        """Return the first command that meets a condition after a battery state."""
        now_ns = START_NS + second * NS_PER_S

        def ask():
            clock.publish(Clock(clock=time_message(now_ns)))
            car.give(state_at(now_ns))
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
    refused = car.set(method='last_25_minutes')
    assert not refused.successful
    assert refused.reason == ("method: 'last_25_minutes' is not one of value_function, optimal_switch, paper, "
                              'last_10_minutes, last_20_minutes, last_30_minutes, negative')
    taken = car.set(method='negative')
    assert taken.successful, taken.reason
    off = after(607, lambda command: command.reason == int(Status.INVALID_INPUT))
    assert off.battery_heating_power == 0.0
    plan = plans.wait_for(lambda message: message.status == int(Status.INVALID_INPUT))
    assert plan.explanation.startswith(
        'method negative of package broken-method 1.0: the answer is refused: -5400 W')
