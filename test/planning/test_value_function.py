# SPDX-License-Identifier: Apache-2.0
"""
Method `value_function`: near the program's optimum, the same in C and Python, no worse than trying everything.

If not everything can be had, it gives up first the target, then the power of climbs, last the reserve.
"""

from dataclasses import replace
from itertools import product

from drives import route_of
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from own_plant import OwnPlant
import pytest

from bev_preheat.planning.limits import drive_as_planned, run_unheated
from bev_preheat.planning.methods import plan_by_values
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.tunables import HEATING_PRICE
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

VEHICLE, PLANT = load_vehicle('reference'), OwnPlant('reference')
# Most that a plan lies above the optimum (docs/decisions.md, 14).
ABOVE_OPTIMUM_WH = 1.5
# The plant's steps are shorter, and of first order.
SAME_SOC, SAME_POWER_W, SAME_POWER_SHARE = 3e-4, 150.0, 4e-3
# Every example takes many plans of a whole trip: more examples only in `make test-deep`.
DEAR = settings(max_examples=6 if settings.default.derandomize else settings.default.max_examples)


def planned(trip, **changes):
    return plan_preheating(trip.vehicle, trip.route, trip.state, replace(trip.goal, **changes))


def total_wh(plan):
    """Energy with the heat missing at the target, so that plans with different shortfalls compare."""
    per_k = VEHICLE.battery.heat_capacity_j_per_k / VEHICLE.hvch.efficiency / 3600.0
    return plan.energy_wh.battery_total + plan.shortfall_k * per_k


# Descents that pay for heat, climbs, free heat that opens the charge limit, a changing cabin; heat for a climb
# that takes the charge of the next one; in the last ones the target would cost the reserve.
@pytest.mark.costly
@pytest.mark.needs('casadi')
@pytest.mark.parametrize('seed, number', [(1, 79), (11, 8), (11, 23), (11, 36), (11, 49), *(
    pytest.param(*case, marks=pytest.mark.deep) for case in (
        (1, 0), (1, 37), (1, 123), (11, 3), (11, 9), (11, 22), (11, 24), (11, 118), (11, 30),
        (11, 56)))])
def test_it_costs_what_the_program_costs(seed, number):
    from bev_preheat.nonlinear_program.solve import solve_optimum
    trip = draw_limit_trip(VEHICLE, seed, number)
    optimum = solve_optimum(trip.vehicle, trip.route, trip.state, trip.goal)
    plan = planned(trip)
    # Not below the optimum by more than the solver's tolerance. Surplus that saves less than HEATING_PRICE of the
    # heater's energy goes to the brake: the program, which heats with it, pays that price.
    above_wh = total_wh(plan) - total_wh(optimum.plan)
    more_heat_wh = plan.energy_wh.hvch_electric - optimum.plan.energy_wh.hvch_electric
    assert -0.05 < above_wh and above_wh + HEATING_PRICE * more_heat_wh < ABOVE_OPTIMUM_WH
    if optimum.plan.arrival_soc >= trip.goal.minimum_arrival_soc * (1.0 - 1e-6):
        assert plan.arrival_soc >= trip.goal.minimum_arrival_soc * (1.0 - 1e-6)
    missed = {item.constraint for item in optimum.deficit}
    assert ('target temperature' in missed) == (plan.shortfall_k > 1e-3)
    assert plan.undeliverable_power_w == 0.0


# A descent that the cold battery may not take.
SHORT_DESCENT = route_of((2, 14e3), (1, -48e3), (2, -52e3), (3, 12e3), step_s=120.0, cabin_w=500.0)


@pytest.mark.parametrize(('heat_path', 'shares'), [
    (HeatPath(), (0.0, 0.5, 1.0)), (HeatPath(40.0), (0.0, 1.0)), (HeatPath(40.0, 15e3, 150.0), (0.0, 1.0))])
