# SPDX-License-Identifier: Apache-2.0
"""
The planner's node: its answers to valid, invalid, late and missing input, without DDS (test_planner_over_dds.py).

Most tests start while it heats, so that 0 W is a reaction and not the initial state.
"""

from array import array
from math import isnan, nan
import re
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Temperature
from std_srvs.srv import SetBool

from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.nodes.planner_parameters import PARAMETERS
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan, RouteProgress

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
PERIOD_S, LEASE_S, TIMEOUT_S = 0.2, 0.6, 2.0
QUICK = ('-p', f'command_period:={PERIOD_S}', '-p', f'command_lease:={LEASE_S}',
         '-p', f'battery_state_timeout:={TIMEOUT_S}',
         # Here batteries jump between states, and the plans report standing vehicles.
         '-p', 'estimation:=false', '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0')
STATE_PERIOD_S = 0.04
CABIN_W = 1600.0
# config/vehicles/reference.yaml: 7 kW.
FULL_POWER_W = 7000.0 - CABIN_W


def heats(command):
    return command.battery_heating_power > 0.0


def is_off_for(status):
    return lambda command: (command.battery_heating_power, command.reason) == (0.0, int(status))


class Car:
    """The planner's environment: battery, route and position, and all that the planner says."""

    def __init__(self, rehearsal, *arguments):
        self.rehearsal = rehearsal
        self.commands = rehearsal.record(HvchCommand, 'hvch_command')
        self.plans = rehearsal.record(PreheatPlan, 'preheat_plan')
        self.temperatures = rehearsal.record(Temperature, 'predicted_arrival_temperature')
        self.diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics')
        self._states = rehearsal.publisher(BatteryState, 'battery_state')
        self._routes = rehearsal.publisher(RoutePlan, 'route_plan', LATCHED)
        self._positions = rehearsal.publisher(RouteProgress, 'route_progress')
        self.process = rehearsal.start('planner', *QUICK, *arguments)

    @property
    def now_ns(self):
        return self.rehearsal.now_ns

    def state(self, age_s=0.0, **fields):
        message = BatteryState(**{'temperature': -7.0, 'percentage': 0.8, **fields})
        message.header.stamp = time_message(self.now_ns - round(age_s * NS_PER_S))
        return message

    def route(self, age_s=0.0, **fields):
        """Return a route of 20 min, too short to reach 25 degC from -7 degC: heats at once."""
        message = RoutePlan(**{
            'route_id': 'home', 'segment_duration': [30.0] * 40, 'speed': [20.0],
            'propulsion_power': [20e3], 'ambient_temperature': [-7.0],
            'cabin_heating_power': [CABIN_W], 'charging_planned': True,
            'target_battery_temperature': 25.0, **fields})
        message.header.stamp = time_message(self.now_ns - round(age_s * NS_PER_S))
        return message

    def send_state(self, message=None):
        self._states.publish(message or self.state())

    def send_route(self, message=None):
        self._routes.publish(message or self.route())

    def send_position(self, **fields):
        message = RouteProgress(**{'route_id': 'home', **fields})
        message.header.stamp = time_message(self.now_ns)
        self._positions.publish(message)

    def give_state(self, make_state=None):
        """Let time pass, and publish a battery state."""
        self.rehearsal.advance(STATE_PERIOD_S)
        self.send_state((make_state or self.state)())

    def feeding(self, make_state=None):
        """Publish battery states while time passes in the block."""
        return self.rehearsal.repeating(lambda: self.send_state((make_state or self.state)()), STATE_PERIOD_S)

    def heat(self):
        """Give valid input until it heats as this route demands, and forget its earlier messages."""
        self.send_route()
        self.expect_heat()

    def expect_heat(self):
        """Give valid states until it heats, for 10 s or more after doubt; forget its earlier messages."""
        with self.feeding():
            self.commands.clear()
            self.commands.wait_for(
                lambda command: command.battery_heating_power == pytest.approx(FULL_POWER_W), 'heat')
        assert (self.plans.latest.status, self.plans.latest.route_id) == (Status.TARGET_UNREACHABLE, 'home')
        for recorder in (self.commands, self.plans, self.temperatures, self.diagnostics):
            recorder.clear()

    def enable(self, on):
        return self.rehearsal.call(SetBool, '/planner/enable', SetBool.Request(data=on))

    def set_parameters(self, service=SetParameters, **values):
        atomically = service is SetParametersAtomically
        response = self.rehearsal.call(
            service, f'/planner/set_parameters{"_atomically" if atomically else ""}',
            service.Request(parameters=[Parameter(name, value=value).to_parameter_msg()
                                        for name, value in values.items()]))
        return response.result if atomically else response.results[0]

    def get_parameters(self, *names):
        values = self.rehearsal.call(
            GetParameters, '/planner/get_parameters', GetParameters.Request(names=names)).values
        return [value.string_value if value.type == ParameterType.PARAMETER_STRING
                else value.double_value for value in values]


