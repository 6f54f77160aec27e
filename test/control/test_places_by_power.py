# SPDX-License-Identifier: Apache-2.0
"""A vehicle that stands or is charged keeps its place on the route; its own plant is three lines of arithmetic."""

from dataclasses import replace

import pytest
from steady_drives import NOW_NS, steady_leg, VEHICLE

from bev_preheat.control.events import BatteryStateArrived, ProgressArrived, RouteArrived
from bev_preheat.control.inputs import Measurement, Mission, Progress, with_stops
from bev_preheat.control.regime import Regime
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

CONSUMERS_W, DRIVE_W = 2478.0, 15e3


def leg(minutes=40, departure=None):
    return steady_leg(
        60.0 * minutes, 60.0, speed_mps=[25.0], propulsion_power_w=[DRIVE_W], cabin_heating_power_w=None,
        auxiliary_power_w=None, target_temperature_c=None, departure=departure)


def with_a_stop(minutes=30):
    """Return legs of 5 min and of some minutes, with a stop of 5 min between them."""
    return with_stops((leg(5), leg(minutes, departure=BatteryState(20.0, 0.8))), (300.0,))


class Car:
    """The reference battery; for a minute or more, one state every two seconds. The heater obeys at once."""

    def __init__(self, legs=None, reports_power=True, temperature_c=5.0, soc=0.8):
        self.planner = Supervisor(VEHICLE, Settings())
        self.at_s, self.temperature_c, self.soc, self.reports_power = 0, temperature_c, soc, reports_power
        self.command_w, self.commands = 0.0, []
        # The sign of the current is known before the route arrives.
        for _ in range(60):
            self.go(1, 0.0, CONSUMERS_W)
        self.planner_step(RouteArrived(Mission('trip', tuple(
            replace(each, start_ns=each.start_ns + self.at_s * NS_PER_S) for each in legs or (leg(),)))))

    def planner_step(self, *events):
        output = self.planner.step(NOW_NS + self.at_s * NS_PER_S, *events)
        if output.command is not None:
            self.command_w = output.command.battery_heating_power_w

    def go(self, seconds, propulsion_w, consumers_w=CONSUMERS_W, charged_w=0.0, **measured):
        """Let time pass at a propulsion power, or a charging power [W] at the battery's terminals."""
        step_s = 2 if seconds >= 60 and seconds % 2 == 0 else 1
        for _ in range(seconds // step_s):
            self.at_s += step_s
            power_w = -charged_w if charged_w else propulsion_w + consumers_w + self.command_w
            self.soc -= step_s * power_w / (365.0 + 60.0) / VEHICLE.battery.capacity_as
            self.temperature_c += step_s * (0.87 * self.command_w + 0.08 * abs(propulsion_w) - 48.0 * (
                self.temperature_c + 7.0)) / 377376.0
            resistance_ohm = 4.3125 / (self.temperature_c + 45.0)
            volts = 365.0 + 75.0 * self.soc + 15.0 * self.soc**3 - resistance_ohm * power_w / 425.0
            self.planner_step(BatteryStateArrived(Measurement(
                BatteryState(self.temperature_c, self.soc), NOW_NS + self.at_s * NS_PER_S,
                *((volts, power_w / volts) if self.reports_power else (None, None)), **measured)))
            self.commands.append((self.at_s, step_s, self.command_w))

    def tell(self, distance_m):
        self.planner_step(ProgressArrived(Progress(distance_m, NOW_NS + self.at_s * NS_PER_S, 'trip')))

    def heated_s(self, from_s):
        return sum(step_s for at_s, step_s, power_w in self.commands if at_s >= from_s and power_w > 0.0)

    @property
    def delay_s(self):
        return self.planner.state.mission.delay_ns / NS_PER_S


def test_an_early_charger_is_recognised_and_not_heated_at():
    # So cold that it heats until arrival.
    car = Car((leg(12),), temperature_c=-5.0)
    car.go(6 * 60, DRIVE_W)
    assert car.command_w > 0.0
    plugged_s = car.at_s
    car.go(10, 0.0, charged_w=90e3)
    assert (car.planner.state.regime.regime, car.command_w) == (Regime.CHARGING, 0.0)
    assert car.planner.state.decision.status is Status.CHARGING
    assert '90000 W' in car.planner.state.decision.explanation
    car.go(300, 0.0, charged_w=90e3)
    assert car.heated_s(plugged_s + 10) == 0
    # After two minutes the leg has ended.
    assert car.planner.state.decision.status is Status.ARRIVED
    assert car.planner.state.estimate.heater.heater.value == 'answers'
    # A route plan of a moment before that end, which was seen, is of the same trip.
    car.planner_step(RouteArrived(Mission('trip', (replace(
        leg(30), start_ns=NOW_NS + (plugged_s - 60) * NS_PER_S),))))
    car.go(200, DRIVE_W)
    assert (car.heated_s(plugged_s + 10), car.planner.state.decision.status) == (0, Status.ARRIVED)


def test_charging_on_the_way_is_a_stop_that_nobody_planned():
    car = Car((leg(60),))
    car.go(4 * 60, DRIVE_W)
    car.go(300, 0.0, charged_w=50e3)
    assert car.planner.state.decision.status is Status.CHARGING
    car.go(60, 0.0)
    car.go(30, DRIVE_W)
    # 5 min of charging and 1 min of standing, less the seconds of recognition.
    assert car.delay_s == pytest.approx(360.0, abs=15.0)
    assert car.planner.state.decision.status in (Status.WAITING, Status.HEATING)


def test_a_descent_that_no_route_knows_is_taken_back():
    car = Car((leg(60),))
    car.go(200, DRIVE_W)
    car.go(200, 0.0, charged_w=18e3)
    assert car.planner.state.regime.regime is Regime.CHARGING
    car.go(30, DRIVE_W)
    assert (car.planner.state.regime.regime, car.delay_s) == (Regime.DRIVING, 0.0)


def test_a_place_in_steps_of_a_kilometre_is_no_fault_of_the_heater():
    car, suspected = Car((leg(45),), reports_power=False, temperature_c=2.0), set()
    for driven_s in range(1, 2000):
        # A fifth more than planned, in hills.
        car.go(1, DRIVE_W * (1.56 if driven_s // 60 % 2 else 0.84))
        car.tell(1000.0 * (25 * driven_s // 1000))
        suspected.add(car.planner.state.estimate.heater.suspected)
    assert suspected == {None} and car.heated_s(0) > 900


def test_a_parked_car_is_not_heated_for_longer_than_stated():
    car = Car()
    car.go(300, DRIVE_W)
    parked_s = car.at_s
    car.go(600, 0.0, 0.0)
    assert car.heated_s(parked_s) <= 182
    state = car.planner.state
    assert (state.regime.regime, state.decision.status) == (Regime.STANDING, Status.WAITING)
    assert 'has stood for 10:' in state.decision.explanation or 'has stood for 9:' in state.decision.explanation
    assert car.delay_s == pytest.approx(600.0 - 60.0, abs=3.0)
    # It drives on: the rest of the route is the same, and is heated.
    car.go(10, DRIVE_W)
    assert car.delay_s == pytest.approx(540.0, abs=8.0)
    driving_s = car.at_s
    car.go(300, DRIVE_W)
    assert car.heated_s(driving_s) > 60


def test_a_position_that_moves_outranks_the_power():
    car = Car((leg(60),))
    for second in range(300):
        car.go(1, 0.0, charged_w=18e3)
        car.tell(25.0 * second)
    assert (car.planner.state.regime.regime, abs(car.delay_s) < 3.0) == (Regime.DRIVING, True)


@pytest.mark.parametrize('has_position', [True, False])
def test_a_stop_that_is_reached_early_begins_early_and_the_drive_goes_on_from_there(has_position):
    car = Car(with_a_stop(), soc=0.6)

    def go_to(place_m, from_m, seconds, **power):
        for second in range(1, seconds + 1):
            car.go(1, **power)
            if has_position:
                car.tell(from_m + (place_m - from_m) * second / seconds)

    # The charger is 70 m before the place to which the navigation leads.
    go_to(7430.0, 0.0, 240, propulsion_w=DRIVE_W)
    go_to(7430.0, 7430.0, 150, propulsion_w=0.0, charged_w=50e3)
    assert (car.planner.state.decision.status, car.delay_s) == (Status.CHARGING, pytest.approx(-52.0, abs=10.0))
    # The battery state alone, as positions end.
    car.go(90, 0.0, charged_w=50e3)
    car.go(60, 0.0)
    assert car.delay_s == pytest.approx(-52.0, abs=10.0)
    go_to(15000.0, 7500.0, 300, propulsion_w=DRIVE_W)
    assert car.delay_s == pytest.approx(-60.0, abs=15.0)
    assert car.planner.state.decision.status in (Status.WAITING, Status.HEATING)


def test_a_position_corrects_an_arrival_that_charging_told():
    car = Car(with_a_stop(), soc=0.6)
    car.tell(0.0)
    car.go(240, DRIVE_W)
    car.go(180, 0.0, charged_w=50e3)
    assert car.delay_s == pytest.approx(-60.0, abs=5.0)
    car.tell(5000.0)
    # Planned after 200 s, it was there after 420 s.
    assert car.delay_s == pytest.approx(220.0, abs=5.0)


def test_at_a_stop_that_lasts_longer_the_next_leg_waits_also_a_short_one():
    car = Car(with_a_stop(10), soc=0.4, temperature_c=-5.0)
    car.go(5 * 60, DRIVE_W)
    # It is charged for 10 min longer than planned, and the 10 min of the next leg are near its end.
    car.go(900, 0.0, charged_w=50e3)
    assert car.delay_s == pytest.approx(600.0, abs=15.0)
    assert car.planner.state.decision.status is Status.CHARGING
    car.go(60, 0.0)
    driven_s = car.at_s
    car.go(300, DRIVE_W)
    assert car.planner.state.decision.status is Status.TARGET_UNREACHABLE
    assert car.heated_s(driven_s) >= 280


def test_what_the_model_does_not_describe_teaches_nothing():
    car = Car()
    car.go(10 * 60, DRIVE_W)
    before = car.planner.state.estimate
    car.go(300, 0.0, charged_w=90e3)
    after = car.planner.state.estimate
    # The factors and the heater are as they were, within the recognition.
    assert after.log_factors == pytest.approx(before.log_factors, abs=0.02)
    assert after.heater.probability == pytest.approx(before.heater.probability, abs=0.05)
    assert after.temperature_c == pytest.approx(car.temperature_c, abs=0.5)


def test_without_voltage_and_current_the_charge_tells_the_charger():
    car = Car((leg(12),), temperature_c=-5.0, reports_power=False)
    car.go(6 * 60, DRIVE_W)
    assert car.command_w > 0.0
    plugged_s = car.at_s
    car.go(300, 0.0, charged_w=90e3)
    assert car.heated_s(plugged_s) < 150
    assert car.planner.state.decision.status is Status.ARRIVED
    assert car.planner.state.estimate.temperature_c == pytest.approx(car.temperature_c, abs=1.0)


def test_without_voltage_and_current_a_charge_on_the_way_is_a_stop():
    car = Car((leg(60),), reports_power=False)
    car.go(4 * 60, DRIVE_W)
    car.go(300, 0.0, charged_w=90e3)
    assert (car.planner.state.decision.status, car.command_w) == (Status.CHARGING, 0.0)
    car.go(300, DRIVE_W)
    # The end is seen when the charge has fallen, and then when it was.
    assert car.planner.state.regime.regime is Regime.UNKNOWN
    assert car.delay_s == pytest.approx(300.0, abs=15.0)


def test_without_voltage_and_current_a_stand_that_is_seen_late_has_taught_nothing():
    # For 4 min it stands heated and seems to drive: without the heat of driving, less than the model expects.
    car = Car((leg(40),), temperature_c=-5.0, reports_power=False)
    car.go(20 * 60, DRIVE_W)
    before = car.planner.state.estimate
    while car.planner.state.regime.regime is not Regime.STANDING:
        car.go(10, 0.0, 500.0)
    after = car.planner.state.estimate
    assert car.command_w > 0.0 and car.at_s < 30 * 60
    assert after.log_factors == pytest.approx(before.log_factors, abs=0.05)
    assert after.heater.probability == pytest.approx(before.heater.probability, abs=0.01)
    assert after.temperature_c == pytest.approx(car.temperature_c, abs=0.5)


def test_without_voltage_and_current_a_car_is_not_heated_for_hours_where_it_is_parked():
    car = Car((leg(120),), temperature_c=-5.0, reports_power=False)
    car.go(10 * 60, DRIVE_W)
    assert (car.planner.state.regime.regime, car.delay_s) == (Regime.UNKNOWN, 0.0)
    parked_s = car.at_s
    car.go(3 * 3600, 0.0, 200.0)
    state = car.planner.state
    assert (state.regime.regime, state.decision.status) == (Regime.STANDING, Status.WAITING)
    assert car.heated_s(parked_s) < 30 * 60
    assert car.delay_s == pytest.approx(3 * 3600.0 - 60.0, abs=200.0)
    car.go(600, DRIVE_W)
    assert car.planner.state.regime.regime is Regime.UNKNOWN
    assert car.delay_s == pytest.approx(3 * 3600.0, abs=400.0)
