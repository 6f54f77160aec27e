# SPDX-License-Identifier: Apache-2.0
"""The planner's node on trips to known and uncertain chargers."""


from planner_car import PlannerCar
import pytest

from bev_preheat.numerics import NS_PER_S
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
        return self.plans.latest

    def state_at(self, second, **fields):
        """Set the clock to that second, and publish the battery's state measured then."""
        self.after_state(second * NS_PER_S, **fields)


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