@pytest.fixture
def fresh_car(rehearsal):
    """Return a car whose planner has not received anything yet."""
    return Car(rehearsal)


@pytest.fixture
def car(fresh_car):
    """Return a car that heats."""
    fresh_car.heat()
    return fresh_car


# The first command

def test_no_heat_before_both_inputs(fresh_car):
    car = fresh_car
    car.commands.wait_for(is_off_for(Status.NO_ROUTE), 'off without a route')
    array = car.diagnostics.wait_for()
    assert (array.status[0].level, array.status[0].name, array.status[0].message) == (
        DiagnosticStatus.WARN, 'planner: preheating',
        'NO_ROUTE: No valid route plan has arrived yet.')
    for _ in range(5):
        car.give_state()
    assert car.plans.latest.status == Status.NO_ROUTE
    assert len(car.commands.messages) > 5 and not any(map(heats, car.commands.messages))
    car.send_route()
    assert heats(car.commands.latest)


def test_no_heat_with_a_route_alone(fresh_car):
    car = fresh_car
    car.send_route()
    car.rehearsal.advance(TIMEOUT_S)
    assert is_off_for(Status.NO_BATTERY_STATE)(car.commands.latest)
    assert not any(map(heats, car.commands.messages))
    car.give_state()
    assert heats(car.commands.latest)


def test_before_the_clock_runs_nothing_is_heated(rehearsal):
    car = Car(rehearsal, '-p', 'use_sim_time:=true')
    clock = rehearsal.publisher(Clock, '/clock')
    car.send_route()
    for _ in range(5):
        car.give_state()
    assert len(car.commands.messages) >= 5
    assert {(command.battery_heating_power, command.reason) for command in car.commands.messages} <= {
        (0.0, int(Status.INVALID_INPUT)), (0.0, int(Status.NO_BATTERY_STATE))}
    with rehearsal.repeating(
            lambda: clock.publish(Clock(clock=time_message(rehearsal.now_ns))), 0.5 * STATE_PERIOD_S):
        car.heat()


# Replanning

def test_every_battery_state_is_planned_from(car):
    for temperature_c in (-5.0, -3.0, -6.0):
        car.give_state(lambda: car.state(temperature=temperature_c))
        assert car.plans.latest.battery_temperature[0] == temperature_c


def test_a_new_route_is_planned_at_once(car):
    car.send_route(car.route(route_id='elsewhere'))
    plan = car.plans.wait_for(lambda plan: plan.route_id == 'elsewhere')
    assert plan.status == Status.TARGET_UNREACHABLE


def test_a_route_replaced_on_the_way_takes_effect_at_once(car):
    # No new battery state: the answer is to the route.
    car.send_route(car.route(charging_planned=False))
    command = car.commands.wait_for(lambda command: not heats(command), 'off')
    assert command.reason == Status.NO_CHARGING_PLANNED


def test_the_predicted_temperature_is_that_of_the_plan(car):
    car.give_state(lambda: car.state(temperature=-5.5))
    plan, message = car.plans.latest, car.temperatures.latest
    assert (message.header.stamp, message.temperature) == (plan.header.stamp, plan.predicted_arrival_temperature)


