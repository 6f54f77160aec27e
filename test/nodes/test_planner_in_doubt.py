# SPDX-License-Identifier: Apache-2.0
"""The planner's node on a route with an uncertain charger: it waits, and heats once charging is certain."""

from builtin_interfaces.msg import Time
from rehearsed_planner import RehearsedPlanner
from sensor_msgs.msg import BatteryState

from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

START_S = 1000


def test_heating_waits_for_the_probability(rehearsal):
    planner = RehearsedPlanner(rehearsal, START_S * 10**9)

    def given(second, probability):
        # So short that heating starts at once.
        route = RoutePlan(
            route_id='doubt', charging_planned=True, segment_duration=[60.0] * 15, speed=[25.0],
            propulsion_power=[15e3], ambient_temperature=[-8.0], target_battery_temperature=25.0,
            has_target_battery_temperature=True, charger_power=150e3, charging_probability=probability)
        route.header.stamp = Time(sec=START_S)
        planner.set_clock((START_S + second) * 10**9)
        planner.give(route)
        state = BatteryState(temperature=-7.0, percentage=0.5)
        state.header.stamp = Time(sec=START_S + second)
        planner.give(state)
        return planner.plans.latest, planner.commands.latest.battery_heating_power

    plan, power_w = given(1, 0.1)
    assert plan.explanation.startswith('Heating waits: 10 % chance of charging'), plan.explanation
    assert plan.status == PreheatPlan.WAITING and plan.charging_probability == 0.1
    assert power_w == 0.0
    _, power_w = given(2, 1.0)
    assert power_w > 0.0
