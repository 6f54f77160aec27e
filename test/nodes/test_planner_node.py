# SPDX-License-Identifier: Apache-2.0
"""
The planner's node: its answers to valid, invalid, late and missing input, without DDS (test_planner_over_dds.py).

Most tests start while it heats, so that 0 W is a reaction and not the initial state. What is a bad message, and
which refused route ends the one before, is shown by test/messages and test/control.
"""

from array import array
from math import isnan, nan
import re
import time

from diagnostic_msgs.msg import DiagnosticStatus
import installed_packages
from planner_car import heats, is_off_for, PlannerCar, stamped, values_of
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParametersAtomically
from sensor_msgs.msg import Temperature

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.nodes.planner_parameters import PARAMETERS
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status

PERIOD_S, LEASE_S, TIMEOUT_S = 0.2, 0.6, 2.0
QUICK = ('-p', f'command_period:={PERIOD_S}', '-p', f'command_lease:={LEASE_S}',
         '-p', f'battery_state_timeout:={TIMEOUT_S}',
         # Here batteries jump between states, and the plans report standing vehicles.
         '-p', 'estimation:=false', '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0')
STATE_PERIOD_S = 0.04
CABIN_W = 1600.0
# config/vehicles/reference.yaml: 7 kW.
FULL_POWER_W = 7000.0 - CABIN_W


class Car(PlannerCar):
    """A car whose cabin takes a part of the heater's power."""

    def __init__(self, rehearsal, *arguments):
        super().__init__(rehearsal)
        self.temperatures = rehearsal.record(Temperature, 'predicted_arrival_temperature')
        self.start(*QUICK, *arguments)

    def route(self, age_s=0.0, **fields):
        return super().route(age_s, **{'cabin_heating_power': [CABIN_W], **fields})

    def give_state(self, **fields):
        self.bench.advance(STATE_PERIOD_S)
        self.send_state(**fields)

    def feeding(self, make_state=None, period_s=STATE_PERIOD_S):
        return super().feeding(make_state, period_s)

    def expect_heat(self):
        """Give valid states until it heats, for 10 s or more after doubt; forget its earlier messages."""
        with self.feeding():
            self.commands.clear()
            self.commands.wait_for(
                lambda command: command.battery_heating_power == pytest.approx(FULL_POWER_W), 'heat')
        assert (self.plans.latest.status, self.plans.latest.route_id) == (Status.TARGET_UNREACHABLE, 'home')
        self.clear()

    def get_parameters(self, *names):
        values = self.bench.call(
            GetParameters, '/planner/get_parameters', GetParameters.Request(names=names)).values
        return [value.string_value if value.type == ParameterType.PARAMETER_STRING
                else value.double_value for value in values]


@pytest.fixture
def fresh_car(rehearsal):
    """Return a car whose planner has not received anything yet."""
    return Car(rehearsal)


@pytest.fixture
def car(fresh_car):
    fresh_car.send_route()
    fresh_car.expect_heat()
    return fresh_car


# Replanning

def test_every_battery_state_is_planned_from_and_the_prediction_published(car):
    for temperature_c in (-5.0, -3.0, -6.0):
        car.give_state(temperature=temperature_c)
        plan, message = car.plans.latest, car.temperatures.latest
        assert plan.battery_temperature[0] == temperature_c
        assert (message.header.stamp, message.temperature) == (
            plan.header.stamp, plan.predicted_arrival_temperature)


def test_a_new_route_is_planned_at_once_without_a_new_battery_state(car):
    car.send_route(route_id='elsewhere')
    assert (car.plans.latest.route_id, car.plans.latest.status) == ('elsewhere', Status.TARGET_UNREACHABLE)
    car.send_route(charging_planned=False)
    assert is_off_for(Status.NO_CHARGING_PLANNED)(car.commands.latest)


def test_heating_waits_for_the_probability_of_charging(fresh_car):
    for probability, heats_now in ((0.1, False), (1.0, True)):
        # So short that heating starts at once.
        fresh_car.send_route(segment_duration=[60.0] * 15, speed=[25.0], propulsion_power=[15e3],
                             ambient_temperature=[-8.0], charger_power=150e3, charging_probability=probability)
        fresh_car.give_state(temperature=6.0, percentage=0.5)
        plan = fresh_car.plans.latest
        assert heats(fresh_car.commands.latest) is heats_now
        if not heats_now:
            assert plan.explanation.startswith('Heating waits: 10 % chance of charging'), plan.explanation
            assert (plan.status, plan.charging_probability) == (Status.WAITING, 0.1)