def test_the_power_is_what_the_cabin_leaves(car):
    car.give_state()
    command = car.commands.latest
    assert command.battery_heating_power == pytest.approx(FULL_POWER_W)


def test_an_array_of_one_and_empty_ones_make_a_route(car):
    car.send_route(car.route(route_id='short', cabin_heating_power=array('d')))
    command = car.commands.wait_for(
        lambda command: heats(command) and command.battery_heating_power != FULL_POWER_W)
    # config/vehicles/reference.yaml: 1978 W for the cabin.
    assert command.battery_heating_power == pytest.approx(7000.0 - 1978.0)


# Position of the vehicle

def told(car, **fields):
    """Report the vehicle's position, give a state, and return the entry on it."""
    car.send_position(**fields)
    car.give_state()
    car.rehearsal.advance(PERIOD_S)
    return next(status for status in car.diagnostics.latest.status if status.name == 'planner: route progress')


def test_a_late_vehicle_is_heated_by_place_and_a_refused_place_leaves_that_alone(car):
    # By its stamp the route has 15 min left; the vehicle has not left the start.
    car.send_route(car.route(age_s=300.0))
    assert told(car, distance=0.0, has_distance=True).message.endswith('min late')
    plan = car.plans.latest
    assert plan.delay == pytest.approx(300.0, abs=5.0)
    # At the planned 20 m/s it takes 0.5 s to cover the 10 m of position accuracy.
    assert (nanoseconds(plan.arrival) - nanoseconds(plan.header.stamp)) / NS_PER_S == pytest.approx(
        1199.5, abs=0.5)
    assert heats(car.commands.latest)
    status = told(car, distance=nan)
    assert status.level == DiagnosticStatus.WARN
    assert status.message == ('route_progress refused: distance: nan m is not allowed; it must be '
                              '0 ... 24000 m, the length of the route.')
    assert heats(car.commands.latest)
    assert car.plans.latest.delay == pytest.approx(plan.delay, abs=1.0)


# Bad battery states

BAD_STATES = {
    'temperature_kelvin': (lambda car: car.state(temperature=266.0),
                           'temperature: 266 is not allowed; it must be -40 ... 60'),
    'late': (lambda car: car.state(age_s=60.0), 'header.stamp: the state is 60'),
    'from_the_future': (lambda car: car.state(age_s=-60.0), 's ahead of the clock; at most'),
    # Another battery's state: of the same battery, it would have been overtaken.
    'out_of_order': (lambda car: car.state(age_s=0.9 * TIMEOUT_S, temperature=20.0),
                     'older than the previous one; stamps must not go back'),
}


@pytest.mark.parametrize('make_state, text', BAD_STATES.values(), ids=BAD_STATES)
def test_a_bad_battery_state_switches_off_and_is_named(car, make_state, text):
    with car.feeding(lambda: make_state(car)):
        car.commands.wait_for(is_off_for(Status.INVALID_INPUT), 'off')
        car.plans.wait_for(lambda plan: text in plan.explanation, text)


def test_a_good_battery_state_after_a_bad_one_heats_again(car):
    with car.feeding(lambda: car.state(temperature=nan)):
        car.commands.wait_for(is_off_for(Status.INVALID_INPUT), 'off')
    car.expect_heat()


def test_silence_of_the_battery_switches_off_within_the_timeout_and_it_heats_again_after_that(car):
    last_ns = car.now_ns
    command = car.commands.wait_for(is_off_for(Status.STALE_INPUT), 'off')
    age_s = (nanoseconds(command.header.stamp) - last_ns) / NS_PER_S
    assert TIMEOUT_S <= age_s <= TIMEOUT_S + PERIOD_S
    # No lease outlasts the battery state.
    assert max(nanoseconds(command.valid_until) for command in car.commands.messages
               if heats(command)) <= last_ns + round(TIMEOUT_S * NS_PER_S)
    car.expect_heat()


# Bad routes

BAD_ROUTES = {
    'wrong_length': ({'speed': [20.0] * 39}, 'speed: has 39 values; it must have 1 or 40'),
    'too_long': ({'segment_duration': array('d', [30.0]) * 100_000},
                 'the route lasts 3000000 s; at most 86400 s are planned'),
}