@pytest.mark.parametrize('target_c', [2.0, 6.0])
def test_nothing_else_that_can_be_switched_costs_less(target_c, heat_path, shares):
    """Every pattern of off and full power, and of half power where heat arrives at once, is driven."""
    state, goal = BatteryState(-9.0, 0.8), Goal(target_c)
    trip = make_trip(replace(VEHICLE, heat_path=heat_path), SHORT_DESCENT)
    mine = plan_by_values(trip, state, goal)

    def cost_wh(schedule):
        capacity_wh = VEHICLE.battery.capacity_ah * 400.0
        short_k = max(target_c - float(schedule.temperature_c[-1]), 0.0)
        per_k = VEHICLE.battery.heat_capacity_j_per_k / VEHICLE.hvch.efficiency / 3600.0
        return (state.soc - float(schedule.soc[-1])) * capacity_wh + 30.0 * short_k * per_k

    tried = [drive_as_planned(trip, state, np.array(pattern) * trip.heater_limit_w)
             for pattern in product(shares, repeat=8)]
    # Switching on costs half a watt-hour, which this does not count.
    assert cost_wh(mine) < min(map(cost_wh, tried)) + 1.0


@pytest.mark.costly
@DEAR
@given(number=st.integers(0, 10**6), target_c=st.floats(-30.0, 60.0))
def test_limits_hold_and_what_can_be_reached_is_reached(number, target_c):
    trip = draw_limit_trip(VEHICLE, 17, number)
    trip = replace(trip, goal=replace(trip.goal, target_temperature_c=target_c))
    plan, without_reserve = planned(trip), planned(trip, minimum_arrival_soc=0.0)
    left_w = np.maximum(VEHICLE.hvch.maximum_power_w - trip.route.cabin_heating_power_w, 0.0)
    assert ((plan.hvch_battery_power_w >= 0.0) & (plan.hvch_battery_power_w <= left_w)).all()
    # In a plant that shares no code with the model; within a step it brakes only as much as it must.
    driven = PLANT.drive(trip.route, trip.state, plan.hvch_battery_power_w)
    beyond_w = PLANT.drive(trip.route, trip.state, plan.hvch_battery_power_w,
                           plan.friction_brake_power_w).beyond_w.max(axis=0)
    assert beyond_w[1] < SAME_POWER_W
    if plan.stranding is None:
        assert driven.soc > plan.arrival_soc - SAME_SOC
        assert driven.deficit_w == pytest.approx(
            plan.undeliverable_power_w, abs=SAME_POWER_W, rel=SAME_POWER_SHARE)
        assert beyond_w[0] < SAME_POWER_W or plan.undeliverable_power_w > 0.0
    # The reserve, as far as the drive alone keeps it; then the target.
    steps = make_trip(trip.vehicle, trip.route)
    if run_unheated(steps, trip.state).soc[-1] > trip.goal.minimum_arrival_soc:
        assert plan.arrival_soc >= trip.goal.minimum_arrival_soc - 1e-5
    hottest = drive_as_planned(steps, trip.state, steps.heater_limit_w, take_surplus=True)
    if hottest.temperature_c[-1] > target_c + 0.01 and without_reserve.arrival_soc > 0.06:
        assert without_reserve.shortfall_k <= 1e-3


@pytest.mark.costly
@DEAR
@given(number=st.integers(0, 10**6), start_c=st.floats(50.0, 60.0), target_c=st.floats(55.0, 60.0))
def test_heating_never_leads_beyond_the_highest_temperature(number, start_c, target_c):
    trip = replace(draw_limit_trip(VEHICLE, 17, number), state=BatteryState(start_c, 0.8))
    plan = planned(trip, target_temperature_c=target_c, minimum_arrival_soc=0.0)
    heated = plan.hvch_battery_power_w > 0.0
    # Tolerance to which the heater is cut.
    assert (plan.battery_temperature_c[1:][heated] <= 60.0 + 1e-6).all()


START = BatteryState(-12.0, 0.8)


def plan_of(route, target_c, state=START):
    return plan_preheating(VEHICLE, route, state, Goal(target_c))


def test_a_climb_that_no_heat_makes_possible_is_told_with_what_lacks_and_where():
    route = route_of((20, 15e3), (5, 190e3), (60, 20e3))
    plan = plan_of(route, 20.0)
    lacks_w = PLANT.drive(route, START, plan.hvch_battery_power_w).deficit_w
    assert (plan.status, plan.undeliverable_at_s) == (Status.POWER_LIMITED, 600.0)
    assert plan.undeliverable_power_w == pytest.approx(lacks_w, abs=SAME_POWER_W, rel=SAME_POWER_SHARE)
    assert plan.explanation.startswith(
        f'In 10:00 min the route needs {plan.undeliverable_power_w / 1000:.1f} kW more than the battery can '
        'deliver;')
    # The heater runs fully before the gap and pauses in it, where all power goes to driving; the target is met.
    assert plan.hvch_battery_power_w[:20] == pytest.approx(5500.0)
    assert not plan.hvch_battery_power_w[20:25].any()
    assert plan.arrival_temperature_c == pytest.approx(20.0, abs=1e-3)