# Bad battery states


def test_silence_of_the_battery_switches_off_within_the_timeout_and_it_heats_again_after_that(car):
    last_ns = car.now_ns
    command = car.commands.wait_for(is_off_for(Status.STALE_INPUT), 'off')
    age_s = (nanoseconds(command.header.stamp) - last_ns) / NS_PER_S
    assert TIMEOUT_S <= age_s <= TIMEOUT_S + PERIOD_S
    # No lease outlasts the battery state.
    assert max(nanoseconds(command.valid_until) for command in car.commands.messages
               if heats(command)) <= last_ns + round(TIMEOUT_S * NS_PER_S)
    assert car.entry('preheating', lambda entry: entry.message.startswith('STALE_INPUT')).level == (
        DiagnosticStatus.ERROR)
    car.expect_heat()


# Bad routes


def test_a_refused_update_stays_an_error_while_the_route_before_goes_on(car):
    first = car.route()
    car.give(first)
    car.give(stamped(car.route(speed=[-1.0]), nanoseconds(first.header.stamp)))
    assert car.plans.latest.status == Status.INVALID_INPUT
    with car.feeding():
        car.clear()
        car.commands.wait_for(heats, 'heating by the route before')
        car.diagnostics.wait_for_count(4)
        entries = [array.status[0] for array in car.diagnostics.messages]
        assert {(entry.level, 'route_plan refused: speed[0]: -1 is not allowed' in entry.message)
                for entry in entries} == {(DiagnosticStatus.ERROR, True)}
        car.send_route()
        car.entry('preheating', lambda entry: entry.level == DiagnosticStatus.WARN
                  and entry.message.startswith('TARGET_UNREACHABLE: '))


# Huge messages

def test_a_parameter_of_a_megabyte_is_refused_in_few_words(car):
    for value in ('x' * 1_000_000, f'/{"x" * 1_000_000}.yaml', '/x' * 500_000):
        for name in ('vehicle', 'method'):
            result = car.set(**{name: value})
            assert (result.successful, len(result.reason) < 1000) == (False, True), result.reason


def test_100_000_segments_again_and_again_are_planned_in_a_second_of_processor_time_each(car):
    route = car.route(segment_duration=array('d', [0.012]) * 100_000,
                      **{name: array('d', [value]) * 100_000 for name, value in (
                          ('speed', 20.0), ('propulsion_power', 20e3), ('ambient_temperature', -7.0),
                          ('cabin_heating_power', CABIN_W))})
    for number in range(3):
        route.route_id = f'fine {number}'
        before_s = time.thread_time()
        car.give(route)
        assert car.plans.latest.route_id == route.route_id
        # Commands come between the routes: none takes longer than the first.
        car.give_state()
        assert heats(car.commands.latest)
        assert time.thread_time() - before_s < 1.0


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
    car.send_route(target_battery_temperature=nan, route_id='no target')
    assert car.set(target_battery_temperature=11.5).successful
    assert car.plans.latest.target_battery_temperature == 11.5


def test_a_new_value_of_time_takes_effect_at_once(fresh_car):
    car = fresh_car
    car.send_route(target_battery_temperature=0.0, charger_power=150e3, segment_duration=[60.0] * 25, speed=[25.0],
                   propulsion_power=[15e3], ambient_temperature=[-8.0])
    car.send_state(temperature=6.0, percentage=0.375)
    assert car.plans.latest.status == Status.WAITING
    assert not car.set(value_of_time=-1.0).successful
    assert car.set(value_of_time=0.0).successful
    assert car.plans.latest.status == Status.NOT_WORTH_IT


def test_a_new_vehicle_takes_effect_at_once_and_its_assumed_values_are_warned_of(car):
    assert car.set(vehicle='mid_size_lfp').successful
    with car.feeding():
        entry = car.entry('preheating', lambda entry: entry.hardware_id == 'mid_size_lfp')
    assert 'battery resistance' in values_of(entry)['assumed of the vehicle'].split(', ')
    assert ('vehicle mid_size_lfp: 21 values are assumed, not measured; preheat vehicle check '
            in car.process.output())


