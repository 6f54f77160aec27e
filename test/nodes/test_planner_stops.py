# SPDX-License-Identifier: Apache-2.0
"""The planner's node on a trip with two stops: commands and predictions leg by leg, in simulated time."""

from math import nan

from builtin_interfaces.msg import Time
import pytest
from rehearsed_planner import RehearsedPlanner
from sensor_msgs.msg import BatteryState

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import RoutePlan

START_S = 1000
# Time advances in steps of this [s], well below the maximum age of a battery state.
STEP_S = 2
# The cabin leaves another power of the 7 kW in each leg.
FIRST_W, SECOND_W = 5400.0, 6200.0
HEATS = Status.TARGET_UNREACHABLE
# Two legs of 2 min and a leg of 1 min; stops of 60 and 90 s in between.
FIRST_ARRIVAL_S, SECOND_S, SECOND_ARRIVAL_S, THIRD_S, END_S = (
    START_S + seconds for seconds in (120, 180, 300, 390, 450))


def route_message(**changed):
    message = RoutePlan(**{
        'route_id': 'two stops', 'segment_duration': [30.0] * 10, 'speed': [20.0],
        'propulsion_power': [18e3], 'ambient_temperature': [-7.0],
        'cabin_heating_power': [7000.0 - FIRST_W] * 4 + [7000.0 - SECOND_W] * 4 + [500.0] * 2,
        'charging_planned': False, 'target_battery_temperature': nan,
        'stop_after_segment': [3, 7], 'stop_duration': [60.0, 90.0],
        'stop_target_battery_temperature': [25.0, nan], 'stop_minimum_arrival_soc': [0.0, 0.1],
        'departure_battery_temperature': [24.5, 28.0], 'departure_soc': [0.7, 0.6], **changed})
    message.header.stamp = Time(sec=START_S)
    return message


class Trip:
    """A planner in this process on its way: the clock is set by hand, so no computer is too slow for it."""

    def __init__(self, planner):
        self._planner = planner
        self.routes = planner.give

    @property
    def command(self):
        """Return the latest power [W] and its reason."""
        last = self._planner.commands.latest
        return last.battery_heating_power, last.reason

    @property
    def plan(self):
        """Return the latest PreheatPlan."""
        return self._planner.plans.latest

    def status(self):
        """Return the latest diagnostics of preheating."""
        self._planner.repeat()
        return self._planner.diagnostics.latest.status[0]

    def set(self, **parameters):
        """Set parameters of the planner."""
        assert self._planner.set(**parameters).successful

    def at(self, second, percentage=0.8, **power):
        """Set the clock to that second, and publish the state of a battery at -7 degC measured then."""
        self._planner.set_clock(second * NS_PER_S)
        state = BatteryState(temperature=-7.0, percentage=percentage, **power)
        state.header.stamp = Time(sec=second)
        self._planner.give(state)

    def drive(self, first_s, last_s, **power):
        """Advance time from one second to another, with a battery state each STEP_S and at the end."""
        for second in (*range(first_s, last_s, STEP_S), last_s):
            self.at(second, **power)


@pytest.fixture
def trip(rehearsal):
    """Return the start of the trip with two stops."""
    planner = RehearsedPlanner(rehearsal, START_S * NS_PER_S)
    assert planner.set(heat_while_charging=True).successful
    trip = Trip(planner)
    trip.routes(route_message())
    trip.at(START_S)
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


@pytest.mark.parametrize('second, arrivals_s', [
    (START_S, [SECOND_ARRIVAL_S, END_S]), (FIRST_ARRIVAL_S, [SECOND_ARRIVAL_S, END_S]),
    (SECOND_S, [END_S]), (THIRD_S, [])])
def test_the_plan_covers_what_lies_beyond_the_next_stop(trip, second, arrivals_s):
    trip.at(second)
    assert [arrival.sec for arrival in trip.plan.later_arrival] == arrivals_s


def test_a_later_leg_starts_from_its_departure(trip):
    plan = trip.plan
    assert list(plan.later_status) == [Status.WAITING, Status.NO_CHARGING_PLANNED]
    # 2 min do not take the battery far from the 28 degC and 0.6 of the departure.
    assert 26.0 < plan.later_predicted_arrival_temperature[1] < 29.0
    assert 0.55 < plan.later_predicted_arrival_soc[1] < 0.6
    assert SECOND_S < plan.later_heating_start[0].sec < SECOND_ARRIVAL_S
    assert plan.later_heating_start[1] == Time()


def test_it_heats_on_while_the_battery_is_charged(trip):
    # Heat at a charger of this power pays if energy costs nothing and the battery is to be charged for long.
    trip.set(energy_price=0.0)
    # A charging current is positive in sensor_msgs. The planner needs some states as evidence.
    trip.drive(FIRST_ARRIVAL_S, FIRST_ARRIVAL_S + 40, percentage=0.3, voltage=400.0, current=100.0)
    assert trip.command == (pytest.approx(FIRST_W), Status.CHARGING)
    trip.at(FIRST_ARRIVAL_S + 41, percentage=0.3, voltage=400.0, current=-5.0)
    assert trip.command == (0.0, Status.CHARGING)
    trip.at(FIRST_ARRIVAL_S + 42, percentage=0.3)
    assert trip.command == (0.0, Status.CHARGING)


def test_a_stop_is_told_in_the_diagnostics(trip):
    trip.at(SECOND_ARRIVAL_S + 37)
    assert trip.plan.status == Status.CHARGING
    status = trip.status()
    assert status.message.startswith('CHARGING: Charging until departure in 0:53 min; ')
    assert {item.key: item.value for item in status.values}['legs after this one'] == '1'