@pytest.mark.parametrize('fields, text', BAD_ROUTES.values(), ids=BAD_ROUTES)
def test_a_bad_route_switches_off_and_is_named(car, fields, text):
    car.send_route(car.route(route_id='wrong', **fields))
    car.commands.wait_for(is_off_for(Status.INVALID_INPUT), 'off')
    car.plans.wait_for(lambda plan: text in plan.explanation, text)


def test_a_bad_route_is_in_the_diagnostics_even_while_states_keep_coming(car):
    with car.feeding():
        car.send_route(car.route(speed=[-1.0]))
        car.diagnostics.wait_for(
            lambda array: array.status[0].level == DiagnosticStatus.ERROR
            and 'route_plan refused: speed[0]: -1 is not allowed' in array.status[0].message)


UPDATE = {'speed': [-1.0]}
# Fields refused besides the speed, and whether the previous route continues.
REFUSED_ROUTES = {
    'update': ({}, True), 'later': ({'segment_duration': [31.0] * 40}, True),
    'earlier': ({'segment_duration': [29.0] * 40}, False),
    'other_id': ({'route_id': 'work'}, False), 'no_id': ({'route_id': ''}, False),
    'cancelled': ({'charging_planned': False}, False),
    'unreadable': ({'segment_duration': [nan]}, False),
    'stop': ({'stop_after_segment': [20], 'stop_duration': [600.0]}, False)}


@pytest.mark.parametrize('fields, goes_on', REFUSED_ROUTES.values(), ids=REFUSED_ROUTES)
def test_after_a_refused_route_the_one_before_goes_on_only_if_it_was_not_called_off(
        car, fields, goes_on):
    # Otherwise the same route, stamped later, would arrive later.
    first = car.route()
    car.send_route(first)
    refused = car.route(**{**UPDATE, **fields})
    refused.header.stamp = first.header.stamp
    with car.feeding():
        car.plans.wait_for(lambda plan: plan.route_id == 'home')
        car.send_route(refused)
        car.plans.wait_for(lambda plan: plan.status == Status.INVALID_INPUT)
        # Some states later, if the previous route may continue.
        car.plans.clear()
        car.commands.clear()
        car.diagnostics.clear()
        if goes_on:
            car.commands.wait_for(heats, 'heating by the route before')
            status = 'TARGET_UNREACHABLE'
        else:
            plans = car.plans.wait_for_count(10)
            assert {(plan.status, plan.route_id) for plan in plans} == {(Status.INVALID_INPUT, '')}
            # The command of before may arrive after the plan.
            car.commands.wait_for(is_off_for(Status.INVALID_INPUT), 'off')
            car.commands.clear()
            assert not any(map(heats, car.commands.wait_for_count(5)))
            status = 'INVALID_INPUT'
        # The diagnostics remain at ERROR and name the refused fields.
        car.diagnostics.wait_for(lambda array: array.status[0].message.startswith(f'{status}: '))
        car.diagnostics.wait_for_count(4)
        entries = [array.status[0] for array in car.diagnostics.messages]
        assert {(entry.level, 'route_plan refused: ' in entry.message
                 and 'speed[0]: -1 is not allowed' in entry.message) for entry in entries} == {
            (DiagnosticStatus.ERROR, True)}
        car.send_route()
        car.diagnostics.wait_for(
            lambda array: array.status[0].level == DiagnosticStatus.WARN
            and array.status[0].message.startswith('TARGET_UNREACHABLE: '), 'a good route')


def test_a_parameter_does_not_bring_a_route_back_that_was_called_off(car):
    car.send_route(car.route(route_id='work', speed=[-1.0]))
    car.plans.wait_for(lambda plan: plan.status == Status.INVALID_INPUT)
    with car.feeding():
        assert car.set_parameters(clock_tolerance=0.75).successful
        car.plans.clear()
        plans = car.plans.wait_for_count(10)
    assert {plan.status for plan in plans} == {Status.INVALID_INPUT}


# Cancellation

