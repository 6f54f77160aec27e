# SPDX-License-Identifier: Apache-2.0
"""`vehicle_simulator`: drive, commands, parameters, and its clock, which one node publishes."""

import math

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from planner_car import command_at, LATCHED, set_parameters
import pytest
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.nodes.simulated_drive import ARRIVED, DRIVING, EMPTY, outcome_from_diagnostics
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState as Battery
from bev_preheat.planning.situation import Goal
from bev_preheat.route import make_route, save_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, RoutePlan

START_S = 1_700_000_000
START_NS = START_S * NS_PER_S
MANY = QoSProfile(depth=1000, reliability=qos_profile_sensor_data.reliability)
VEHICLE = load_vehicle('reference')


@pytest.fixture(scope='module')
def route(tmp_path_factory):
    """Three minutes; returns (Route, its file)."""
    route = make_route({
        'duration_s': [40.0, 75.0, 65.0], 'speed_mps': [9.0, 17.0, 28.0],
        'propulsion_power_w': [8e3, 21e3, 33e3], 'propulsion_power_rms_w': [11e3, 24e3, 33e3],
        'ambient_temperature_c': [-6.0, -8.0, -5.0],
        'cabin_heating_power_w': [2100.0, 1700.0, 900.0],
        'auxiliary_power_w': [450.0]}, VEHICLE.defaults)
    path = tmp_path_factory.mktemp('route') / 'three_minutes.csv'
    save_route(path, route, made_for='lorry')
    return route, path


@pytest.fixture
def start_simulator(rehearsal, route):
    def start_simulator(**parameters):
        values = {'route': route[1], 'start_time': float(START_S), 'initial_soc': 0.77,
                  'initial_battery_temperature': 4.0, **parameters}
        return rehearsal.start('vehicle_simulator', *(
            part for name, value in values.items() for part in ('-p', f'{name}:={value}')))
    return start_simulator


def seconds(stamp):
    return stamp.sec - START_S + stamp.nanosec * 1e-9


def outcome_at_the_end(diagnostics):
    return outcome_from_diagnostics(diagnostics.wait_for(
        lambda message: outcome_from_diagnostics(message).state != DRIVING, 'end of the drive'))


def test_the_route_is_there_for_late_joiners(rehearsal, start_simulator):
    clock = rehearsal.record(Clock, '/clock', MANY)
    start_simulator(minimum_arrival_soc=0.31, target_battery_temperature=19.0, charging_planned='false',
                    charger_power=150e3, charging_departure_soc=0.72)
    clock.wait_for(lambda message: seconds(message.clock) > 1.0)
    message = rehearsal.record(RoutePlan, 'route_plan', LATCHED).wait_for()
    assert message.header.stamp == Time(sec=START_S)
    assert message.route_id == 'three_minutes'
    assert list(message.segment_duration) == [40.0, 75.0, 65.0]
    assert list(message.propulsion_power_rms) == [11e3, 24e3, 33e3]
    assert list(message.cabin_heating_power) == [2100.0, 1700.0, 900.0]
    assert message.minimum_arrival_soc == 0.31
    assert message.target_battery_temperature == 19.0
    assert message.charging_planned is False
    assert (message.charger_power, message.charging_departure_soc) == (150e3, 0.72)


def test_time_runs_at_the_speed_asked_for_also_on_the_way_and_states_come_at_their_period(
        rehearsal, start_simulator):
    clock, states = rehearsal.record(Clock, '/clock', MANY), rehearsal.record(BatteryState, 'battery_state', MANY)
    simulator = start_simulator(battery_state_period=1.5)
    clock.wait_for(lambda message: seconds(message.clock) >= 5.9)
    stamps_s = [seconds(state.header.stamp) for state in states.messages]
    assert stamps_s == pytest.approx([0.0, 1.5, 3.0, 4.5], abs=0.05)
    assert 'out of range' in set_parameters(rehearsal, '/vehicle_simulator', speed_up=0.5).reason
    assert not set_parameters(rehearsal, '/vehicle_simulator', initial_soc=0.5).successful
    assert set_parameters(rehearsal, '/vehicle_simulator', speed_up=30.0).successful
    before_s = seconds(clock.latest.clock)
    rehearsal.advance(2.0)
    assert seconds(clock.latest.clock) - before_s == pytest.approx(60.0, abs=1.0)
    assert np.all(np.diff([seconds(message.clock) for message in clock.messages]) >= 0.0)
    assert 'slower than speed_up' not in simulator.output()


