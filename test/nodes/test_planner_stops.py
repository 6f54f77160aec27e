# SPDX-License-Identifier: Apache-2.0
"""The installed `planner` on a trip with two stops: commands and predictions leg by leg."""

from itertools import count
from math import nan

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
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
    """A planner in simulated time, which stands still unless it is set."""

    def __init__(self, bench):
        self._commands = bench.record(HvchCommand, 'hvch_command')
        self._plans = bench.record(PreheatPlan, 'preheat_plan')
        self.diagnostics = bench.record(DiagnosticArray, '/diagnostics')
        self._clock = bench.publisher(Clock, '/clock')
        self._states = bench.publisher(BatteryState, 'battery_state')
        self.routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
        self.process = bench.start(
            'planner', '-p', 'use_sim_time:=true', '-p', 'heat_while_charging:=true')
        for sender in (self._clock, self._states, self.routes):
            sender.wait_for_subscription()
        for recorder in (self._commands, self._plans, self.diagnostics):
            recorder.wait_for_publisher()

    def at(self, second, what, **power):
        """Set the clock to that second, with a battery at -7 degC, until `what(command, plan)` holds."""
        self.between(second, second, what, **power)

    def between(self, first_s, last_s, what, **power):
        """
        Advance time from one second to another until `what(command, plan)` holds; return the second.

        After a leap of the clock the battery state is too old; then heat waits for 10 s.
        """
        second = first_s

        def answered():
            nonlocal second
            command, plan = self._answer(second, power)
            if command is not None and plan is not None and what(command, plan):
                return True
            # The planner has answered: on to the next instant.
            if command is not None:
                second = min(second + STEP_S, last_s)
            return False

        self._wait(answered, first_s)
        return second

    def drive(self, first_s, last_s):
        """Advance time from one second to another without a leap."""
        for second in range(first_s, last_s + 1, STEP_S):
            self._wait(lambda second=second: self._answer(second, {})[0] is not None, second)

    def _answer(self, second, power):
        """Return the newest command of that second, or None, and the newest plan, or None."""
        stamp = Time(sec=second)
        self._clock.publish(Clock(clock=stamp))
        command = next((command for command in reversed(self._commands.messages)
                        if command.header.stamp == stamp), None)
        # The planner knows the time: a state received before its clock would be refused.
        if command is not None:
            state = BatteryState(temperature=-7.0, percentage=0.8, **power)
            state.header.stamp = stamp
            self._states.publish(state)
        return command, next(reversed(self._plans.messages), None)

    def _wait(self, condition, second):
        try:
            self.wait_until(condition, f'at {second} s')
        except AssertionError as error:
            raise AssertionError(f'{error}; the last command: {self._commands.messages[-1:]}') from error


@pytest.fixture(scope='module')
def shared_trip(module_bench):
    return Trip(module_bench)


TRIP_NUMBERS = count()


@pytest.fixture
def trip(shared_trip, wait_until):
    """Return the trip that the tests share, with the route with two stops."""
    shared_trip.wait_until = wait_until
    # A name that no plan has yet: of two routes in quick succession the planner hears the second only.
    route_id = f'two stops {next(TRIP_NUMBERS)}'
    shared_trip.routes.publish(route_message(route_id=route_id))
    shared_trip.at(START_S, lambda command, plan: (plan.route_id, plan.status) == (route_id, HEATS))
    return shared_trip