def test_a_cancelled_trip_stays_off_while_states_keep_coming(car):
    with car.feeding():
        car.send_route(RoutePlan())
        car.plans.wait_for(lambda plan: plan.status == Status.NO_CHARGING_PLANNED)
        car.commands.wait_for(is_off_for(Status.NO_CHARGING_PLANNED), 'off')
        for recorder in (car.plans, car.commands, car.diagnostics):
            recorder.clear()
        plans = car.plans.wait_for_count(10)
        array = car.diagnostics.wait_for(
            lambda array: array.status[0].message.startswith('NO_CHARGING_PLANNED:'))
    assert {(plan.status, plan.explanation, plan.route_id) for plan in plans} == {
        (Status.NO_CHARGING_PLANNED,
         'The trip was cancelled: no heating until a new route plan arrives.', '')}
    assert not any(map(heats, car.commands.messages))
    assert array.status[0].level == DiagnosticStatus.OK


def test_a_parameter_does_not_bring_a_cancelled_trip_back(car):
    car.send_route(RoutePlan())
    car.plans.wait_for(lambda plan: plan.status == Status.NO_CHARGING_PLANNED)
    with car.feeding():
        assert car.set_parameters(clock_tolerance=0.75).successful
        car.plans.clear()
        plans = car.plans.wait_for_count(10)
    assert {plan.status for plan in plans} == {Status.NO_CHARGING_PLANNED}


def test_a_route_that_begins_later_is_told_from_now(car):
    car.send_route(car.route(age_s=-600.0, route_id='later'))
    with car.feeding():
        plan = car.plans.wait_for(lambda plan: plan.route_id == 'later')
    assert re.match(r'The route begins in (10:00|9:5\d) min\. Heating all the way is not enough: '
                    r'arrival in (30:00|29:5\d) min ', plan.explanation)


# Huge messages

def test_a_parameter_of_a_megabyte_is_refused_in_few_words(car):
    for value in ('x' * 1_000_000, f'/{"x" * 1_000_000}.yaml', '/x' * 500_000):
        for name in ('vehicle', 'method'):
            result = car.set_parameters(**{name: value})
            assert (result.successful, len(result.reason) < 1000) == (False, True), result.reason


# Very long routes

def fine_route(car, route_id):
    """Return the route of 20 min in 100 000 segments."""
    return car.route(route_id=route_id, segment_duration=array('d', [0.012]) * 100_000,
                     **{name: array('d', [value]) * 100_000 for name, value in (
                         ('speed', 20.0), ('propulsion_power', 20e3),
                         ('ambient_temperature', -7.0), ('cabin_heating_power', CABIN_W))})


def test_100_000_segments_again_and_again_are_planned_in_a_second_of_processor_time_each(car):
    route = fine_route(car, '')
    for number in range(3):
        route.route_id = f'fine {number}'
        before_s = time.thread_time()
        car.send_route(route)
        assert car.plans.latest.route_id == route.route_id
        # Commands come between the routes: none takes longer than the first.
        car.give_state()
        assert heats(car.commands.latest)
        assert time.thread_time() - before_s < 1.0


# Driver opt-out

def test_switched_off_it_stays_off_for_good_input_until_it_is_switched_on(car):
    assert car.enable(False).success
    # No time has passed and no battery state has arrived.
    assert is_off_for(Status.DISABLED)(car.commands.latest)
    car.commands.clear()
    car.send_route()
    with car.feeding():
        commands = car.commands.wait_for_count(10)
    assert {(command.battery_heating_power, command.reason) for command in commands} == {
        (0.0, int(Status.DISABLED))}
    response = car.enable(True)
    assert (response.success, response.message) == (True, 'Preheating is switched on.')
    car.expect_heat()


# The command and its lease

def test_the_command_is_repeated_and_the_lease_moves_with_it(car):
    # The first ones may still answer the last state.
    commands = car.commands.wait_for_count(8)[2:]
    stamps_s = [nanoseconds(command.header.stamp) / NS_PER_S for command in commands]
    assert stamps_s[5] - stamps_s[0] == pytest.approx(5 * PERIOD_S, abs=0.5 * PERIOD_S)
    # Later ones end with the battery state.
    assert [nanoseconds(command.valid_until) / NS_PER_S - stamp_s for command, stamp_s in zip(
        commands[:3], stamps_s) if heats(command)] == pytest.approx([LEASE_S] * 3)


