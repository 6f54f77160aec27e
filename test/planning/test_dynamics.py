# SPDX-License-Identifier: Apache-2.0
"""Forward runs and their accounts: heat and energy balances on random trips, undeliverable power."""

import drives
from formula_car import current_a, FORMULA_CAR, resistance_ohm, voltage_v
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import ARRAYS
from bev_preheat.planning.dynamics import deliverable_power_w
from bev_preheat.planning.engine import keep_accounts, run_forward
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.model import make_euler, make_runge_kutta_4

SMALL_CAR = load_vehicle('small_car')
INTEGRATORS = pytest.mark.parametrize('make_integrator', [
    pytest.param(make_euler, id='euler'), pytest.param(make_runge_kutta_4, id='rk4')])
CARS = pytest.mark.parametrize('vehicle', [
    pytest.param(FORMULA_CAR, id='formulas'), pytest.param(SMALL_CAR, id='tables')])

# The pack with formulas delivers all of these powers; the pack with tables may run empty, and the accounts must
# close then too.
SEGMENTS = drives.segments(
    max_size=30, duration_s=(1e-3, 60.0), speed_mps=(0.0, 40.0), propulsion_power_w=(-40e3, 40e3),
    deviation_w=(0.0, 30e3), ambient_temperature_c=(-25.0, 15.0), heater_share=(0.0, 1.0), brake_share=(0.0, 1.0))
STARTS = st.tuples(st.floats(0.35, 0.95), st.floats(-25.0, 30.0))


def trip_of(vehicle, segments):
    """Trip of random segments, and the power of heater and friction brake in each."""
    columns = drives.columns_of(segments)
    heater_share, brake_share = columns.pop('heater_share'), columns.pop('brake_share')
    trip = make_trip(vehicle, make_route(columns, vehicle.defaults))
    return (trip, heater_share * trip.heater_limit_w,
            brake_share * np.maximum(-columns['propulsion_power_w'], 0.0))


def run(trip, make_integrator, start, heater_power_w, brake_power_w=None):
    """Arrays soc and temperature of a forward run, and its accounts."""
    if brake_power_w is None:
        brake_power_w = np.zeros_like(heater_power_w)
    soc, temperature_c = run_forward(trip, make_integrator, *start, heater_power_w, brake_power_w)
    return soc, temperature_c, keep_accounts(trip, Schedule(
        heating_start_s=0.0, heater_power_w=heater_power_w, brake_power_w=brake_power_w,
        soc=soc, temperature_c=temperature_c, make_integrator=make_integrator))


def trip_on(vehicle, *parts, **how):
    return make_trip(vehicle, drives.route_of(
        *parts, speed_mps=21.0, ambient_c=-11.0, cabin_w=1300.0, auxiliary_w=450.0, **how))


@pytest.mark.costly
@CARS
@INTEGRATORS
@given(segments=SEGMENTS, start=STARTS)
def test_heat_balance_closes(vehicle, make_integrator, segments, start):
    trip, *powers_w = trip_of(vehicle, segments)
    _, temperature_c, accounts = run(trip, make_integrator, start, *powers_w)
    heat_capacity = vehicle.battery.heat_capacity_j_per_k
    energy = accounts.energy_wh
    terms_j = 3600.0 * np.array(
        [energy.joule, energy.drivetrain_heat, energy.hvch_heat, energy.leakage])
    stored_j = heat_capacity * (temperature_c[-1] - temperature_c[0])
    # A temperature is rounded once per step; the heat capacity converts that to joules.
    rounding_j = heat_capacity * len(segments) * np.spacing(np.abs(temperature_c).max())
    assert terms_j.sum() == pytest.approx(
        stored_j, rel=0.0, abs=1e-9 * np.abs(terms_j).max() + rounding_j)


@CARS
@given(segments=SEGMENTS, start=STARTS)
def test_euler_energy_balance_closes(vehicle, segments, start):
    trip, *powers_w = trip_of(vehicle, segments)
    soc, temperature_c, accounts = run(trip, make_euler, start, *powers_w)
    # The charge that leaves the cells in a step times the voltage at its start, P_b = U I.
    voltage_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)(soc[:-1], temperature_c[:-1])
    given_j = -vehicle.battery.capacity_as * np.diff(soc) * voltage_v
    # A state of charge is rounded once per step, to 1e-16 of the whole pack, 3e8 J.
    rounding_j = vehicle.battery.capacity_as * 500.0 * 1.2e-16 * len(segments)
    assert 3600.0 * accounts.energy_wh.battery_total == pytest.approx(
        given_j.sum(), rel=0.0, abs=1e-9 * np.abs(given_j).max() + rounding_j)