@pytest.mark.costly
@DEAR
@given(number=st.integers(0, 10**6))
def test_heat_above_the_target_brings_more_energy_than_it_costs(number):
    trip = draw_limit_trip(VEHICLE, 23, number)
    plan = planned(trip, target_temperature_c=-40.0, minimum_arrival_soc=0.0)
    cold = plan_unheated(trip.vehicle, trip.route, trip.state, trip.goal)
    if cold.undeliverable_power_w == 0.0:
        assert plan.energy_wh.battery_total <= cold.energy_wh.battery_total + 1e-3
        # Each switching on is to save half a watt-hour.
        saved_wh = cold.energy_wh.battery_total - plan.energy_wh.battery_total
        assert plan.energy_wh.hvch_electric == 0.0 or saved_wh > 0.4


# Extremes: a status and finite numbers, neither an exception nor a warning.

EXTREMES = {
    'one_segment': (route_of((1, 90e3)), 10.0, START, Status.TARGET_UNREACHABLE),
    'one_segment_of_regeneration': (route_of((1, -90e3)), 10.0, START, Status.TARGET_UNREACHABLE),
    'all_descent': (route_of((40, -60e3)), 10.0, START, None),
    'no_heater': (route_of((20, 15e3), (5, -60e3), (5, 170e3), cabin_w=7000.0), 10.0, START, Status.POWER_LIMITED),
    'cabin_takes_all_heat': (route_of((40, 15e3), cabin_w=7500.0), 10.0, START, Status.TARGET_UNREACHABLE),
    'no_heater_at_the_end': (route_of(
        (20, 15e3), (5, -60e3), cabin_w=np.repeat([0.0, 9e3], [15, 10])), 10.0, START, None),
    'target_below_start': (route_of((20, 15e3)), -30.0, START, Status.NOT_NEEDED),
    # Free heat is used.
    'descent_and_target_below_start': (route_of((20, 15e3), (5, -60e3)), -30.0, START, Status.WAITING),
    'full_with_regeneration': (route_of((20, -60e3), (20, 15e3)), 10.0, BatteryState(-12.0, 1.0), None),
    'lowest_charge': (route_of((20, 15e3)), 10.0, BatteryState(-12.0, 0.05), Status.POWER_LIMITED),
    'empty': (route_of((20, 15e3)), 10.0, BatteryState(-12.0, 0.0), Status.OUT_OF_CHARGE),
    'highest_temperatures': (route_of((20, -60e3), (20, 50e3), ambient_c=60.0), 60.0, BatteryState(60.0, 0.8),
                             None),
    'lowest_temperatures': (route_of((20, -60e3), (20, 50e3), ambient_c=-40.0), -40.0, BatteryState(-40.0, 0.8),
                            None),
    'coldest_to_hottest': (route_of((20, -60e3), (20, 150e3), ambient_c=-40.0), 60.0, BatteryState(-40.0, 0.8),
                           Status.POWER_LIMITED),
    'stops_only': (route_of((40, 0.0), cabin_w=0.0), 10.0, START, Status.TARGET_UNREACHABLE),
    'far_too_much': (route_of((20, 400e3), step_s=900.0), 10.0, BatteryState(-12.0, 0.9), Status.OUT_OF_CHARGE),
    'many_steps': (route_of((1200, 15e3), (300, -60e3), (300, 20e3), step_s=0.25), 10.0, START, None),
    'long_steps': (route_of((4, -60e3), (4, 30e3), step_s=3600.0), 10.0, START, None),
    'quarter_seconds': (route_of((9600, 15e3), (2400, -60e3), (2400, 20e3), step_s=0.25), 10.0, START, None)}


@pytest.mark.costly
@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', [
    pytest.param(name, marks=pytest.mark.deep if name == 'quarter_seconds' else ()) for name in EXTREMES])
def test_an_extreme_trip_has_a_status_and_finite_numbers(name):
    route, target_c, state, status = EXTREMES[name]
    plan = plan_of(route, target_c, state)
    assert np.isfinite([
        *plan.battery_temperature_c, *plan.soc, *plan.hvch_battery_power_w,
        *plan.friction_brake_power_w, *vars(plan.energy_wh).values()]).all()
    assert status in (None, plan.status)
