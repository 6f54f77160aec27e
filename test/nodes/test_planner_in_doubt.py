# SPDX-License-Identifier: Apache-2.0
"""The installed `planner` on a route with an uncertain charger: it waits, and heats once charging is certain."""

from builtin_interfaces.msg import Time
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
START_S = 1000


def test_heating_waits_for_the_probability(bench, wait_until):
    commands = bench.record(HvchCommand, 'hvch_command')
    plans = bench.record(PreheatPlan, 'preheat_plan', LATCHED)
    clock, states = bench.publisher(Clock, '/clock'), bench.publisher(BatteryState, 'battery_state')
    routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
    bench.start('planner', '-p', 'use_sim_time:=true', '-p', 'estimation:=false')
    for sender in (clock, states, routes):
        sender.wait_for_subscription()
    second = START_S

    def send(probability):
        # So short that heating starts at once.
        message = RoutePlan(
            route_id='doubt', charging_planned=True, segment_duration=[60.0] * 15, speed=[25.0],
            propulsion_power=[15e3], ambient_temperature=[-8.0], target_battery_temperature=25.0,
            has_target_battery_temperature=True, charger_power=150e3, charging_probability=probability)
        message.header.stamp = Time(sec=START_S)
        routes.publish(message)

    def after(condition):
        def found():
            nonlocal second
            second = min(second + 1, START_S + 300)
            clock.publish(Clock(clock=Time(sec=second)))
            state = BatteryState(temperature=-7.0, percentage=0.5)
            state.header.stamp = Time(sec=second)
            states.publish(state)
            return condition()
        return wait_until(found, f'the last plan: {plans.latest}')

    send(0.1)
    plan = after(lambda: plans.latest if plans.latest is not None and plans.latest.route_id == 'doubt'
                 and len(plans.latest.time) else None)
    assert plan.explanation.startswith('Heating waits: 10 % chance of charging'), plan.explanation
    assert plan.status == PreheatPlan.WAITING and plan.charging_probability == 0.1
    assert commands.latest is None or commands.latest.battery_heating_power == 0.0
    send(1.0)
    after(lambda: commands.latest is not None and commands.latest.battery_heating_power > 0.0)