def test_the_clock_waits_for_all_listeners_and_without_commands_there_is_no_heat(
        rehearsal, route, start_simulator):
    states = rehearsal.record(BatteryState, 'battery_state', MANY)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 10)
    simulator = start_simulator(speed_up=100.0, wait_for_listeners=2, exit_on_arrival='true')
    assert {state.header.stamp.sec for state in states.wait_for_count(4)} == {START_S}
    rehearsal.record(BatteryState, 'battery_state', MANY)
    outcome = outcome_at_the_end(diagnostics)
    assert outcome.state == ARRIVED
    assert outcome.energy_wh.hvch_electric == outcome.energy_wh.hvch_heat == 0.0
    last = states.wait_for(lambda message: seconds(message.header.stamp) >= 180.0)
    plan = plan_preheating(VEHICLE, route[0].resampled(5.0), Battery(4.0, 0.77),
                           Goal(25.0, charging_planned=False))
    assert last.temperature == pytest.approx(plan.arrival_temperature_c, abs=1e-3)
    assert last.percentage == pytest.approx(plan.arrival_soc, abs=1e-5)
    assert outcome.energy_wh.battery_total == pytest.approx(plan.energy_wh.battery_total, rel=1e-4)
    assert simulator.wait() == 0


def test_commands_that_are_renewed_heat_on_until_the_lease_ends(rehearsal, start_simulator):
    states = rehearsal.record(BatteryState, 'battery_state', MANY)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 10)
    commands = rehearsal.publisher(HvchCommand, 'hvch_command', 1)
    start_simulator(speed_up=60.0, wait_for_planner='true')
    commands.wait_for_subscription()
    # The clock is held, so the lease lasts from the very start.
    commands.publish(command_at(START_NS, 3000.0, 90.0))
    states.wait_for(lambda message: seconds(message.header.stamp) >= 30.0)
    commands.publish(command_at(START_NS, 3000.0, 121.3))
    outcome = outcome_at_the_end(diagnostics)
    assert outcome.state == ARRIVED
    assert outcome.energy_wh.hvch_electric == pytest.approx(3000.0 * 121.3 / 3600.0, abs=1e-3)
    assert outcome.without_command_s == pytest.approx(180.0 - 121.3, abs=1e-3)


def test_battery_state_tells_what_is_known_and_nan_for_the_rest(rehearsal, start_simulator):
    start_simulator(wait_for_planner='true')
    message = rehearsal.record(BatteryState, 'battery_state', MANY).wait_for()
    assert message.header.stamp == Time(sec=START_S)
    assert message.temperature == pytest.approx(4.0)
    assert message.percentage == pytest.approx(0.77)
    assert message.charge == pytest.approx(0.77 * 200.0)
    assert message.design_capacity == pytest.approx(200.0)
    assert math.isnan(message.capacity)
    # Terminal power of the first segment, but for its ripple; negative current = discharging.
    assert message.voltage * message.current == pytest.approx(-(8e3 + 2100.0 + 450.0), rel=1e-2)
    assert message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_UNKNOWN
    assert message.present


def test_it_is_held_until_the_planner_has_route_and_battery(rehearsal, start_simulator):
    clock, commands = rehearsal.record(Clock, '/clock', MANY), rehearsal.publisher(HvchCommand, 'hvch_command', 1)
    start_simulator(wait_for_planner='true')
    for reason in (HvchCommand.NO_ROUTE, HvchCommand.NO_BATTERY_STATE):
        commands.publish(command_at(START_NS, 0.0, 2.5, reason=reason))
    assert {seconds(message.clock) for message in clock.wait_for_count(50)} == {0.0}
    commands.publish(command_at(START_NS, 0.0, 2.5, reason=HvchCommand.WAITING))
    clock.wait_for(lambda message: seconds(message.clock) > 0.0)


def test_empty_battery_ends_a_drive_whose_target_is_left_to_the_planner(rehearsal, start_simulator):
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 10)
    plans = rehearsal.record(RoutePlan, 'route_plan', LATCHED)
    rehearsal.record(BatteryState, 'battery_state', MANY)
    simulator = start_simulator(speed_up=100.0, initial_soc=0.004, wait_for_listeners=1,
                                target_battery_temperature='.nan', exit_on_arrival='true')
    plan = plans.wait_for()
    assert plan.charging_planned
    assert (plan.has_target_battery_temperature, plan.target_battery_temperature) == (False, 0.0)
    assert outcome_at_the_end(diagnostics).state == EMPTY
    assert simulator.wait() == 0
    assert 'The battery is empty after' in simulator.output()
    # The route is another vehicle's.
    assert ('route three_minutes has the powers of vehicle lorry; for reference: make it again'
            in simulator.output())


