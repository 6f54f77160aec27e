# SPDX-License-Identifier: Apache-2.0
"""The installed `planner` on the way to a known charger: it chooses the target, or does not heat."""

from builtin_interfaces.msg import Time
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import find_worth
from bev_preheat.planning import situation
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
START_S = 1000
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
    """A planner in simulated time, which advances a second with each battery state."""

    def __init__(self, bench):
        self.bench = bench
        self.commands = bench.record(HvchCommand, 'hvch_command')
        self.plans = bench.record(PreheatPlan, 'preheat_plan', LATCHED)
        self._clock = bench.publisher(Clock, '/clock')
        self._states = bench.publisher(BatteryState, 'battery_state')
        self._routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
        self.process = bench.start(
            'planner', '-p', 'use_sim_time:=true', '-p', 'estimation:=false', '-p',
            'energy_price:=0.55', '-p', 'value_of_time:=12.0')
        for sender in (self._clock, self._states, self._routes):
            sender.wait_for_subscription()
        self.second = START_S

    def send_route(self, route_id, **charger):
        message = RoutePlan(route_id=route_id, charging_planned=True, **SEGMENTS, **charger)
        # It begins at the current time, so that each drive is complete.
        message.header.stamp = Time(sec=START_S + 600)
        self._routes.publish(message)

    def go_on(self, seconds=1):
        for _ in range(seconds):
            # Never up to the start of the routes, even on a slow computer.
            self.second = min(self.second + 1, START_S + 500)
            self._clock.publish(Clock(clock=Time(sec=self.second)))
            state = BatteryState(temperature=TEMPERATURE_C, percentage=SOC)
            state.header.stamp = Time(sec=self.second)
            self._states.publish(state)

    def plan(self, wait_until, condition):
        """Return the first plan for which condition(plan), while battery states go on."""
        def found():
            self.go_on()
            plan = self.plans.latest
            return plan if plan is not None and condition(plan) else None
        return wait_until(found, f'the last plan: {self.plans.latest}')


@pytest.fixture(scope='module')
def trip(module_bench):
    return Trip(module_bench)


def test_it_chooses_what_preheat_worth_calls_best(trip, wait_until):
    trip.send_route('fast', charger_power=150e3)
    first = trip.plan(wait_until, lambda plan: plan.route_id == 'fast' and len(plan.time))
    best = worth(150e3, Prices(0.55, 12.0))
    assert first.target_source == PreheatPlan.TARGET_CHOSEN
    assert 0.0 < first.charging_time < first.charging_time_unheated == pytest.approx(
        best.without_heating.charging_time_s, rel=1e-6)
    assert first.bought_energy_unheated == pytest.approx(best.without_heating.bought_energy_wh, rel=1e-6)
    assert first.target_reason.startswith('Worth it: heating the battery to ')
    cost = 0.55e-3 * first.bought_energy + 12.0 / 3600.0 * first.charging_time
    assert best.best.cost - 1e-6 <= cost <= 1.005 * best.best.cost


def test_a_slow_charger_is_not_heated_for(trip, wait_until):
    trip.send_route('slow', charger_power=50e3)
    plan = trip.plan(wait_until, lambda plan: plan.status == PreheatPlan.NOT_WORTH_IT)
    assert plan.explanation.startswith('Not worth it: ') and not plan.heating_planned
    assert plan.charging_time == plan.charging_time_unheated > 0.0
    command = trip.commands.wait_for(lambda command: command.reason == HvchCommand.NOT_WORTH_IT)
    assert command.battery_heating_power == 0.0


def test_prices_can_be_set_on_the_way(trip, wait_until):
    trip.send_route('dear', charger_power=150e3)
    trip.plan(wait_until, lambda plan: plan.route_id == 'dear' and plan.status == PreheatPlan.WAITING)

    def set_price(value):
        return trip.bench.call(SetParameters, '/planner/set_parameters', SetParameters.Request(
            parameters=[Parameter(name='value_of_time', value=ParameterValue(
                type=ParameterType.PARAMETER_DOUBLE, double_value=value))])).results[0]

    assert not set_price(-1.0).successful
    assert set_price(0.0).successful
    trip.plan(wait_until, lambda plan: plan.status == PreheatPlan.NOT_WORTH_IT)


def test_a_charger_that_cannot_be_is_refused(trip, wait_until):
    trip.send_route('watts', charger_power=150.0)
    plan = trip.plan(wait_until, lambda plan: plan.status == PreheatPlan.INVALID_INPUT)
    assert 'charger_power: 150 is not allowed' in plan.explanation
    assert trip.process.exit_status is None
