# SPDX-License-Identifier: Apache-2.0
"""A car that drives, charges and is parked: balances and closed forms, instants, and messages."""

from dataclasses import replace
import math

from level_car import CAPACITY_AH, current_a, HEAT_CAPACITY_J_PER_K, LEVEL, level, OHM, route_of, VOLTAGE_V
import pytest

from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.simulation.heater import HeaterLease, NO_LEASE
from bev_preheat.simulation.imperfect_car import COMPUTERS_GO_ON_S, ImperfectCar, Imperfections
from bev_preheat.simulation.phases import ASLEEP_POWER_W, AWAKE_POWER_W, Charge, DrivePhase, Park
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.simulation.traffic import ClockJump, Event, Kind
from bev_preheat.vehicle.description import HeatPath, Leakage


def vehicle(leakage_w_per_k=0.0):
    """Return the level car, which may charge with 200 kW and heats itself up to 25 degC."""
    limit = level(-2e5)
    return replace(
        LEVEL, charging=replace(LEVEL.charging, power_limit=limit, heating_limit_c=25.0),
        battery=replace(LEVEL.battery, charge_power_limit=limit, leakage=Leakage(leakage_w_per_k, 0.0)))


def a_drive(duration_s=100.0, target_c=20.0, **how):
    return DrivePhase(route_of(duration_s, power_w=5e3), Goal(target_c), **how)


def a_car(*following, of=None, soc=0.5, temperature_c=10.0, **imperfections):
    imperfections.setdefault('sensors', Sensors(period_s=10.0))
    return ImperfectCar(of or vehicle(), a_drive(), BatteryState(temperature_c, soc),
                        Imperfections(**imperfections), route_id='home', following=following)


def at_the_start_of_its_second_phase(*following, **of):
    car = a_car(*following, **of)
    car.advance_under(NO_LEASE, 100.0)
    return car


def test_the_charger_feeds_consumers_and_battery():
    charge = Charge(30e3, 900.0, 0.0, cabin_heating_power_w=1500.0, auxiliary_power_w=700.0)
    car = at_the_start_of_its_second_phase(charge)
    soc, temperature_c = car.plant.soc, car.plant.temperature_c
    car.advance_under(NO_LEASE, 1000.0)
    charging_a = current_a(-(30e3 - 1500.0 - 700.0))
    assert car.plant.soc - soc == pytest.approx(-900.0 * charging_a / (3600.0 * CAPACITY_AH), rel=1e-9)
    # Only I^2 R warms the cells: no drivetrain runs.
    assert car.plant.temperature_c - temperature_c == pytest.approx(
        900.0 * OHM * charging_a**2 / HEAT_CAPACITY_J_PER_K, rel=1e-9)


def test_what_the_planner_commands_at_the_charger_the_charger_gives():
    charge = Charge(30e3, 900.0, 0.0)
    idle, heated = (at_the_start_of_its_second_phase(charge) for _ in range(2))
    idle.advance_under(NO_LEASE, 700.0)
    heated.advance_under(HeaterLease(4000.0, 700.0), 700.0)
    # Meanwhile less current flows into the battery, and warms it less.
    heat_w = vehicle().hvch.efficiency * 4000.0 + OHM * (
        current_a(4000.0 + AWAKE_POWER_W - 30e3)**2 - current_a(AWAKE_POWER_W - 30e3)**2)
    assert heated.plant.temperature_c - idle.plant.temperature_c == pytest.approx(
        600.0 * heat_w / HEAT_CAPACITY_J_PER_K, rel=1e-6)


def test_charging_ends_at_its_state_of_charge_and_the_next_phase_begins():
    car = at_the_start_of_its_second_phase(Charge(50e3, 7200.0, 0.0, until_soc=0.55), Park(600.0, 0.0))
    car.advance_under(NO_LEASE, 3600.0)
    _, charged, _ = car.reports
    # To the next battery state.
    assert 0.55 <= charged.soc < 0.55 + 10.0 * 55e3 / VOLTAGE_V / (3600.0 * CAPACITY_AH)
    assert charged.ended_s < 3600.0 - 600.0
    assert car.is_over


def test_a_car_may_heat_itself_at_the_charger_up_to_its_limit():
    hot, cold = (at_the_start_of_its_second_phase(
        Charge(8e3, 7200.0, 0.0, heats_itself=heats), temperature_c=15.0) for heats in (True, False))
    for car in (hot, cold):
        car.advance_under(NO_LEASE, 110.0)
    assert hot.plant.heater_power_w == pytest.approx(vehicle().hvch.maximum_power_w)
    assert cold.plant.heater_power_w == 0.0
    hot.advance_under(NO_LEASE, 3600.0)
    # Beyond the limit heating between two battery states adds 0.2 K, and the charging current of 20 A 0.5 K.
    assert 24.0 < hot.plant.temperature_c < 25.7