# Parameters

def test_a_new_target_takes_effect_at_once(car):
    car.send_route(car.route(target_battery_temperature=nan, route_id='no target'))
    car.plans.wait_for(lambda plan: plan.route_id == 'no target')
    assert car.set_parameters(target_battery_temperature=11.5).successful
    car.plans.wait_for(lambda plan: plan.target_battery_temperature == 11.5)


def test_a_new_vehicle_takes_effect_at_once(car):
    assert car.set_parameters(vehicle='small_car').successful
    with car.feeding():
        car.diagnostics.wait_for(lambda array: array.status[0].hardware_id == 'small_car')


def test_a_new_vehicle_with_assumed_values_is_warned_of(car):
    assert car.set_parameters(vehicle='mid_size_lfp').successful
    with car.feeding():
        array = car.diagnostics.wait_for(
            lambda array: array.status[0].hardware_id == 'mid_size_lfp')
    values = {value.key: value.value for value in array.status[0].values}
    assert 'battery resistance' in values['assumed of the vehicle'].split(', ')
    assert ('vehicle mid_size_lfp: 21 values are assumed, not measured; preheat vehicle check '
            in car.process.output())


def test_a_new_period_takes_effect_at_once(car):
    assert car.set_parameters(command_period=0.05).successful
    car.commands.clear()
    stamps_s = [nanoseconds(command.header.stamp) / NS_PER_S
                for command in car.commands.wait_for_count(12)[1:]]
    assert stamps_s[-1] - stamps_s[0] < 10 * 0.5 * PERIOD_S


def test_the_compiled_core_is_told_and_can_be_switched_off(car):
    assert re.search(r'with method \w+; native core used: \S+libbev_preheat_core\.so\.', car.process.output())
    assert car.set_parameters(compiled_core=False).successful
    with car.feeding():
        car.diagnostics.wait_for(lambda array: any(
            (item.key, item.value) == ('compiled core', 'not used: switched off')
            for item in array.status[0].values))


def test_a_new_timeout_takes_effect_at_once(car):
    assert car.set_parameters(battery_state_timeout=0.3).successful
    plan = car.plans.wait_for(lambda plan: plan.status == Status.STALE_INPUT)
    assert plan.explanation.endswith('less than 0.3 s are allowed.')
    assert 'In effect now: battery_state_timeout = 0.3.' in car.process.output()


REFUSED = {
    'nan': ({'command_lease': nan}, 'command_lease: '),
    'target': ({'target_battery_temperature': 298.15},
               'target_battery_temperature: 298.15 degC is not allowed; it must be -40 ... 60'),
    # It is taken for 1.0, so it is the value that is refused.
    'integer': ({'command_period': 1}, 'command_lease: 0.6 s must be longer than command_period, 1 s'),
    'vehicle': ({'vehicle': 'refrence'},
                "vehicle 'refrence' is unknown; did you mean 'reference'?"),
    'lease': ({'command_lease': 0.15}, 'command_lease: 0.15 s must be longer than command_period, '
              '0.2 s'),
}


@pytest.mark.parametrize('values, text', REFUSED.values(), ids=REFUSED)
def test_a_wrong_parameter_is_refused_with_the_reason(car, values, text):
    (name,) = values
    before = car.get_parameters(name)
    result = car.set_parameters(**values)
    same = [a == b or (isnan(a) and isnan(b)) for a, b in zip(
        before, car.get_parameters(name))]
    assert (result.successful, same) == (False, [True])
    assert text.partition(':')[0] in result.reason
    # rclpy checks ranges itself, with its own messages.
    assert text in result.reason or 'range' in result.reason


def test_a_whole_number_is_taken_for_a_double(car):
    assert car.set_parameters(value_of_time=12).successful
    assert car.get_parameters('value_of_time') == [12.0]
    assert 'In effect now: value_of_time = 12.0.' in car.process.output()


