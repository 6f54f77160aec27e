# SPDX-License-Identifier: Apache-2.0
"""
The whole trip: the installed planner and the simulated vehicle, each closing the other's loop.

Some minutes in the cold in lockstep, so that it is the same drive on every computer; `make test-deep` also drives
a quarter of an hour and the paper's hour, and kills the planner at 100 times real time (daily, in process, in
test_heater_answers.py). There the planner's lease and clock tolerance are longer than usual: 1 s of simulated time
is 10 ms, and a busy computer may take longer than that to deliver a command, or /clock after the state of that
instant.
"""

from dataclasses import dataclass
import signal

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.simulated_drive import outcome_from_diagnostics
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState as State
from bev_preheat.planning.situation import Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan

SPEED_UP = 100
TARGET_C = 25.0
LEASE_S = 20.0
# Best effort, and no state is dropped while the test is held up.
MANY = QoSProfile(depth=1000, reliability=qos_profile_sensor_data.reliability)
# On a busy computer simulated time slows down.
TRIP_LIMIT_S = 240.0
START_S = 1_700_000_000
PLANNER = ('-p', 'use_sim_time:=true')
PATIENT = ('-p', f'command_lease:={LEASE_S}', '-p', 'command_period:=5.0', '-p', 'battery_state_timeout:=60.0',
           '-p', 'clock_tolerance:=10.0')
SIMULATOR = ('-p', 'vehicle:=reference', '-p', 'initial_soc:=0.9', '-p', f'start_time:={START_S}.0',
             '-p', 'exit_on_arrival:=true')
# This listener is waited for, too, so it receives every message of a drive in lockstep.
LOCKSTEP = ('-p', 'lockstep:=true', '-p', 'wait_for_listeners:=2')
ACCELERATED = ('-p', 'wait_for_planner:=true', '-p', f'speed_up:={float(SPEED_UP)}',
               '-p', 'battery_state_period:=5.0')
# Error of a plan at the start, which is made in steps of 30 s.
START_TOLERANCE_S = 90.0
ROUTE = """duration_s,speed_mps,propulsion_power_w,propulsion_power_rms_w,ambient_temperature_c
{third},14,12000,16000,-7
{third},25,24000,27000,-7
{third},20,18000,20000,-7
"""


@dataclass(frozen=True)
class Drive:
    """A route by name, or none for ROUTE, that is driven from a battery temperature."""

    route: str
    duration_s: float
    temperature_c: float


# Each leaves time to wait before it heats.
DRIVES = {'some minutes': Drive('', 450.0, 23.0),
          'quarter of an hour': Drive('', 900.0, 20.0),
          'hour of the paper': Drive('reference', 3600.0, -7.0)}


def on_the_way_s(stamp):
    """Return the instant of a stamp on the trip [s]."""
    return (nanoseconds(stamp) - START_S * NS_PER_S) / NS_PER_S


def write_quarter(folder, duration_s=900.0):
    """Write a route of a quarter of an hour, or of another duration; returns the file."""
    path = folder / 'quarter.csv'
    path.write_text(ROUTE.format(third=duration_s / 3.0))
    return path


class Trip:
    """The messages of the trip."""

    def __init__(self, bench, route, temperature_c, in_lockstep=True):
        self.route, self.temperature_c = route, temperature_c
        self.commands = bench.record(HvchCommand, 'hvch_command', 1000)
        self.plans = bench.record(PreheatPlan, 'preheat_plan', 1000)
        self.diagnostics = bench.record(DiagnosticArray, '/diagnostics', 1000)
        self.states = bench.record(BatteryState, 'battery_state', MANY)
        self.planner = bench.start('planner', *PLANNER, *(() if in_lockstep else PATIENT))
        # The simulator waits for the planner, not for listeners: nodes may take seconds to find each other,
        # and minutes of the drive pass meanwhile.
        self.commands.wait_for_publisher()
        self.plans.wait_for_publisher()
        self.simulator = bench.start(
            'vehicle_simulator', *SIMULATOR, *(LOCKSTEP if in_lockstep else ACCELERATED), '-p',
            f'route:={route}', '-p', f'initial_battery_temperature:={temperature_c}')

    def powers(self):
        """Return (instant on the way [s], power [W], reason) of each command, in order."""
        return [(on_the_way_s(command.header.stamp), command.battery_heating_power, command.reason)
                for command in self.commands.messages]

    def heated_first_s(self):
        return next(instant_s for instant_s, power_w, _ in self.powers() if power_w > 0.0)