def test_a_new_period_and_a_new_timeout_take_effect_at_once(car):
    assert car.set(command_period=0.05).successful
    car.commands.clear()
    stamps_s = [nanoseconds(command.header.stamp) / NS_PER_S
                for command in car.commands.wait_for_count(12)[1:]]
    assert stamps_s[-1] - stamps_s[0] < 10 * 0.5 * PERIOD_S
    assert car.set(battery_state_timeout=0.3).successful
    plan = car.plans.wait_for(lambda plan: plan.status == Status.STALE_INPUT)
    assert plan.explanation.endswith('less than 0.3 s are allowed.')
    assert 'In effect now: battery_state_timeout = 0.3.' in car.process.output()


def test_a_method_of_an_installed_package_plans_and_a_broken_one_is_refused(rehearsal, tmp_path, monkeypatch):
    installed_packages.put_example(tmp_path, 'fixed_minutes_method')
    (tmp_path / 'broken_method.py').write_text('def negative(situation):\n    return -situation.heater_limit_w\n')
    installed_packages.write_metadata(tmp_path, 'broken-method', {'negative': 'broken_method:negative'})
    installed_packages.use_folder(monkeypatch, tmp_path)
    car = Car(rehearsal, '-p', 'method:=last_20_minutes')
    # 30 min to a fast charger.
    car.send_route(segment_duration=[30.0] * 60, target_battery_temperature=12.0)
    car.give_state()
    plan = car.plans.latest
    assert (plan.method, plan.status) == ('last_20_minutes', Status.WAITING)
    assert sum(plan.hvch_power) * 30.0 == pytest.approx(1200.0 * FULL_POWER_W, rel=1e-3)
    described, = car.bench.call(DescribeParameters, '/planner/describe_parameters',
                                DescribeParameters.Request(names=['method'])).descriptors
    assert 'a method of an installed package' in described.additional_constraints
    assert car.set(method='last_25_minutes').reason == (
        "method: 'last_25_minutes' is not one of value_function, optimal_switch, paper, last_10_minutes, "
        'last_20_minutes, last_30_minutes, negative')
    assert car.set(method='negative').successful
    assert is_off_for(Status.INVALID_INPUT)(car.commands.latest)
    assert car.plans.latest.explanation.startswith(
        'method negative of package broken-method 1.0: the answer is refused: -5400 W')


def test_the_compiled_core_is_told_and_can_be_switched_off(car):
    assert re.search(r'with method \w+; native core used: \S+libbev_preheat_core\.so\.', car.process.output())
    assert car.set(compiled_core=False).successful
    with car.feeding():
        car.entry('preheating', lambda entry: values_of(entry)['compiled core'] == 'not used: switched off')


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
    result = car.set(**values)
    same = [a == b or (isnan(a) and isnan(b)) for a, b in zip(
        before, car.get_parameters(name))]
    assert (result.successful, same) == (False, [True])
    assert text.partition(':')[0] in result.reason
    # rclpy checks ranges itself, with its own messages.
    assert text in result.reason or 'range' in result.reason


@pytest.mark.parametrize('values, fit', [
    # Either alone is refused: the lease must be longer than the period.
    ({'command_period': 0.7, 'command_lease': 2.0}, True),
    ({'battery_state_timeout': 3.0, 'command_period': 0.9}, False)])
def test_several_parameters_hold_or_fail_together(car, values, fit):
    before = car.get_parameters(*values)
    assert car.set(SetParametersAtomically, **values).successful is fit
    assert car.get_parameters(*values) == (list(values.values()) if fit else before)


def test_each_number_is_described_with_its_unit_and_range(car):
    numbers = [parameter for parameter in PARAMETERS if parameter.limits]
    descriptors = car.bench.call(DescribeParameters, '/planner/describe_parameters', DescribeParameters.Request(
        names=[parameter.name for parameter in numbers])).descriptors
    for parameter, descriptor in zip(numbers, descriptors, strict=True):
        assert len(descriptor.description) > 10 and (
            descriptor.description.endswith(f'[{parameter.unit}]') or not parameter.unit)
        assert descriptor.floating_point_range or ' ... ' in descriptor.additional_constraints


# Diagnostics


def test_diagnostics_tell_the_figures(car):
    with car.feeding(lambda: car.state(temperature=-6.5, percentage=0.75)):
        values = values_of(car.entry('preheating', lambda entry: '-6.50' in values_of(entry).values()))
    assert {key: values[key] for key in (
        'vehicle', 'route_id', 'enabled', 'command [W]', 'battery temperature [degC]',
        'state of charge [1]')} == {
            'vehicle': 'reference', 'route_id': 'home', 'enabled': 'true',
            'command [W]': f'{FULL_POWER_W:.0f}', 'battery temperature [degC]': '-6.50',
            'state of charge [1]': '0.7500'}
