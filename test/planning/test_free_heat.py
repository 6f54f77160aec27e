# SPDX-License-Identifier: Apache-2.0
"""Surplus regeneration heats the battery only as far as is useful."""

from contextlib import nullcontext
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from own_plant import OwnPlant
import pytest

from bev_preheat.native.library import without_core
from bev_preheat.planning import planner
from bev_preheat.planning.free_heat import find_surplus_ceiling_c
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route, make_route, route_for
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

REFERENCE = load_vehicle('reference')
LAGGING = replace(REFERENCE, heat_path=HeatPath(45.0, 15e3, 300.0))


def descent(minutes, ambient_c=25.0, power_w=-15e3):
    """A route that descends all the way."""
    return make_route({
        'duration_s': [30.0] * (2 * minutes), 'speed_mps': [15.0], 'propulsion_power_w': [power_w],
        'ambient_temperature_c': [ambient_c], 'cabin_heating_power_w': [0.0]}, REFERENCE.defaults)


def plan_without_ceiling(monkeypatch, *situation):
    with monkeypatch.context() as patch:
        patch.setattr(planner, 'leave_useless_heat', lambda trip, state, target_c, schedule, again: schedule)
        return plan_preheating(*situation)


@pytest.mark.parametrize('is_on', [True, False])
@pytest.mark.parametrize('car', [REFERENCE, LAGGING])
@pytest.mark.parametrize('minutes', [30, 60])
def test_a_full_battery_that_is_warm_enough_is_not_heated(minutes, car, is_on):
    # It accepts none of the descent, warm or cold; braking power heats nothing. It cools towards 25 degC.
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(car, descent(minutes), BatteryState(30.0, 1.0), Goal(25.0))
    assert (plan.status, plan.intervals) == (Status.NOT_NEEDED, ())
    assert 25.0 < plan.arrival_temperature_c < 30.0


@pytest.mark.parametrize('is_on', [True, False])
@pytest.mark.parametrize('car', [REFERENCE, LAGGING])
@pytest.mark.parametrize('start_c, ambient_c', [
    (5.0, -10.0), *(pytest.param(*case, marks=pytest.mark.deep) for case in ((10.0, 25.0), (20.0, 10.0)))])
def test_warmth_that_the_target_lacks_is_taken_for_nothing(start_c, ambient_c, car, is_on):
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(car, descent(60, ambient_c), BatteryState(start_c, 1.0), Goal(25.0))
    assert plan.arrival_temperature_c == pytest.approx(25.0, abs=0.5)
    # Heat balance: heater, drivetrain and losses warm battery and coolant, and cover the leakage.
    energy = plan.energy_wh
    stored_wh = REFERENCE.battery.heat_capacity_j_per_k * (plan.arrival_temperature_c - start_c) / 3600.0
    assert energy.hvch_heat + energy.drivetrain_heat + energy.joule + energy.leakage == pytest.approx(
        stored_wh, abs=1.0)
    # The battery supplies no energy for it.
    assert plan.arrival_soc >= 1.0 - 1e-4


def test_what_a_kelvin_gains_decides_how_warm_it_gets():
    # Beyond 25 degC the limit rises by 1 kW/K or less; at half charge it is 115 kW there: nothing is refused.
    state = BatteryState(10.0, 0.5)
    plan = plan_preheating(REFERENCE, descent(20, 10.0, -60e3), state, Goal(5.0))
    # 62 kW at 10 degC: all of the descent is accepted, and warmth is of no use.
    assert plan.energy_wh.hvch_electric == 0.0
    cold = plan_preheating(REFERENCE, descent(20, -10.0, -60e3), BatteryState(-10.0, 0.5), Goal(5.0))
    # 12 kW at -10 degC and 5 kW per kelvin, but no more than 60: the last are refused below 10 degC.
    assert cold.energy_wh.hvch_electric > 0.0
    assert cold.battery_temperature_c.max() < 25.0


@pytest.mark.parametrize('target_c', [25.0, 52.0])
def test_free_heat_stays_away_from_the_highest_temperature(target_c):
    # A limit that rises through the whole range, and a descent that exceeds it.
    charge = replace(REFERENCE.battery.charge_power_limit, soc=(0.0,), temperature_c=(-30.0, 60.0),
                     values=((0.0, -18e3),))
    car = replace(REFERENCE, battery=replace(REFERENCE.battery, charge_power_limit=charge))
    plan = plan_preheating(car, descent(100, -10.0, -20e3), BatteryState(45.0, 0.2), Goal(target_c))
    assert plan.energy_wh.hvch_electric > 100.0
    heated = plan.hvch_battery_power_w > 0.0
    assert plan.battery_temperature_c[1:][heated].max() == pytest.approx(55.0, abs=0.1)


