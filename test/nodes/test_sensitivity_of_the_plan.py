# SPDX-License-Identifier: Apache-2.0
"""The sensitivity of the plan in the planner's diagnostics, for readers only."""

from builtin_interfaces.msg import Time
import pytest
from rehearsed_planner import RehearsedPlanner
from sensor_msgs.msg import BatteryState

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning import sensitivity
from bev_preheat_msgs.msg import RoutePlan

START_S = 1_700_000_000


def drive(planner, seconds):
    """Publish a route, and battery states for this time [s]."""
    route = RoutePlan(
        route_id='home', segment_duration=[30.0] * 80, speed=[20.0], propulsion_power=[20e3],
        ambient_temperature=[-7.0], charging_planned=True, target_battery_temperature=15.0)
    route.header.stamp = Time(sec=START_S)
    planner.give(route)
    for second in range(seconds):
        planner.set_clock((START_S + second) * NS_PER_S)
        message = BatteryState(temperature=-7.0, percentage=0.8)
        message.header.stamp = Time(sec=START_S + second)
        planner.give(message)
        planner.repeat()


def test_it_is_in_the_diagnostics(rehearsal):
    planner = RehearsedPlanner(rehearsal, START_S * NS_PER_S)
    drive(planner, 40)
    entry = next(each for each in planner.diagnostics.latest.status if each.name == 'planner: preheating')
    text = {value.key: value.value for value in entry.values}['sensitivity of the plan']
    assert text.startswith('One more kelvin in the battery now would save ') and 'Without heating' in text


def test_without_a_reader_nothing_is_planned_for_it(rehearsal, monkeypatch):
    def fail(*_, **__):
        pytest.fail('searched')

    planner = RehearsedPlanner(rehearsal, START_S * NS_PER_S, commands_alone=True)
    monkeypatch.setattr(sensitivity, 'plan_preheating', fail)
    drive(planner, 3)
    assert planner.commands.latest is not None