def test_a_parked_battery_cools_to_the_ambient():
    car = at_the_start_of_its_second_phase(Park(9 * 3600.0, -8.0), of=vehicle(leakage_w_per_k=31.0))
    warm_k, soc = car.plant.temperature_c + 8.0, car.plant.soc
    car.advance_under(NO_LEASE, 100.0 + 9 * 3600.0)
    decay = math.exp(-31.0 * 9 * 3600.0 / HEAT_CAPACITY_J_PER_K)
    # Half an ampere warms it by a few millikelvin.
    assert car.plant.temperature_c == pytest.approx(-8.0 + warm_k * decay, abs=5e-3)
    assert (soc - car.plant.soc) * 3600.0 * CAPACITY_AH * VOLTAGE_V == pytest.approx(
        9 * 3600.0 * AWAKE_POWER_W, rel=1e-3)


def test_a_car_that_sleeps_says_nothing_and_takes_little():
    car = at_the_start_of_its_second_phase(Park(7200.0, 0.0, awake_s=600.0), a_drive())
    car.readings()
    soc = car.plant.soc
    car.advance_under(NO_LEASE, 7290.0)
    assert max(reading.instant_s for reading in car.readings()) == 700.0
    assert car.asleep_until_s == 7300.0
    assert (soc - car.plant.soc) * 3600.0 * CAPACITY_AH * VOLTAGE_V == pytest.approx(
        600.0 * AWAKE_POWER_W + 6590.0 * ASLEEP_POWER_W, rel=1e-3)
    car.advance_under(NO_LEASE, 7330.0)
    assert [reading.instant_s for reading in car.readings()] == [7300.0, 7310.0, 7320.0, 7330.0]
    assert car.asleep_until_s is None


def test_state_and_sensor_go_on_from_phase_to_phase():
    parked = Park(50.0, 10.0)
    car = a_car(parked, Charge(30e3, 50.0, 0.0), parked)
    before = None
    for second in range(1, 250):
        car.advance_under(NO_LEASE, float(second))
        now = (car.plant.temperature_c, car.plant.sensor_c, car.plant.soc)
        if before is not None:
            assert now == pytest.approx(before, abs=3e-3)
        before = now
    assert [(report.started_s, report.ended_s) for report in car.reports] == [(0, 100), (100, 150), (150, 200)]


@pytest.mark.parametrize('phase', [Park(300.0, 10.0), Charge(30e3, 300.0, 10.0)])
def test_a_lagging_heater_goes_on_from_phase_to_phase(phase):
    """It follows its command with a lag of 60 s, whatever the car does."""
    car = a_car(phase, of=replace(vehicle(), heat_path=HeatPath(heater_lag_s=60.0)))
    for instant_s in (50.0, 99.0, 101.0, 130.0):
        car.advance_under(HeaterLease(1000.0, 200.0), instant_s)
        assert car.plant.heater_power_w == pytest.approx(1000.0 * -math.expm1(-instant_s / 60.0), abs=10.0)


@pytest.mark.parametrize('sent_after_s, announced', [(None, 0.0), (0.0, 0.0), (None, 300.0)])
def test_each_drive_is_sent_when_it_starts_or_before(sent_after_s, announced):
    events = () if sent_after_s is None else (Event(Kind.CANCEL_CHARGING, 20.0, sent_after_s),)
    car = a_car(Park(600.0, 0.0), a_drive(
        40.0, 15.0, standing_time_s=600.0, events=events, announced_s=announced))
    assert car.mission(0).route_id == 'home'
    sent = []
    for second in range(1, 741):
        car.advance_under(NO_LEASE, float(second))
        news = car.route_news(5 * NS_PER_S)
        if news is not None:
            sent.append((second, news.route_id, news.start_ns // NS_PER_S, news.standing_time_s,
                         news.legs[0].charging_planned))
    first = (700 - announced, 'home 2', 705, 600.0, True)
    assert sent == [first] if sent_after_s is None else [first, (720, 'home 2', 725, 0.0, False)]


def test_a_recording_that_is_played_again_begins_with_the_first_state():
    car = a_car(a_drive(starts_over=True), clock_jumps=(ClockJump(100.0, -100.0),))
    car.advance_under(HeaterLease(4000.0, 100.0), 99.0)
    assert (car.clock_s, car.plant.temperature_c > 10.5) == (99.0, True)
    car.advance_under(NO_LEASE, 100.0)
    assert (car.clock_s, car.plant.temperature_c, car.plant.soc) == (0.0, 10.0, 0.5)


def test_no_step_is_taken_while_the_computers_sleep():
    car = a_car(Park(36_000.0, 0.0, awake_s=300.0), a_drive())
    steps_s = [moment.time_s for moment in moments(
        car, Supervisor(car.vehicle, Settings()), lambda: car.is_over)]
    asleep_s = 100.0 + 300.0 + COMPUTERS_GO_ON_S
    assert max(step_s for step_s in steps_s if step_s < 36_100.0) == asleep_s
    assert min(step_s for step_s in steps_s if step_s > asleep_s) == 36_100.0
    # Each second of the following drive, without the hours before it.
    assert sum(step_s > asleep_s for step_s in steps_s) < 250
