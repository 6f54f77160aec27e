# SPDX-License-Identifier: Apache-2.0
"""The planner's node on the way to a known charger: it chooses the target, or does not heat."""

import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import BatteryState

from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import find_worth
from bev_preheat.messages.fields import time_message
from bev_preheat.planning import situation
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

# As a 32-bit number has it.
TEMPERATURE_C, SOC = 6.0, 0.375
SEGMENTS = {'segment_duration': [60.0] * 25, 'speed': [25.0], 'propulsion_power': [15e3],
            'ambient_temperature': [-8.0], 'cabin_heating_power': [1500.0], 'auxiliary_power': [400.0]}


def worth(charger_w, prices):
    """Return the Worth of this drive; `preheat worth` prints it."""
    vehicle = load_vehicle('reference')
    route = make_route({
        'duration_s': SEGMENTS['segment_duration'], 'speed_mps': [25.0], 'propulsion_power_w': [15e3],
        'ambient_temperature_c': [-8.0], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [400.0]}, vehicle.defaults)
    return find_worth(vehicle, route, situation.BatteryState(TEMPERATURE_C, SOC), situation.Goal(25.0),
                      charger_w, 0.8, prices)


class Trip:
    """A planner, and a battery that is published every second."""

    def __init__(self, rehearsal):
        self._rehearsal = rehearsal
        self.commands = rehearsal.record(HvchCommand, 'hvch_command')
        self.plans = rehearsal.record(PreheatPlan, 'preheat_plan')
        self._states = rehearsal.publisher(BatteryState, 'battery_state')
        self._routes = rehearsal.publisher(RoutePlan, 'route_plan')
        self.process = rehearsal.start(
            'planner', '-p', 'estimation:=false', '-p', 'energy_price:=0.55', '-p', 'value_of_time:=12.0')

    def plan(self, **charger):
        """Return the plan for a route to a charger, at its beginning."""
        message = RoutePlan(charging_planned=True, **SEGMENTS, **charger)
        message.header.stamp = time_message(self._rehearsal.now_ns)
        self._routes.publish(message)
        state = BatteryState(temperature=TEMPERATURE_C, percentage=SOC)
        state.header.stamp = time_message(self._rehearsal.now_ns)
        self._states.publish(state)
        return self.plans.latest


@pytest.fixture
def trip(rehearsal):
    return Trip(rehearsal)


def test_it_chooses_what_preheat_worth_calls_best(trip):
    first = trip.plan(charger_power=150e3)
    best = worth(150e3, Prices(0.55, 12.0))
    assert first.target_source == PreheatPlan.TARGET_CHOSEN
    assert 0.0 < first.charging_time < first.charging_time_unheated == pytest.approx(
        best.without_heating.charging_time_s, rel=1e-6)
    assert first.bought_energy_unheated == pytest.approx(best.without_heating.bought_energy_wh, rel=1e-6)
    assert first.target_reason.startswith('Worth it: heating the battery to ')
    cost = 0.55e-3 * first.bought_energy + 12.0 / 3600.0 * first.charging_time
    assert best.best.cost - 1e-6 <= cost <= 1.005 * best.best.cost


def test_a_slow_charger_is_not_heated_for(trip):
    plan = trip.plan(charger_power=50e3)
    assert plan.status == PreheatPlan.NOT_WORTH_IT
    assert plan.explanation.startswith('Not worth it: ') and not plan.heating_planned
    assert plan.charging_time == plan.charging_time_unheated > 0.0
    assert (trip.commands.latest.reason, trip.commands.latest.battery_heating_power) == (
        HvchCommand.NOT_WORTH_IT, 0.0)


def test_prices_can_be_set_on_the_way(trip):
    assert trip.plan(charger_power=150e3).status == PreheatPlan.WAITING

    def set_price(value):
        return trip.process.node.set_parameters([Parameter('value_of_time', value=value)])[0]

    assert not set_price(-1.0).successful
    assert set_price(0.0).successful
    assert trip.plans.latest.status == PreheatPlan.NOT_WORTH_IT
