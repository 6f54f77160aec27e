# SPDX-License-Identifier: Apache-2.0
"""Route plans on their way into a supervisor: the readable part of a refused plan, and the trip that it ends."""

from dataclasses import replace
from math import inf, nan

from builtin_interfaces.msg import Time
import pytest
from stepwise import Stepwise

from bev_preheat.control.events import Reconfigured
from bev_preheat.control.inputs import Measurement
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.inputs import RouteIntake
from bev_preheat.messages.route_plan import refused_route_of
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import RoutePlan

VEHICLE = load_vehicle('reference')
START_S = 1_700_000_000
NOW_NS = START_S * NS_PER_S
SETTINGS = Settings(estimation=False, minimum_on_time_s=0.0, minimum_off_time_s=0.0)


def route_message(stamp=Time(sec=START_S), **changed):
    """Return a route of 20 min that needs heat at once."""
    message = RoutePlan(**{
        'route_id': 'home', 'segment_duration': [30.0] * 40, 'speed': [20.0],
        'propulsion_power': [20e3], 'ambient_temperature': [-7.0], 'charging_planned': True,
        'target_battery_temperature': 25.0, **changed})
    message.header.stamp = stamp
    return message


# Readable parts

def arrivals_s(**changed):
    arrivals_ns = refused_route_of(route_message(**changed)).arrivals_ns
    return None if arrivals_ns is None else [
        (arrival_ns - NOW_NS) / NS_PER_S for arrival_ns in arrivals_ns]


@pytest.mark.parametrize('changed, expected', [
    ({}, [1200.0]), ({'segment_duration': [10.0, 20.0, 30.5]}, [60.5]),
    ({'stamp': Time(sec=START_S + 7, nanosec=500_000_000)}, [1207.5]),
    # One duration for all, whose number the other arrays agree on.
    ({'segment_duration': [30.0], 'speed': [20.0] * 5}, [150.0]),
    # Other errors do not matter.
    ({'speed': [-1.0]}, [1200.0]), ({'propulsion_power': [nan]}, [1200.0]),
    ({'speed': [20.0] * 39}, [1200.0]), ({'minimum_arrival_soc': 7.0}, [1200.0]),
    ({'stop_after_segment': [9, 19], 'stop_duration': [600.0, 60.0]}, [300.0, 1200.0, 1860.0]),
    ({'stop_after_segment': [9], 'stop_duration': [600.0], 'departure_soc': [9.0]},
     [300.0, 1800.0])])
def test_arrivals_that_can_be_read(changed, expected):
    assert arrivals_s(**changed) == pytest.approx(expected)


@pytest.mark.parametrize('changed', [
    {'segment_duration': []}, {'segment_duration': [30.0] * 39 + [nan]},
    {'segment_duration': [30.0] * 39 + [-30.0]}, {'segment_duration': [inf]},
    # Either of the two may be right.
    {'segment_duration': [30.0] * 39, 'speed': [20.0] * 40},
    {'segment_duration': [30.0], 'speed': [20.0] * 5, 'propulsion_power': [1e3] * 6},
    {'speed': [20.0] * 200_001}, {'stamp': Time()}, {'stamp': Time(sec=-5)},
    {'stamp': Time(sec=START_S, nanosec=10**9)},
    {'stop_after_segment': [9]}, {'stop_duration': [60.0]},
    {'stop_after_segment': [9, 9], 'stop_duration': [60.0, 60.0]},
    {'stop_after_segment': [39], 'stop_duration': [60.0]},
    {'stop_after_segment': [9], 'stop_duration': [nan]},
    {'stop_after_segment': list(range(21)), 'stop_duration': [60.0] * 21}])
def test_arrivals_that_cannot_be_read(changed):
    assert arrivals_s(**changed) is None


# Effects

class Driver:
    """An intake, and the supervisor behind it, that heats."""

    def __init__(self):
        self.supervisor = Stepwise(VEHICLE, SETTINGS)
        self.intake = RouteIntake()
        self.take(route_message())
        assert self.fed(0.0)[0] > 0.0

    def fed(self, second):
        """Return (power [W], reason) after a good state at a second."""
        now_ns = NOW_NS + round(second * NS_PER_S)
        self.supervisor.accept_battery(Measurement(BatteryState(-7.0, 0.8), now_ns), now_ns)
        self.supervisor.replan(now_ns)
        command = self.supervisor.command(now_ns)
        return command.battery_heating_power_w, command.reason

    def take(self, message):
        """Pass a message to the supervisor; raise its refusal."""
        self.supervisor.run(NOW_NS, self.intake.read(message, self.supervisor.state.inbox))

    def configure(self, settings=SETTINGS):
        """Set parameters, as the node does."""
        vehicle = self.supervisor.state.vehicle
        self.supervisor.run(NOW_NS, Reconfigured(
            vehicle, settings, self.intake.read_again(self.supervisor.state.inbox, vehicle, settings)))

    def refused(self, **changed):
        with pytest.raises(InvalidInput):
            self.take(route_message(**changed))


@pytest.fixture
def driver():
    return Driver()


def test_a_route_that_nobody_foresaw_ends_the_one_before_it(driver, monkeypatch):
    def fail(*_):
        raise MemoryError
    monkeypatch.setattr('bev_preheat.messages.inputs.mission_from_message', fail)
    with pytest.raises(InvalidInput, match='MemoryError'):
        driver.take(route_message(route_id='work'))
    assert driver.fed(1.0) == (0.0, Status.INVALID_INPUT)
    assert driver.supervisor.state.inbox.refused_route.startswith(
        'route_plan refused: cannot be read: MemoryError. ')


def test_other_parameters_do_not_bring_back_a_route_that_a_refused_one_has_ended(driver):
    driver.refused(route_id='work', speed=[-1.0])
    driver.configure(replace(SETTINGS, clock_tolerance_s=0.75))
    # Heat waits for 10 s after doubt.
    assert {driver.fed(second) for second in range(1, 13)} == {(0.0, Status.INVALID_INPUT)}
    assert driver.supervisor.state.mission is None


def test_a_route_that_does_not_fit_a_vehicle_comes_back_with_one_that_it_fits(driver):
    narrow = replace(VEHICLE, battery=replace(VEHICLE.battery, temperature_range_c=(-5.0, 60.0)))
    mission = driver.supervisor.state.mission
    for vehicle, has_mission in ((narrow, False), (VEHICLE, True)):
        settings = driver.supervisor.state.settings
        again = driver.intake.read_again(driver.supervisor.state.inbox, vehicle, settings)
        driver.supervisor.step_through(NOW_NS, Reconfigured(vehicle, settings, again))
        assert (driver.supervisor.state.mission is not None) == has_mission
    assert driver.supervisor.state.mission.route_id == mission.route_id


def test_a_route_that_cannot_be_read_with_new_parameters_is_dropped_until_it_can(
        driver, monkeypatch):
    def fail(*_):
        raise InvalidInput('speed: cannot be')
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr('bev_preheat.messages.inputs.mission_from_message', fail)
        with pytest.raises(InvalidInput, match='speed: cannot be'):
            driver.configure(replace(SETTINGS, command_lease_s=1.0))
        assert driver.fed(1.0) == (0.0, Status.INVALID_INPUT)
    driver.configure()
    assert [driver.fed(second)[0] for second in (2.0, 6.0, 9.0)] == [0.0] * 3
    assert driver.fed(11.1)[0] > 0.0