@given(segments=SEGMENTS, start=STARTS)
def test_runge_kutta_energy_is_the_area_under_the_voltage(segments, start):
    trip, *powers_w = trip_of(FORMULA_CAR, segments)
    soc, _, accounts = run(trip, make_runge_kutta_4, start, *powers_w)

    def stored_j(soc):
        # The integral of 365 + 75 s + 15 s^3 over the charge, 200 Ah.
        return 200.0 * 3600.0 * (365.0 * soc + 37.5 * soc**2 + 3.75 * soc**4)

    gross_j = np.abs(np.diff(stored_j(soc))).sum()
    # 1e-8: the method's own error in steps of up to a minute.
    rounding_j = 3e8 * 2.3e-16 * (len(segments) + 2)
    assert 3600.0 * accounts.energy_wh.battery_total == pytest.approx(
        stored_j(soc[0]) - stored_j(soc[-1]), rel=0.0, abs=1e-8 * gross_j + rounding_j)


def test_joule_heat_of_one_euler_step_by_hand():
    trip = trip_on(FORMULA_CAR, (1, 17e3), step_s=36.0, rms=23.0 / 17.0)
    _, _, accounts = run(trip, make_euler, (0.8, -10.0), np.array([600.0]))
    current = current_a(0.8, -10.0, 17e3 + 1300.0 + 450.0 + 600.0)
    joule_w = 4.2 / 35.0 * (current**2 + (23e3**2 - 17e3**2) / (365.0 + 75.0 * 0.8 + 15.0 * 0.8**3)**2)
    assert accounts.energy_wh.joule == pytest.approx(joule_w / 100.0, rel=1e-11)


def test_friction_brake_takes_power_and_waste_heat_from_the_battery():
    trip = trip_on(FORMULA_CAR, (1, -17e3))
    free, braked = trip.inputs(0.0), trip.inputs(0.0, 6e3)
    # Of -17 kW only -11 kW remain, and 0.08 of 6 kW less heat.
    assert [after[0] - before[0] for before, after in zip(free, braked)] == pytest.approx(
        [0.0, 6e3, 0.0, -480.0, 0.0], abs=1e-9)


def test_deliverable_power_by_hand():
    # U^2/4R at a state of charge of 0.5 and -17 degC: R = 4.2/28 ohm.
    voltage_v = 365.0 + 37.5 + 1.875
    assert deliverable_power_w(FORMULA_CAR, np.array([0.5]), np.array([-17.0])) == pytest.approx(
        [voltage_v**2 / 0.6], rel=1e-12)


@CARS
@INTEGRATORS
@given(power_w=st.floats(0.2e6, 2e6), at=st.integers(0, 5), start=STARTS)
def test_undeliverable_power_gives_finite_numbers(vehicle, make_integrator, power_w, at, start):
    trip = trip_on(vehicle, (at, 5e3), (1, power_w), (5 - at, 5e3))
    soc, temperature_c, accounts = run(trip, make_integrator, start, np.zeros(6))
    numbers = [*soc, *temperature_c, *vars(accounts.energy_wh).values(),
               *accounts.undeliverable_power_w]
    assert np.isfinite(numbers).all()


@INTEGRATORS
def test_missing_watts_are_reported_in_their_step(make_integrator):
    trip = trip_on(FORMULA_CAR, (1, 12e3), (1, 390e3), (1, 12e3))
    soc, temperature_c, accounts = run(trip, make_integrator, (0.5, -17.0), np.zeros(3))
    most_w = voltage_v(soc[1])**2 / (4 * resistance_ohm(temperature_c[1]))
    assert accounts.undeliverable_power_w == pytest.approx([0.0, 390e3 + 1300.0 + 450.0 - most_w, 0.0], rel=1e-12)


def test_energy_balance_closes_with_undeliverable_power():
    trip = trip_on(FORMULA_CAR, (1, 390e3))
    soc, _, accounts = run(trip, make_euler, (0.5, -17.0), np.zeros(1))
    # At the limit the current is U/2R for 30 s, whatever the demand.
    voltage_v = 365.0 + 37.5 + 1.875
    assert 3600.0 * accounts.energy_wh.battery_total == pytest.approx(
        30.0 * voltage_v**2 / 0.3, rel=1e-12)
