# SPDX-License-Identifier: Apache-2.0
"""The planner's node on trips: two stops, known and uncertain chargers."""

from math import nan

from planner_car import PlannerCar
import pytest

from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import find_worth
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import PreheatPlan

START_S = 1000


class Trip(PlannerCar):
    """A planner in this process on its way: the clock is set by hand, so no computer is too slow for it."""

    def __init__(self, rehearsal, *arguments, **named):
        super().__init__(rehearsal, **named)
        self.at(START_S * NS_PER_S)
        self.start(*arguments)

    @property
    def command(self):
        """Return the latest power [W] and its reason."""
        return self.commands.latest.battery_heating_power, self.commands.latest.reason

    @property
    def plan(self):
        """Return the latest PreheatPlan."""
        return self.plans.latest

    def state_at(self, second, **fields):
        """Set the clock to that second, and publish the battery's state measured then."""
        self.after_state(second * NS_PER_S, **fields)

    def drive(self, first_s, last_s, **fields):
        """Advance time from one second to another, with a battery state each 2 s and at the end."""
        for second in (*range(first_s, last_s, 2), last_s):
            self.state_at(second, **fields)


# Two stops

# The cabin leaves another power of the 7 kW in each leg.
FIRST_W, SECOND_W = 5400.0, 6200.0
HEATS = Status.TARGET_UNREACHABLE
# Two legs of 2 min and a leg of 1 min; stops of 60 and 90 s in between.
FIRST_ARRIVAL_S, SECOND_S, SECOND_ARRIVAL_S, THIRD_S, END_S = (
    START_S + seconds for seconds in (120, 180, 300, 390, 450))


@pytest.fixture
def trip(rehearsal):
    """Return the start of the trip with two stops."""
    trip = Trip(rehearsal, '-p', 'heat_while_charging:=true')
    trip.send_route(
        route_id='two stops', segment_duration=[30.0] * 10, propulsion_power=[18e3],
        cabin_heating_power=[7000.0 - FIRST_W] * 4 + [7000.0 - SECOND_W] * 4 + [500.0] * 2,
        charging_planned=False, target_battery_temperature=nan, stop_after_segment=[3, 7],
        stop_duration=[60.0, 90.0], stop_target_battery_temperature=[25.0, nan],
        stop_minimum_arrival_soc=[0.0, 0.1], departure_battery_temperature=[24.5, 28.0], departure_soc=[0.7, 0.6])
    trip.state_at(START_S)
    assert (trip.plan.route_id, trip.plan.status) == ('two stops', HEATS)
    return trip


def test_each_part_of_the_trip_is_commanded_when_it_is_now(trip):
    last_s = START_S
    for second, power_w, reason in (
            (START_S, FIRST_W, HEATS), (FIRST_ARRIVAL_S - 30, FIRST_W, HEATS),
            (FIRST_ARRIVAL_S, 0.0, Status.CHARGING), (SECOND_S - 1, 0.0, Status.CHARGING),
            (SECOND_S, SECOND_W, HEATS), (SECOND_ARRIVAL_S - 30, SECOND_W, HEATS),
            (SECOND_ARRIVAL_S, 0.0, Status.CHARGING), (THIRD_S - 1, 0.0, Status.CHARGING),
            (THIRD_S, 0.0, Status.NO_CHARGING_PLANNED),
            (END_S - 1, 0.0, Status.NO_CHARGING_PLANNED), (END_S, 0.0, Status.ARRIVED)):
        trip.drive(last_s, second)
        last_s = second
        assert trip.command == (pytest.approx(power_w), reason), second


def test_it_heats_on_while_the_battery_is_charged(trip):
    # Heat at a charger of this power pays if energy costs nothing and the battery is to be charged for long.
    assert trip.set(energy_price=0.0).successful
    # A charging current is positive in sensor_msgs. The planner needs some states as evidence.
    trip.drive(FIRST_ARRIVAL_S, FIRST_ARRIVAL_S + 40, percentage=0.3, voltage=400.0, current=100.0)
    assert trip.command == (pytest.approx(FIRST_W), Status.CHARGING)
    trip.state_at(FIRST_ARRIVAL_S + 41, percentage=0.3, voltage=400.0, current=-5.0)
    assert trip.command == (0.0, Status.CHARGING)
    trip.state_at(FIRST_ARRIVAL_S + 42, percentage=0.3)
    assert trip.command == (0.0, Status.CHARGING)


# Chargers

# As a 32-bit number has it.
TEMPERATURE_C, SOC = 6.0, 0.375
SEGMENTS = {'segment_duration': [60.0] * 25, 'speed': [25.0], 'propulsion_power': [15e3],
            'ambient_temperature': [-8.0], 'cabin_heating_power': [1500.0], 'auxiliary_power': [400.0]}


@pytest.fixture
def plan_to(rehearsal):
    """`plan_to(**charger)` returns the plan for a route to a charger, at its beginning, and the Trip."""
    trip = Trip(rehearsal, '-p', 'estimation:=false', '-p', 'energy_price:=0.55', '-p', 'value_of_time:=12.0')

    def plan_to(power_w):
        trip.send_route(target_battery_temperature=0.0, charger_power=power_w, **SEGMENTS)
        trip.send_state(temperature=TEMPERATURE_C, percentage=SOC)
        return trip.plan, trip
    return plan_to


def test_it_chooses_what_preheat_worth_calls_best(plan_to):
    first, _ = plan_to(150e3)
    vehicle = load_vehicle('reference')
    route = make_route({
        'duration_s': SEGMENTS['segment_duration'], 'speed_mps': [25.0], 'propulsion_power_w': [15e3],
        'ambient_temperature_c': [-8.0], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [400.0]}, vehicle.defaults)
    best = find_worth(vehicle, route, BatteryState(TEMPERATURE_C, SOC), Goal(25.0), 150e3, 0.8, Prices(0.55, 12.0))
    assert first.target_source == PreheatPlan.TARGET_CHOSEN
    assert 0.0 < first.charging_time < first.charging_time_unheated == pytest.approx(
        best.without_heating.charging_time_s, rel=1e-6)
    assert first.bought_energy_unheated == pytest.approx(best.without_heating.bought_energy_wh, rel=1e-6)
    assert first.target_reason.startswith('Worth it: heating the battery to ')
    cost = 0.55e-3 * first.bought_energy + 12.0 / 3600.0 * first.charging_time
    assert best.best.cost - 1e-6 <= cost <= 1.005 * best.best.cost


def test_prices_can_be_set_on_the_way(plan_to):
    plan, trip = plan_to(150e3)
    assert plan.status == PreheatPlan.WAITING
    assert not trip.set(value_of_time=-1.0).successful
    assert trip.set(value_of_time=0.0).successful
    assert trip.plan.status == PreheatPlan.NOT_WORTH_IT


def test_heating_waits_for_the_probability_of_charging(rehearsal):
    trip = Trip(rehearsal)

    def given(second, probability):
        # So short that heating starts at once.
        trip.send_route(segment_duration=[60.0] * 15, speed=[25.0], propulsion_power=[15e3],
                        ambient_temperature=[-8.0], charger_power=150e3, charging_probability=probability)
        trip.state_at(second, percentage=0.5)
        return trip.plan, trip.command[0]

    plan, power_w = given(START_S + 1, 0.1)
    assert plan.explanation.startswith('Heating waits: 10 % chance of charging'), plan.explanation
    assert plan.status == PreheatPlan.WAITING and plan.charging_probability == 0.1
    assert power_w == 0.0
    _, power_w = given(START_S + 2, 1.0)
    assert power_w > 0.0