def test_over_the_pass_a_warm_battery_is_heated_no_further(monkeypatch):
    route = route_for('legs/alpine_pass', REFERENCE).route
    situation = REFERENCE, route, BatteryState(30.0, 1.0), Goal(25.0)
    plan, free = plan_preheating(*situation), plan_without_ceiling(monkeypatch, *situation)
    assert free.arrival_temperature_c == pytest.approx(38.7, abs=0.1)
    assert plan.arrival_temperature_c < 36.0
    # Half a kilowatt-hour of heat would have brought less than 50 Wh.
    saved_wh = free.energy_wh.hvch_electric - plan.energy_wh.hvch_electric
    assert saved_wh > 500.0
    assert plan.energy_wh.battery_total - free.energy_wh.battery_total < 0.1 * saved_wh


def test_the_cold_pass_takes_its_surplus_as_before(monkeypatch):
    situation = (REFERENCE, load_route('alpine_pass', REFERENCE.defaults), BatteryState(-10.0, 0.9), Goal(25.0))
    plan, free = plan_preheating(*situation), plan_without_ceiling(monkeypatch, *situation)
    assert plan.hvch_battery_power_w.tolist() == free.hvch_battery_power_w.tolist()


@pytest.mark.parametrize('temperature_c', [-5.0, 12.0, 30.0])
def test_a_car_of_its_own_arrives_as_planned(temperature_c):
    # The plan's own commands, driven by a plant that shares no code with it.
    route = descent(40, 5.0)
    plan = plan_preheating(REFERENCE, route, BatteryState(temperature_c, 1.0), Goal(25.0))
    driven = OwnPlant('reference').drive(route, BatteryState(temperature_c, 1.0), plan.hvch_battery_power_w)
    assert driven.temperature_c == pytest.approx(plan.arrival_temperature_c, abs=0.1)
    assert driven.temperature_c < max(25.5, temperature_c)


@pytest.mark.costly
@given(number=st.integers(0, 10**6))
def test_useful_heat_is_kept_and_useless_heat_left(number):
    trip = draw_limit_trip(REFERENCE, 23, number)
    situation = trip.vehicle, trip.route, trip.state, trip.goal
    plan = plan_preheating(*situation)
    with pytest.MonkeyPatch.context() as patch:
        free = plan_without_ceiling(patch, *situation)
    saved_wh = free.energy_wh.hvch_electric - plan.energy_wh.hvch_electric
    whole_wh = 1.05 * REFERENCE.battery.capacity_ah * 430.0
    assert (free.arrival_soc - plan.arrival_soc) * whole_wh <= 0.11 * saved_wh + 1e-3
    assert plan.shortfall_k <= free.shortfall_k + 2e-3
    assert plan.undeliverable_power_w <= free.undeliverable_power_w
    assert plan.soc_shortfall <= free.soc_shortfall + 1e-5 or saved_wh > 0.0


# Leaf by leaf; the plans below are compared daily.
@pytest.mark.deep
@pytest.mark.parametrize('path', [HeatPath(), HeatPath(45.0, 15e3, 300.0)])
@given(number=st.integers(0, 10**6))
def test_ceilings_of_the_core_are_those_of_python(path, number):
    drawn = draw_limit_trip(REFERENCE, 31, number)
    trip = make_trip(replace(drawn.vehicle, heat_path=path), drawn.route)
    soc = np.linspace(drawn.state.soc, 0.97, len(trip.route) + 1)
    arguments = trip, drawn.state, drawn.goal.target_temperature_c, soc
    found = find_surplus_ceiling_c(*arguments)
    with without_core():
        expected = find_surplus_ceiling_c(*arguments)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)


@pytest.mark.costly
@pytest.mark.parametrize('path', [HeatPath(), HeatPath(45.0, 15e3, 300.0)], ids=['direct', 'late'])
@pytest.mark.parametrize('number', [
    13, *(pytest.param(number, marks=pytest.mark.deep) for number in (0, 14, 22, 25))])
def test_plans_of_the_core_are_those_of_python(number, path):
    # Without a ceiling free heat exceeds the target on each of these trips.
    drawn = draw_limit_trip(REFERENCE, 1, number)
    situation = replace(drawn.vehicle, heat_path=path), drawn.route, drawn.state, drawn.goal
    plan = plan_preheating(*situation)
    with without_core():
        expected = plan_preheating(*situation)
    np.testing.assert_allclose(plan.hvch_battery_power_w, expected.hvch_battery_power_w, rtol=0.0, atol=0.01)
    np.testing.assert_allclose(
        plan.battery_temperature_c, expected.battery_temperature_c, rtol=0.0, atol=1e-5)