def test_a_file_that_breaks_the_reader_is_refused(car, tmp_path):
    path = tmp_path / 'deep.yaml'
    path.write_text('[' * 1500)
    assert not car.set_parameters(vehicle=str(path)).successful
    car.expect_heat()


def test_several_parameters_hold_together(car):
    # Either alone is refused: the lease must be longer than the period.
    result = car.set_parameters(
        SetParametersAtomically, command_period=0.7, command_lease=2.0)
    assert (result.successful, car.get_parameters('command_period', 'command_lease')) == (
        True, [0.7, 2.0])


def test_several_parameters_fail_together(car):
    result = car.set_parameters(
        SetParametersAtomically, battery_state_timeout=3.0, command_period=0.9)
    assert (result.successful,
            car.get_parameters('battery_state_timeout', 'command_period')) == (
        False, [TIMEOUT_S, PERIOD_S])


def test_each_number_is_described_with_its_unit_and_range(car):
    names = [parameter.name for parameter in PARAMETERS if parameter.limits]
    descriptors = car.rehearsal.call(DescribeParameters, '/planner/describe_parameters',
                                     DescribeParameters.Request(names=names)).descriptors
    for parameter, descriptor in zip((each for each in PARAMETERS if each.limits), descriptors, strict=True):
        assert len(descriptor.description) > 10 and (
            descriptor.description.endswith(f'[{parameter.unit}]') or not parameter.unit)
        assert descriptor.floating_point_range or ' ... ' in descriptor.additional_constraints


def test_a_wrong_parameter_at_the_start_is_one_line_and_2(call_main):
    done = call_main('planner', '--ros-args', '-p', 'command_lease:=0.5')
    assert (done.returncode, done.stdout) == (2, '')
    (line,) = done.stderr.splitlines()
    assert line.startswith('planner: error: command_lease: 0.5 s must be longer than command_period')


# Diagnostics

@pytest.mark.parametrize('fields, level, status', [
    ({}, DiagnosticStatus.WARN, Status.TARGET_UNREACHABLE),
    ({'target_battery_temperature': -20.0}, DiagnosticStatus.OK, Status.NOT_NEEDED),
    ({'charging_planned': False}, DiagnosticStatus.OK, Status.NO_CHARGING_PLANNED),
    ({'speed': [-1.0]}, DiagnosticStatus.ERROR, Status.INVALID_INPUT),
], ids=['unreachable', 'not_needed', 'no_charging', 'invalid'])
def test_level_of_the_diagnostics(car, fields, level, status):
    car.send_route(car.route(**fields))
    with car.feeding():
        array = car.diagnostics.wait_for(
            lambda array: array.status[0].message.startswith(status.name))
    assert array.status[0].level == level


def test_silence_of_the_battery_is_an_error_in_the_diagnostics(car):
    array = car.diagnostics.wait_for(
        lambda array: array.status[0].message.startswith('STALE_INPUT'))
    assert array.status[0].level == DiagnosticStatus.ERROR


def test_diagnostics_tell_the_figures(car):
    with car.feeding(lambda: car.state(temperature=-6.5, percentage=0.75)):
        array = car.diagnostics.wait_for(lambda array: any(
            item.value == '-6.50' for item in array.status[0].values))
    values = {item.key: item.value for item in array.status[0].values}
    assert {key: values[key] for key in (
        'vehicle', 'route_id', 'enabled', 'command [W]', 'battery temperature [degC]',
        'state of charge [1]')} == {
            'vehicle': 'reference', 'route_id': 'home', 'enabled': 'true',
            'command [W]': f'{FULL_POWER_W:.0f}', 'battery temperature [degC]': '-6.50',
            'state of charge [1]': '0.7500'}


# The clock

def test_a_clock_that_restarts_is_followed(car):
    car.rehearsal.now_ns = 50 * NS_PER_S
    # The old route starts in the new future.
    car.give_state()
    assert not heats(car.commands.latest)
    car.heat()
    assert car.commands.latest.header.stamp.sec < 200
