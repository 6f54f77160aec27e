# SPDX-License-Identifier: Apache-2.0
"""One drive: its commands, its counters, and the cost of a drive planned with the true car."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
from short_drives import short_conditions

from bev_preheat.control.decision import Command, Decision
from bev_preheat.control.events import RouteArrived
from bev_preheat.control.settings import Settings
from bev_preheat.control.step import StepOutput
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.robustness import drives
from bev_preheat_studies.robustness.drawn_cars import draw_car
from bev_preheat_studies.robustness.drives import drive_informed, drive_with_planner

CONDITIONS = short_conditions()
# Heater power left by the cabin [W].
LIMIT_W = 7000.0 - 1500.0
MEASURED = Settings(estimation=False)


def make_car(conditions=CONDITIONS, mismatch=Mismatch(), make=ImperfectCar):
    return make(conditions.vehicle, conditions.routes[0], conditions.state, conditions.goal,
                Imperfections(mismatch, sensors=Sensors(period_s=conditions.period_s)), seed=1)


def every_two_seconds(settings):
    return replace(settings, command_period_s=2.0)


class Script:
    """Takes steps like a Supervisor; each battery state is answered with the next of some powers."""

    def __init__(self, settings, powers_w, valid_for_s):
        self.heard = []
        self.state = SimpleNamespace(settings=settings, estimate=None, decision=Decision(Status.HEATING, ''))
        self._powers_w, self._power_w = list(powers_w), 0.0
        self._valid_for_ns, self._until_ns = round(valid_for_s * 1e9), 0

    def step(self, now_ns, *events):
        for event in events:
            if isinstance(event, RouteArrived):
                self.mission = event.mission
                return StepOutput()
            self.heard.append((event.measurement, now_ns))
            self._power_w = self._powers_w.pop(0) if self._powers_w else 0.0
            self._until_ns = now_ns + self._valid_for_ns
        return StepOutput(Command(self._power_w, self._until_ns, Status.HEATING))


@pytest.fixture
def scripted(monkeypatch):
    def drive(powers_w, period_s=2.0, valid_for_s=60.0, settings=MEASURED, **changed):
        settings = replace(settings, command_period_s=period_s, battery_state_timeout_s=60.0)
        script = Script(settings, powers_w, valid_for_s)
        monkeypatch.setattr(drives, 'Supervisor', lambda vehicle, settings: script)
        conditions = replace(short_conditions(period_s), **changed)
        return *drive_with_planner(make_car(conditions), conditions.goal, settings), script
    return drive


def test_switchings_are_counted_from_nothing_to_something(scripted):
    drive, _, _ = scripted([0.0, 1000.0, 4000.0, 0.0, 0.0, 5500.0, 0.0, 300.0])
    assert (drive.switch_ons, drive.first_switch_on_s) == (3, 2.0)


def test_drive_without_heating_has_no_first_switch_on(scripted):
    drive, _, _ = scripted([])
    assert (drive.switch_ons, drive.first_switch_on_s, drive.partial_duty_s) == (0, None, 0.0)
    assert drive.heating_energy_wh == 0.0


def test_partial_duty_is_less_than_95_per_cent_of_what_the_cabin_leaves(scripted):
    drive, _, _ = scripted([1.0, 0.0, 0.949 * LIMIT_W, 0.951 * LIMIT_W, LIMIT_W])
    assert drive.partial_duty_s == 4.0


def test_partial_duty_ends_on_arrival(scripted):
    # 480 s are no multiple of 7 s.
    drive, _, _ = scripted([900.0] * 100, period_s=7.0)
    assert drive.partial_duty_s == pytest.approx(480.0)
    assert drive.updates == 69


def test_car_heats_what_is_commanded(scripted):
    powers_w = [0.0, 1000.0, 4000.0, 2500.0]
    drive, course, _ = scripted(powers_w)
    assert drive.heating_energy_wh == pytest.approx(sum(powers_w) * 2.0 / 3600.0)
    assert course.command_w[:5].tolist() == [*powers_w, 0.0]
    assert len(course.time_s) == drive.updates == 240


def test_car_heats_no_longer_than_the_command_is_valid(scripted):
    drive, _, _ = scripted([1000.0, 1000.0], valid_for_s=0.5)
    assert drive.heating_energy_wh == pytest.approx(2 * 1000.0 * 0.5 / 3600.0)


def test_planner_hears_each_reading_once_when_it_is_taken(scripted):
    _, course, script = scripted([3000.0] * 100)
    stamps_s = [(measurement.stamp_ns - script.mission.start_ns) / 1e9
                for measurement, _ in script.heard]
    assert stamps_s == [2.0 * number for number in range(240)]
    assert all(measurement.stamp_ns == now_ns for measurement, now_ns in script.heard)
    heard_c = [measurement.state.temperature_c for measurement, _ in script.heard]
    assert heard_c == course.true_c.tolist() == course.measured_c.tolist()
    assert all(measurement.power_w > 17e3 for measurement, _ in script.heard)


def test_route_is_planned_in_steps_of_the_settings(scripted):
    route = CONDITIONS.routes[0]
    fine = replace(route, **{name: np.repeat(values, 10) for name, values in asdict(route).items()})
    fine = replace(fine, duration_s=fine.duration_s / 10.0)
    _, _, script = scripted([], settings=replace(MEASURED, planning_step_s=60.0), routes=(fine,))
    assert script.mission.legs[0].route.duration_s.tolist() == [60.0] * 8


@pytest.mark.costly
@pytest.mark.parametrize('settings', [pytest.param(MEASURED, marks=pytest.mark.deep), Settings()])
def test_perfect_car_arrives_at_its_target_as_predicted(settings):
    drive, course = drive_with_planner(make_car(), CONDITIONS.goal, every_two_seconds(settings))
    # The estimating planner adds a margin for the uncertainty.
    assert -0.1 < drive.arrival_error_k < 0.3
    # The last prediction is made two seconds before.
    assert course.predicted_arrival_c[-1] == pytest.approx(
        18.0 + drive.arrival_error_k, abs=0.1)
    assert np.isfinite(course.estimated_c).all() == settings.estimation
    assert (drive.refused_inputs, drive.updates_without_plan, drive.ran_empty) == (0, 0, False)


def test_energies_add_up_to_what_the_battery_gave():
    drive, _ = drive_with_planner(make_car(), CONDITIONS.goal, every_two_seconds(MEASURED))
    driving_wh = (17e3 + 1500.0 + 400.0) * 480.0 / 3600.0
    # The rest is Joule heat: some 20 kW at 400 V and 4.3125 / 60 ohm, and the rms of the power.
    joule_wh = ((19e3 + 1900.0) / 430.0)**2 * 4.3125 / 61.0 * 480.0 / 3600.0
    assert drive.battery_energy_wh == pytest.approx(
        driving_wh + drive.heating_energy_wh + joule_wh, rel=0.01)


class CarWithBadReadings(ImperfectCar):
    """Reports an impossible state of charge from 100 s on, until 200 s."""

    def readings(self):
        return [replace(reading, soc=1.5) if 100.0 <= reading.instant_s < 200.0 else reading
                for reading in super().readings()]


def test_refused_readings_are_counted_and_keep_the_heater_off():
    # Cold enough to heat all the way.
    conditions = short_conditions(state=BatteryState(5.0, 0.8))
    car = make_car(conditions, make=CarWithBadReadings)
    drive, course = drive_with_planner(car, conditions.goal, every_two_seconds(MEASURED))
    assert drive.refused_inputs == drive.updates_without_plan == 50
    bad = (course.time_s >= 100.0) & (course.time_s < 200.0)
    assert (course.command_w[bad] == 0.0).all() and (course.command_w[~bad] > 0.0).any()
    assert np.isnan(course.predicted_arrival_c[bad]).all()


def test_drive_ends_where_the_battery_is_empty():
    conditions = short_conditions(state=BatteryState(15.0, 0.01))
    drive, course = drive_with_planner(make_car(conditions), conditions.goal, every_two_seconds(MEASURED))
    assert drive.ran_empty and drive.arrival_soc <= 0.0
    assert course.time_s[-1] < 400.0


@pytest.mark.needs('casadi')
@pytest.mark.parametrize('number', [0, *(pytest.param(number, marks=pytest.mark.deep) for number in (1, 2))])
def test_informed_drive_is_the_optimum_of_the_true_car(number):
    from bev_preheat.nonlinear_program.solve import solve_optimum
    trip = draw_car(CONDITIONS, 11, number)
    car = trip.car()
    optimum = solve_optimum(car.plant.vehicle, car.plant.route, CONDITIONS.state, CONDITIONS.goal,
                            True).plan
    drive = drive_informed(car, CONDITIONS.goal)
    assert drive.arrival_error_k == pytest.approx(0.0, abs=0.01)
    assert drive.heating_energy_wh == pytest.approx(optimum.energy_wh.hvch_electric, rel=2e-3)
    assert drive.battery_energy_wh == pytest.approx(optimum.energy_wh.battery_total, rel=1e-3)
    assert drive.switch_ons == 1


def test_plan_that_does_not_know_the_truth_misses_by_more():
    """The informed drive uses the true car: with the vehicle file it would arrive elsewhere."""
    car = make_car()
    believed = drive_informed(car, CONDITIONS.goal)
    weak = make_car(mismatch=Mismatch(heat_capacity=1.1, heater=0.95))
    informed = drive_informed(weak, CONDITIONS.goal)
    assert informed.heating_energy_wh > 1.1 * believed.heating_energy_wh
    assert abs(informed.arrival_error_k) < 0.01


PATH = HeatPath(30.0, 12e3, 400.0)
SLOW = short_conditions(vehicle=replace(CONDITIONS.vehicle, heat_path=PATH))


def test_informed_drive_knows_the_heat_path():
    car = make_car(SLOW)
    assert car.plant.vehicle.heat_path == PATH
    informed, at_once = drive_informed(car, SLOW.goal), drive_informed(make_car(), CONDITIONS.goal)
    # Plans in steps of 30 s, a drive in steps of 1 s.
    assert informed.arrival_error_k == pytest.approx(0.0, abs=0.01)
    assert informed.switch_ons == 1
    # The coolant gets 3 K warmer, too.
    assert informed.heating_energy_wh > at_once.heating_energy_wh + 12e3 * 3.0 / 0.87 / 3600.0
    assert informed.first_switch_on_s < at_once.first_switch_on_s


# The informed drive below knows the heat path, daily; test/control drives with one.
@pytest.mark.deep
@pytest.mark.costly
def test_planner_uses_the_heat_path_of_the_vehicle_file():
    """It plans with the heat under way, and switches off before arrival."""
    supervisor, car = Supervisor(SLOW.vehicle, every_two_seconds(Settings())), make_car(SLOW)
    under_way_w, ends_s = [], []
    for moment in moments(car, supervisor, lambda: car.plant.is_standing):
        plan = supervisor.state.decision.plan
        if plan is not None and car.plant.heater_power_w > 4e3:
            under_way_w.append(plan.heat.heater_power_w[0])
            ends_s.append(moment.time_s + (plan.heating_end_s or 0.0))
    # The estimation splits the heat in transit as under a steady command.
    assert np.median(under_way_w) == pytest.approx(LIMIT_W, rel=0.4)
    assert max(ends_s) < car.plant.duration_s - 15.0
    assert car.plant.temperature_c == pytest.approx(SLOW.goal.target_temperature_c, abs=0.4)