@pytest.fixture(scope='module', params=[
    pytest.param(name, marks=[pytest.mark.deep] * (name != 'some minutes')) for name in DRIVES])
def trip(request, module_bench, tmp_path_factory):
    """Return the trip once it is over."""
    drive = DRIVES[request.param]
    route = drive.route or write_quarter(tmp_path_factory.mktemp('route'), drive.duration_s)
    trip = Trip(module_bench, route, drive.temperature_c)
    trip.duration_s = drive.duration_s
    assert trip.simulator.wait(TRIP_LIMIT_S) == 0, trip.simulator.output()
    # The last messages may still be on their way.
    trip.states.wait_for(lambda state: on_the_way_s(state.header.stamp) >= trip.duration_s, 'the arrival')
    trip.commands.wait_for(lambda command: command.reason == Status.ARRIVED, 'the end')
    yield trip
    trip.planner.end()


def test_it_drives_the_whole_route_and_arrives_as_the_plan_at_the_start_said(trip):
    arrival = trip.states.messages[-1]
    assert on_the_way_s(arrival.header.stamp) >= trip.duration_s
    assert arrival.temperature == pytest.approx(TARGET_C, abs=1.0)
    plan = next(plan for plan in trip.plans.messages if plan.status == Status.WAITING)
    assert arrival.temperature == pytest.approx(plan.predicted_arrival_temperature, abs=1.0)
    assert trip.planner.exit_status is None


def test_it_heats_between_what_the_plan_at_the_start_said_and_what_is_enough_for_a_known_vehicle(trip):
    # The plan at the start has a lead for its uncertainty, which shrinks each minute.
    said = next(plan for plan in trip.plans.messages if plan.status == Status.WAITING)
    vehicle = load_vehicle('reference')
    known = plan_preheating(
        vehicle, load_route(str(trip.route), vehicle.defaults), State(trip.temperature_c, 0.9), Goal(TARGET_C),
        method='optimal_switch')
    assert (on_the_way_s(said.heating_start) - START_TOLERANCE_S <= trip.heated_first_s()
            <= known.heating_start_s + START_TOLERANCE_S)


def test_it_heats_for_a_reason_without_switching_on_and_off_and_is_off_after_arrival(trip):
    assert {reason for _, power_w, reason in trip.powers() if power_w > 0.0} <= {
        Status.HEATING, Status.TARGET_UNREACHABLE}
    on = [power_w > 0.0 for instant_s, power_w, _ in trip.powers() if instant_s < trip.duration_s]
    # It may pause once, until it is known how much more heat is needed.
    assert 1 <= sum(not before and after for before, after in zip(on, on[1:])) <= 2
    late = [(power_w, reason) for instant_s, power_w, reason in trip.powers()
            if instant_s >= trip.duration_s]
    assert late and set(late) == {(0.0, int(Status.ARRIVED))}


@pytest.mark.deep
def test_a_planner_killed_while_heating_leaves_no_heat_after_the_lease(bench, tmp_path):
    # So cold that it is heated at once.
    trip = Trip(bench, write_quarter(tmp_path), -25.0, in_lockstep=False)
    first = trip.commands.wait_for(
        lambda command: command.battery_heating_power > 0.0, 'heating')
    heated_first_s = on_the_way_s(first.header.stamp)
    trip.states.wait_for(
        lambda state: on_the_way_s(state.header.stamp) > heated_first_s + 30.0, 'half a minute later')
    trip.planner.send_signal(signal.SIGKILL)
    assert trip.planner.wait() == -signal.SIGKILL
    lease_end_s = max(on_the_way_s(command.valid_until) for command in trip.commands.messages
                      if command.battery_heating_power > 0.0)

    def heat_wh_after(instant_s):
        """Return the total heat of the simulated battery up to this time [Wh]."""
        outcome = outcome_from_diagnostics(trip.diagnostics.wait_for(
            lambda array: outcome_from_diagnostics(array)
            and on_the_way_s(array.header.stamp) > instant_s))
        return outcome.energy_wh.hvch_heat

    heat_wh = heat_wh_after(lease_end_s)
    assert heat_wh > 0.0
    assert heat_wh_after(lease_end_s + 6.0 * LEASE_S) == heat_wh