def test_each_part_of_the_trip_is_commanded_when_it_is_now(trip):
    last_s = START_S
    for second, power_w, reason in (
            (START_S, FIRST_W, HEATS), (FIRST_ARRIVAL_S - 30, FIRST_W, HEATS),
            (FIRST_ARRIVAL_S, 0.0, Status.CHARGING), (SECOND_S - 1, 0.0, Status.CHARGING),
            (SECOND_S, SECOND_W, HEATS), (SECOND_ARRIVAL_S - 30, SECOND_W, HEATS),
            (SECOND_ARRIVAL_S, 0.0, Status.CHARGING), (THIRD_S - 1, 0.0, Status.CHARGING),
            (THIRD_S, 0.0, Status.NO_CHARGING_PLANNED),
            (END_S - 1, 0.0, Status.NO_CHARGING_PLANNED), (END_S, 0.0, Status.ARRIVED)):
        expected = pytest.approx(power_w), int(reason)
        trip.drive(last_s, second)
        last_s = trip.between(second, second + (12 if power_w else 0), lambda command, plan, expected=expected: (
            command.battery_heating_power, command.reason) == expected)


@pytest.mark.parametrize('second, arrivals_s', [
    (START_S, [SECOND_ARRIVAL_S, END_S]), (FIRST_ARRIVAL_S, [SECOND_ARRIVAL_S, END_S]),
    (SECOND_S, [END_S]), (THIRD_S, [])])
def test_the_plan_covers_what_lies_beyond_the_next_stop(trip, second, arrivals_s):
    trip.at(second, lambda command, plan: [
        arrival.sec for arrival in plan.later_arrival] == arrivals_s)


def test_a_later_leg_starts_from_its_departure(trip):
    # 2 min do not take the battery far from the 28 degC and 0.6 of the departure.
    trip.at(START_S, lambda command, plan: (
        list(plan.later_status) == [Status.WAITING, Status.NO_CHARGING_PLANNED]
        and 26.0 < plan.later_predicted_arrival_temperature[1] < 29.0
        and 0.55 < plan.later_predicted_arrival_soc[1] < 0.6
        and SECOND_S < plan.later_heating_start[0].sec < SECOND_ARRIVAL_S
        and plan.later_heating_start[1] == Time()))


def test_it_heats_on_while_the_battery_is_charged(trip):
    def commands(power_w):
        return lambda command, plan: (command.battery_heating_power, command.reason) == (
            pytest.approx(power_w), int(Status.CHARGING))

    # A charging current is positive in sensor_msgs. The planner needs some states as evidence, and a busy computer
    # loses some, so there is time for many.
    second = trip.between(
        FIRST_ARRIVAL_S + 2, SECOND_S - 3, commands(FIRST_W), voltage=400.0, current=100.0)
    trip.at(second + 1, commands(0.0), voltage=400.0, current=-5.0)
    trip.at(second + 2, commands(0.0))


def test_a_stop_is_told_in_the_diagnostics(trip):
    # An instant that no other test has.
    trip.at(SECOND_ARRIVAL_S + 37, lambda command, plan: plan.status == Status.CHARGING)
    array = trip.diagnostics.wait_for(
        lambda array: array.status[0].message.startswith('CHARGING: Charging until departure in '
                                                         '0:53 min; '))
    values = {item.key: item.value for item in array.status[0].values}
    assert values['legs after this one'] == '1'


@pytest.mark.parametrize('changed, text', [
    ({'stop_duration': [60.0]},
     'stop_duration: has 1 values; it must have 2, as stop_after_segment has'),
    ({'stop_after_segment': [7, 3]},
     'stop_after_segment[1]: 3 is not allowed; it must be above 7, the one before it'),
    ({'departure_battery_temperature': [24.5, 60.0], 'departure_soc': [1.5, 0.6]},
     'departure_soc[0]: 1.5 is not allowed; it must be 0 ... 1, or NaN: 0.8'),
    ({'stop_target_battery_temperature': [-50.0, nan]},
     'leg 1: target battery temperature: -50 is not allowed; it must be -40 ... 60 degC')],
    ids=['length', 'order', 'charge', 'vehicle'])
def test_bad_stops_switch_off_and_are_named(trip, changed, text):
    trip.diagnostics.clear()
    trip.routes.publish(route_message(**changed))
    array = trip.diagnostics.wait_for(lambda array: text in array.status[0].message)
    assert array.status[0].message.startswith('INVALID_INPUT: route_plan refused: ')
