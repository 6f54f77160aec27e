# SPDX-License-Identifier: Apache-2.0
"""The supervisor with estimation, on simulated cars: uncertainty, and heaters that do not obey."""

import re

import pytest
from stepwise import Stepwise

from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.simulation.heater import HeaterFault, HeaterLease
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle

pytestmark = pytest.mark.costly

VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults).before(1500.0)
GOAL = Goal(25.0)
# Of battery states, commands and plans.
PERIOD_S = 4.0
COARSE = Sensors(temperature_noise_k=0.2, temperature_resolution_k=1.0, period_s=PERIOD_S)
START_NS = 1000 * NS_PER_S


class Ride:
    """A car and the supervisor that heats its battery, every PERIOD_S."""

    def __init__(self, temperature_c=10.0, heater_faults=()):
        self.car = ImperfectCar(
            VEHICLE, DrivePhase(ROUTE, GOAL), BatteryState(temperature_c, 0.8),
            Imperfections(sensors=COARSE, heater_faults=heater_faults), seed=3)
        self.supervisor = Stepwise(VEHICLE, Settings())
        mission = self.car.mission(START_NS)
        leg, = mission.legs
        self.supervisor.accept_mission(Mission(mission.route_id, (
            Leg(leg.route.resampled(30.0), leg.start_ns, True, 25.0),)))
        self.command_w, self.seen = 0.0, []

    @property
    def now_ns(self):
        return START_NS + round(self.car.time_s * NS_PER_S)

    def until(self, to_s):
        """Simulate until an instant [s]; return the last Decision."""
        while self.car.time_s < to_s:
            for reading in self.car.readings():
                self.supervisor.accept_battery(Measurement(
                    BatteryState(reading.temperature_c, reading.soc), self.now_ns,
                    reading.voltage_v, reading.current_a), self.now_ns)
            decision = self.supervisor.replan(self.now_ns)
            self.command_w = self.supervisor.command(self.now_ns).battery_heating_power_w
            self.seen.append((self.car.time_s, decision, self.command_w))
            self.car.advance_under(
                HeaterLease(self.command_w, self.car.time_s + 2.0 * PERIOD_S),
                self.car.time_s + PERIOD_S)
        return decision


def limit_w(ride):
    route = ride.car.plant.route
    cabin_w = float(route.cabin_heating_power_w[route.segment_at(ride.car.time_s - PERIOD_S)])
    return VEHICLE.hvch.maximum_power_w - cabin_w


def test_the_plan_aims_at_the_target_and_no_further():
    healthy = Ride()
    healthy.until(1490.0)
    # While it heats, and can still stop in time.
    aimed_k = [decision.plan.arrival_temperature_c - 25.0 for at_s, decision, _ in healthy.seen
               if 600.0 < at_s < 1300.0 and decision.status is Status.HEATING]
    assert len(aimed_k) > 100
    assert min(aimed_k) > -0.01
    assert max(aimed_k) < 0.1


def test_a_dead_heater_is_asked_all_the_same_and_not_counted_on():
    ride = Ride(heater_faults=(HeaterFault(600.0, share=0.0),))
    assert ride.until(590.0).status is Status.HEATING
    decision = ride.until(1200.0)
    assert re.fullmatch(
        r'The heater does not respond to its command\. Driving alone does not warm the battery '
        r'enough: arrival in \d+:\d\d min at [\d.]+ degC, [\d.]+ K below the target 25\.0 degC\.',
        decision.explanation)
    assert decision.status is Status.TARGET_UNREACHABLE
    # The heater may recover, so it is still commanded at full power.
    assert ride.command_w == pytest.approx(limit_w(ride))
    cools_c = decision.plan.arrival_temperature_c
    assert cools_c < 24.0
    # No command changes the rest of the drive.
    ride.car.advance_under(HeaterLease(ride.command_w, 1490.0), 1490.0)
    assert ride.car.plant.temperature_c == pytest.approx(cools_c, abs=1.0)


def test_a_derated_heater_is_planned_with_its_real_power():
    ride = Ride(heater_faults=(HeaterFault(300.0, share=0.4),))
    decision = ride.until(1400.0)
    assert decision.explanation.startswith('The heater delivers only ')
    assert decision.command_share == pytest.approx(0.4, abs=0.1)
    # The command is the full power; the plan contains the power that the heater really delivers.
    assert ride.command_w == pytest.approx(limit_w(ride))
    assert decision.plan.hvch_battery_power_w.max() == pytest.approx(
        decision.command_share * limit_w(ride), rel=0.1)


def test_a_suspected_heater_is_said_to_be_so_before_it_is_reported():
    ride = Ride(heater_faults=(HeaterFault(300.0, share=0.4),))
    said = [ride.until(float(at_s)).explanation[:14] for at_s in range(290, 1400, 10)]
    first, told = said.index('The heater may'), said.index('The heater del')
    assert 5 < first < told
    assert ride.until(1410.0).explanation.startswith('The heater delivers only ')
    healthy = Ride()
    assert not any(
        healthy.until(float(at_s)).explanation.startswith('The heater') for at_s in range(290, 1400, 10))


def test_a_heater_that_is_stuck_on_is_commanded_off():
    ride = Ride(temperature_c=24.0, heater_faults=(HeaterFault(100.0, stuck_on=True),))
    decision = ride.until(800.0)
    assert decision.explanation.startswith('The heater heats without a command. ')
    assert ride.command_w == 0.0
    # The uncommanded heat is predicted.
    assert decision.plan.arrival_temperature_c > 30.0


def test_a_new_route_forgets_how_sure_the_old_one_was():
    ride = Ride()
    ride.until(200.0)
    supervisor = ride.supervisor
    unsure_k = supervisor.state.decision.forecast.as_planned_k
    leg = supervisor.state.mission.legs[0]
    short = Leg(leg.route.before(300.0), leg.start_ns, True, 25.0)
    supervisor.accept_mission(Mission('short', (short,)))
    decision = supervisor.replan(ride.now_ns)
    assert decision.forecast.as_planned_k < 0.5 * unsure_k