@pytest.mark.parametrize('parameters, complaint', [
    ({'initial_soc': 1.5}, 'initial_soc'),
    ({'initial_battery_temperature': -55.0},
     'battery temperature: -55 is not allowed; it must be -40 ... 60 degC'),
    ({'target_battery_temperature': 61.0}, 'target_battery_temperature: 61 degC is not allowed'),
    ({'route': 'nowhere'}, "route 'nowhere' is unknown"),
    ({'lockstep': 'true', 'speed_up': 20.0}, 'speed_up: 20.0 is not allowed with lockstep; it must be 1.0'),
])
def test_impossible_parameters_are_refused_in_words(refusal, parameters, complaint):
    assert complaint in refusal('vehicle_simulator', '--ros-args', *(
        part for name, value in parameters.items() for part in ('-p', f'{name}:={value}')))


@pytest.mark.parametrize('argument, text', [
    ('speed_up:=20.0', 'speed_up: 20.0 is not allowed with publish_clock:=false; it must be 1.0'),
    ('start_time:=1000.0', 'start_time: 1000.0 is not allowed with publish_clock:=false'),
    ('wait_for_planner:=true', 'wait_for_planner: True is not allowed with'),
    ('lockstep:=true', 'lockstep: True is not allowed with publish_clock:=false; it must be False'),
    ('scenario:=clock_back', 'scenario clock_back makes the clock jump')])
def test_what_only_the_owner_of_the_clock_can_do_is_refused(refusal, argument, text):
    assert text in refusal('vehicle_simulator', '--ros-args', '-p', 'publish_clock:=false', '-p', argument)


# The clock: a simulator ends if another node publishes one, or drives by it

@pytest.fixture
def errors(capsys):
    """`errors()` returns the lines with an error that the nodes of a rehearsal have printed."""
    return lambda: [line for line in capsys.readouterr().err.splitlines() if 'error:' in line]


def test_the_simulator_that_comes_later_ends_and_says_why(rehearsal, start_simulator, errors):
    clock, later_s = rehearsal.record(Clock, '/clock', MANY), START_S + 10_000
    first = start_simulator()
    # Long enough ago that the first node stays.
    clock.wait_for(lambda message: message.clock.sec > START_S + 3)
    second = rehearsal.start('vehicle_simulator', '-r', '__ns:=/car2', '-p', f'start_time:={later_s}.0')
    assert second.wait() == 2
    assert errors() == ['vehicle_simulator: error: /vehicle_simulator also publishes /clock; set '
                        'publish_clock:=false (and use_sim_time:=true) to drive by that clock']
    # Only the first clock keeps running.
    clock.clear()
    assert all(START_S <= message.clock.sec < later_s for message in clock.wait_for_count(100))
    assert first.exit_status is None


def test_a_running_simulator_ends_if_another_clock_appears_and_stays(rehearsal, start_simulator, errors):
    simulator = start_simulator()
    rehearsal.advance(3.0)
    clocks = rehearsal.publisher(Clock, '/clock')
    with rehearsal.repeating(lambda: clocks.publish(Clock(clock=Time(sec=1000))), 0.02):
        assert simulator.wait() == 2
    (line,) = errors()
    assert '/tester also publishes /clock' in line


def test_without_a_clock_of_its_own_it_can_drive_in_real_time(rehearsal):
    states = rehearsal.record(BatteryState, 'battery_state', MANY)
    rehearsal.start('vehicle_simulator', '-p', 'publish_clock:=false', '-p', 'battery_state_period:=0.1')
    began_ns = rehearsal.now_ns
    last = states.wait_for_count(3)[-1]
    # Neither simulated time nor another day's.
    assert began_ns <= nanoseconds(last.header.stamp) <= rehearsal.now_ns < began_ns + 2 * 10**9
    assert rehearsal.count_publishers('/clock') == 0


def test_a_clock_that_is_set_back_ends_a_drive_that_goes_by_it(rehearsal, errors):
    clocks = rehearsal.publisher(Clock, '/clock')
    states = rehearsal.record(BatteryState, 'battery_state', MANY)
    simulator = rehearsal.start(
        'vehicle_simulator', '-p', 'publish_clock:=false', '-p', 'use_sim_time:=true')
    for second in range(5):
        clocks.publish(Clock(clock=Time(sec=START_S + second)))
        rehearsal.advance(1.0)
    assert states.latest.header.stamp.sec > START_S
    clocks.publish(Clock(clock=Time(sec=1000)))
    assert simulator.wait() == 2
    (line,) = errors()
    assert 's; the drive cannot go back' in line
