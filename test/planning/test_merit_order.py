# SPDX-License-Identifier: Apache-2.0
"""Method `merit_order`: `optimal_switch` or cheaper without an active limit, else the NLP; properties."""

from dataclasses import replace
from functools import lru_cache

from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.planning.limits import run_within_limits
from bev_preheat.planning.merit_order import plan_merit_order
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.planner import as_driven, plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.wanted_heat import LimitedSteps, WantedHeat
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, Table
from bev_preheat.vehicle.description import Drivetrain, Hvch, Leakage
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

SHIPPED_CAR = load_vehicle('reference')
# Corners of the limits [W] at states of charge 0 and 1 (rows), -30 and 30 degC.
DISCHARGE_W = ((10e3, 90e3), (70e3, 310e3))
CHARGE_W = ((-12e3, -130e3), (0.0, -20e3))
CAR = replace(
    SHIPPED_CAR,
    battery=replace(
        SHIPPED_CAR.battery, capacity_ah=200.0, heat_capacity_j_per_k=378500.0,
        open_circuit_voltage=PolynomialVoltage((365.0, 75.0, 0.0, 15.0)),
        resistance=InverseTemperatureResistance(4.2, 45.0), leakage=Leakage(33.0, 0.5),
        discharge_power_limit=Table((0.0, 1.0), (-30.0, 30.0), DISCHARGE_W),
        charge_power_limit=Table((0.0, 1.0), (-30.0, 30.0), CHARGE_W),
        soc_range=(0.05, 1.0), temperature_range_c=(-40.0, 60.0)),
    drivetrain=Drivetrain(0.9, 0.8, 350e3), hvch=Hvch(7000.0, 0.87))
START = BatteryState(temperature_c=-12.0, soc=0.8)
PACK_WH = 85e3
# The value curve is computed on a grid, and its thresholds are accurate to about a tenth of a kelvin; 0.1 K of the
# pack takes 12 Wh of the heater.
THRESHOLDS_WH = 12.0

GENTLE_SEGMENTS = st.lists(st.fixed_dictionaries({
    'duration_s': st.floats(1.0, 90.0), 'speed_mps': st.floats(0.0, 35.0),
    'propulsion_power_w': st.floats(-4e3, 40e3), 'ambient_temperature_c': st.floats(-25.0, 5.0),
    'cabin_heating_power_w': st.floats(0.0, 8e3), 'auxiliary_power_w': st.floats(0.0, 2e3)}),
    min_size=1, max_size=60)
NUMBERS = st.integers(0, 10**6)
# For properties whose every example takes several plans: fewer each day; `make test-deep` has as many as for other
# properties, and alone draws new ones.
DEAR = settings(max_examples=6 if settings.default.derandomize else settings.default.max_examples)


def bilinear(corners_w, soc, temperature_c):
    warm = np.clip((temperature_c + 30.0) / 60.0, 0.0, 1.0)
    (empty_cold, empty_warm), (full_cold, full_warm) = corners_w
    return ((1 - soc) * ((1 - warm) * empty_cold + warm * empty_warm)
            + soc * ((1 - warm) * full_cold + warm * full_warm))


def table_w(table, soc, temperature_c):
    """Value of a table, first along temperature in each row, then along the state of charge."""
    return np.array([
        np.interp(s, table.soc, [np.interp(t, table.temperature_c, row) for row in table.values])
        for s, t in zip(soc, temperature_c)])


def battery_power_w(vehicle, plan, route):
    """P_b at the start of each step, U I + R var/U^2."""
    soc, temperature_c = plan.soc[:-1], plan.battery_temperature_c[:-1]
    c0, c1, _, c3 = vehicle.battery.open_circuit_voltage.coefficients_v
    resistance = vehicle.battery.resistance
    u = c0 + c1 * soc + c3 * soc**3
    r = resistance.k_ohm_k / (temperature_c + resistance.reference_temperature_c)
    terminal_w = (route.propulsion_power_w + route.cabin_heating_power_w + route.auxiliary_power_w
                  + plan.hvch_battery_power_w + plan.friction_brake_power_w)
    current_a = (u - np.sqrt(np.maximum(u**2 - 4 * r * terminal_w, 0.0))) / (2 * r)
    return u * current_a + r * route.propulsion_power_variance_w2 / u**2


def route_of(segments):
    return make_route({name: [segment[name] for segment in segments] for name in segments[0]},
                      CAR.defaults)


def drive(*parts, cabin_w=1500.0, ambient_c=-12.0, step_s=30.0):
    """Route of parts (number of steps, propulsion power [W])."""
    power_w = np.concatenate([np.full(count, float(value)) for count, value in parts])
    return make_route({
        'duration_s': np.full(len(power_w), step_s), 'speed_mps': [20.0],
        'propulsion_power_w': power_w, 'ambient_temperature_c': [ambient_c],
        'cabin_heating_power_w': np.broadcast_to(cabin_w, len(power_w)),
        'auxiliary_power_w': [400.0]}, CAR.defaults)


def plan_of(route, target_c=10.0, state=START, **goal):
    return plan_preheating(CAR, route, state, Goal(target_c, **goal))


def drawn_plan(number, state=None, **changes):
    """A drawn trip whose goal is changed, and its plan."""
    trip = draw_limit_trip(SHIPPED_CAR, 17, number)
    trip = replace(trip, goal=replace(trip.goal, **changes), state=state or trip.state)
    return trip, plan_preheating(trip.vehicle, trip.route, trip.state, trip.goal)


def hottest_arrival_c(trip):
    """Return the arrival temperature with all the heating that limits and cabin allow."""
    steps = make_trip(trip.vehicle, trip.route)
    run = run_within_limits(
        steps, trip.state,
        LimitedSteps(steps.route.propulsion_power_w < 0.0, np.ones(len(steps.route), dtype=bool)),
        WantedHeat(steps.heater_limit_w), take_surplus=True)
    return run.temperature_c[-1]


# Without an active limit

@given(segments=GENTLE_SEGMENTS, state=st.builds(
    BatteryState, st.floats(-20.0, 15.0), st.floats(0.3, 0.9)), target_c=st.floats(-15.0, 30.0))
def test_without_active_limits_it_is_optimal_switch_or_cheaper(segments, state, target_c):
    route = route_of(segments)
    switch = plan_preheating(CAR, route, state, Goal(target_c), 'optimal_switch')
    power_w = battery_power_w(CAR, switch, route)
    where = switch.soc[:-1], switch.battery_temperature_c[:-1]
    assume((power_w <= bilinear(DISCHARGE_W, *where)).all())
    assume((power_w >= bilinear(CHARGE_W, *where)).all())
    plan = plan_preheating(CAR, route, state, Goal(target_c))
    assert plan.arrival_temperature_c == pytest.approx(switch.arrival_temperature_c, abs=2e-5)
    if switch.energy_wh.battery_total - plan.energy_wh.battery_total < 0.04:
        assert plan.hvch_battery_power_w == pytest.approx(
            switch.hvch_battery_power_w, rel=1e-9, abs=1e-9)


@pytest.mark.costly
@DEAR
@given(number=NUMBERS)
# Executed, the single switch leaves 38 Wh to the brake.
@example(number=263)
def test_it_costs_no_more_than_one_switch_driven_within_limits(number):
    trip, plan = drawn_plan(number, minimum_arrival_soc=0.0)
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    driven = as_driven(plan_preheating(*inputs, 'optimal_switch'), *inputs)
    # A single switch does not pay the cost of a climb.
    assume(driven.shortfall_k < 1e-3
           and driven.undeliverable_power_w == plan.undeliverable_power_w == 0.0)
    assert (plan.energy_wh.battery_total
            <= driven.energy_wh.battery_total + THRESHOLDS_WH)


# Against the nonlinear program. Trips of seed 11 that it solves in less than a second: descent (3,
# 9), climb (8), both (24), a changing cabin (22, 23, 36) and with that a reserve (118).
# One of each kind daily.
WITH_THE_PROGRAM = pytest.mark.parametrize('number', [
    8, 23, *(pytest.param(number, marks=pytest.mark.deep) for number in (3, 9, 22, 24, 36, 118))])
# Trips whose target would cost the reserve; the program says by how much it must be missed.
SHORT_OF_RESERVE = pytest.mark.parametrize('number', [
    49, *(pytest.param(number, marks=pytest.mark.deep) for number in (30, 56))])


@lru_cache
def plan_and_optimum(number):
    from bev_preheat.nonlinear_program.solve import solve_optimum
    trip = draw_limit_trip(SHIPPED_CAR, 11, number)
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    return trip, plan_preheating(*inputs), solve_optimum(*inputs)


@pytest.mark.costly
@pytest.mark.needs('casadi')
@WITH_THE_PROGRAM
def test_program_keeps_all_limits_of_these_trips(number):
    _, _, optimum = plan_and_optimum(number)
    assert (optimum.solver_status, optimum.deficit) == ('Solve_Succeeded', ())


@pytest.mark.costly
@pytest.mark.needs('casadi')
@WITH_THE_PROGRAM
def test_energy_is_that_of_the_program(number):
    _, plan, optimum = plan_and_optimum(number)
    # The goal: 10 Wh, out of 10 ... 50 kWh. The plan cannot be below the optimum by more than the solver's
    # tolerance.
    gap_wh = plan.energy_wh.battery_total - optimum.plan.energy_wh.battery_total
    assert -0.01 <= gap_wh <= 10.0


@pytest.mark.needs('casadi')
@WITH_THE_PROGRAM
def test_target_that_the_program_reaches_is_reached(number):
    _, plan, _ = plan_and_optimum(number)
    assert plan.shortfall_k <= 1e-3


@pytest.mark.needs('casadi')
@WITH_THE_PROGRAM
def test_discharge_limit_that_the_program_keeps_is_kept(number):
    trip, plan, _ = plan_and_optimum(number)
    limit_w = table_w(trip.vehicle.battery.discharge_power_limit, plan.soc[:-1],
                      plan.battery_temperature_c[:-1])
    assert (battery_power_w(trip.vehicle, plan, trip.route) <= limit_w * (1.0 + 1e-6)).all()


@pytest.mark.needs('casadi')
@WITH_THE_PROGRAM
def test_charge_limit_that_the_program_keeps_is_kept(number):
    trip, plan, _ = plan_and_optimum(number)
    limit_w = table_w(trip.vehicle.battery.charge_power_limit, plan.soc[:-1],
                      plan.battery_temperature_c[:-1])
    assert (battery_power_w(trip.vehicle, plan, trip.route) >= limit_w * (1.0 + 1e-6)).all()


@pytest.mark.needs('casadi')
@WITH_THE_PROGRAM
def test_reserve_that_the_program_keeps_is_kept(number):
    trip, plan, _ = plan_and_optimum(number)
    assert plan.arrival_soc >= trip.goal.minimum_arrival_soc * (1.0 - 1e-6)


@pytest.mark.costly
@pytest.mark.needs('casadi')
@SHORT_OF_RESERVE
def test_program_misses_nothing_but_the_target_of_these_trips(number):
    _, _, optimum = plan_and_optimum(number)
    assert [item.constraint for item in optimum.deficit] == ['target temperature']


@pytest.mark.costly
@pytest.mark.needs('casadi')
@SHORT_OF_RESERVE
def test_reserve_that_the_target_would_cost_is_kept(number):
    trip, plan, _ = plan_and_optimum(number)
    assert plan.arrival_soc >= trip.goal.minimum_arrival_soc * (1.0 - 1e-6)


@pytest.mark.needs('casadi')
@SHORT_OF_RESERVE
def test_with_a_reserve_it_arrives_as_warm_as_the_program(number):
    _, plan, optimum = plan_and_optimum(number)
    # The reserve is met to 1e-5 of about 80 kWh and the thresholds cost a few watt-hours; a kelvin takes 120 Wh.
    assert plan.arrival_temperature_c == pytest.approx(
        optimum.plan.arrival_temperature_c, abs=0.05)


@pytest.mark.costly
@pytest.mark.needs('casadi')
def test_charge_counts_less_before_a_descent_that_a_full_battery_cannot_take():
    from bev_preheat.nonlinear_program.solve import solve_optimum
    trip, _ = drawn_plan(307561, minimum_arrival_soc=0.0)
    goal = replace(trip.goal, minimum_arrival_soc=0.0)
    # The program takes free heat for any gain at all, and so does the method without the no-regret check.
    plan = plan_preheating(trip.vehicle, trip.route, trip.state, goal, no_regret=False)
    optimum = solve_optimum(trip.vehicle, trip.route, trip.state, goal).plan
    # At its full worth, that charge would not be spent on heat in time: 18 Wh more.
    assert plan.energy_wh.battery_total <= optimum.energy_wh.battery_total + 1.0


@pytest.mark.parametrize('soc', [0.07, 0.0625, 0.06])
def test_a_climb_that_needs_no_heat_does_not_lead_beyond_the_target(soc):
    # With an almost empty battery even 10 kW are near the limit, until the end of the route.
    car = load_vehicle('small_car')
    route = make_route({
        'duration_s': [30.0] * 11, 'speed_mps': [0.0],
        'propulsion_power_w': [2000.0] * 4 + [10058.0] * 7, 'ambient_temperature_c': [0.0],
        'cabin_heating_power_w': [0.0], 'auxiliary_power_w': [364.0]}, car.defaults)
    plan = plan_preheating(car, route, BatteryState(0.0, soc), Goal(1.0))
    assert plan.arrival_temperature_c == pytest.approx(1.0, abs=1e-3)


# Properties

@pytest.mark.costly
@DEAR
@given(number=NUMBERS, target_c=st.floats(-30.0, 60.0))
def test_heating_power_is_between_nothing_and_what_the_cabin_leaves(number, target_c):
    trip, plan = drawn_plan(number, target_temperature_c=target_c)
    left_w = np.maximum(
        trip.vehicle.hvch.maximum_power_w - trip.route.cabin_heating_power_w, 0.0)
    assert ((plan.hvch_battery_power_w >= 0.0) & (plan.hvch_battery_power_w <= left_w)).all()


@pytest.mark.costly
@DEAR
@given(number=NUMBERS, share=st.floats(0.0, 1.0))
def test_reserve_is_kept_whenever_it_can_be(number, share):
    _, warm = drawn_plan(number, minimum_arrival_soc=0.0)
    _, cold = drawn_plan(number, minimum_arrival_soc=0.0, target_temperature_c=-40.0)
    # Between the charge left by the target and that left without any target.
    reserve = warm.arrival_soc + share * (cold.arrival_soc - warm.arrival_soc)
    # Plans for two targets below the temperature reached anyway may differ as thresholds do.
    assume(0.05 < reserve <= cold.arrival_soc - THRESHOLDS_WH / PACK_WH)
    _, plan = drawn_plan(number, minimum_arrival_soc=reserve)
    # Rounding of the reserve, which is a sum.
    assert plan.arrival_soc >= reserve - 1e-9


@pytest.mark.costly
@DEAR
@given(number=NUMBERS, shares=st.tuples(st.floats(-0.1, 1.2), st.floats(-0.1, 1.2)))
# A reserve just above the charge that full heating leaves.
@example(number=4, shares=(0.5, 1e-11))
@example(number=4, shares=(0.5, 1e-7))
@example(number=10080, shares=(0.0, -0.0625))
def test_more_reserve_never_means_more_heating(number, shares):
    _, warm = drawn_plan(number, minimum_arrival_soc=0.0)
    _, cold = drawn_plan(number, minimum_arrival_soc=0.0, target_temperature_c=-40.0)
    heating_wh = []
    # If only a climb is heated for, both arrive with the same charge up to rounding.
    for reserve in sorted(warm.arrival_soc + share * (cold.arrival_soc - warm.arrival_soc) for share in shares):
        _, plan = drawn_plan(number, minimum_arrival_soc=float(np.clip(reserve, 0.0, 1.0)))
        heating_wh.append(plan.energy_wh.hvch_electric)
    assert heating_wh[1] <= heating_wh[0] + THRESHOLDS_WH


@pytest.mark.costly
@DEAR
@given(number=NUMBERS, warmer_k=st.floats(0.1, 20.0))
# A climb that is heated for in vain; a nearly full battery, which accepts less the fuller it is.
@example(number=608497, warmer_k=2.0)
@example(number=307561, warmer_k=19.195)
def test_higher_target_never_costs_less(number, warmer_k):
    trip, plan = drawn_plan(number, minimum_arrival_soc=0.0)
    _, warmer = drawn_plan(number, minimum_arrival_soc=0.0, target_temperature_c=(
        trip.goal.target_temperature_c + warmer_k))
    # A plan minimises the power deficit first, at any cost.
    assume(plan.undeliverable_power_w == warmer.undeliverable_power_w)
    assert (warmer.energy_wh.battery_total
            >= plan.energy_wh.battery_total - THRESHOLDS_WH)


@pytest.mark.costly
@given(number=NUMBERS, warmer_k=st.floats(0.1, 20.0))
# The same heat for a climb, a step later.
@example(number=138296, warmer_k=5.0)
def test_higher_target_never_means_less_heat_at_any_time_where_nothing_is_regenerated(
        number, warmer_k):
    # With a descent it can: heat for the target before it replaces heat that the descent alone would have
    # justified.
    trip = draw_limit_trip(SHIPPED_CAR, 17, number)
    assume(trip.route.propulsion_power_w.min() >= 0.0)
    _, plan = drawn_plan(number, minimum_arrival_soc=0.0)
    _, warmer = drawn_plan(number, minimum_arrival_soc=0.0, target_temperature_c=(
        trip.goal.target_temperature_c + warmer_k))
    assume(plan.undeliverable_power_w == warmer.undeliverable_power_w)
    # Before a climb heating is spread over the steps around the threshold in one way or another: a step later is
    # as good.
    heated_wh, warmer_heated_wh = (
        np.cumsum(each.hvch_battery_power_w * trip.route.duration_s) / 3600.0
        for each in (plan, warmer))
    assert (warmer_heated_wh[1:] >= heated_wh[:-1] - THRESHOLDS_WH).all()
    assert warmer_heated_wh[-1] >= heated_wh[-1] - THRESHOLDS_WH


@pytest.mark.costly
@DEAR
@given(number=NUMBERS, warmer_k=st.floats(0.1, 10.0))
def test_warmer_start_never_costs_more(number, warmer_k):
    trip, plan = drawn_plan(number, minimum_arrival_soc=0.0)
    warmer_state = replace(trip.state, temperature_c=trip.state.temperature_c + warmer_k)
    _, warmer = drawn_plan(number, warmer_state, minimum_arrival_soc=0.0)
    # A plan that misses its target may cost anything.
    assume(all(each.shortfall_k < 1e-3 and each.undeliverable_power_w == 0.0
               for each in (plan, warmer)))
    assert (warmer.energy_wh.battery_total
            <= plan.energy_wh.battery_total + THRESHOLDS_WH)


@pytest.mark.costly
@given(number=NUMBERS, target_c=st.floats(-10.0, 45.0))
def test_target_that_can_be_reached_is_reached(number, target_c):
    trip, plan = drawn_plan(number, target_temperature_c=target_c, minimum_arrival_soc=0.0)
    assume(hottest_arrival_c(trip) >= target_c + 0.01)
    # Below 5 % the vehicle's own reserve interferes.
    assume(plan.arrival_soc > 0.06)
    assert plan.shortfall_k <= 1e-3


@pytest.mark.costly
@given(number=NUMBERS, start_c=st.floats(50.0, 60.0), target_c=st.floats(55.0, 60.0))
def test_heating_never_leads_beyond_the_highest_temperature(number, start_c, target_c):
    _, plan = drawn_plan(
        number, BatteryState(start_c, 0.8), target_temperature_c=target_c,
        minimum_arrival_soc=0.0)
    heated = plan.hvch_battery_power_w > 0.0
    # Tolerance to which the heater is cut.
    assert (plan.battery_temperature_c[1:][heated] <= 60.0 + 1e-6).all()


# Climbs

def test_climb_that_heating_can_meet_is_met():
    route = drive((60, 15e3), (4, 140e3), (10, 15e3))
    plan = plan_of(route, target_c=-12.0)
    limit_w = bilinear(DISCHARGE_W, plan.soc[:-1], plan.battery_temperature_c[:-1])
    assert (battery_power_w(CAR, plan, route) <= limit_w * (1.0 + 1e-6)).all()


def test_climb_that_heating_can_meet_cannot_be_met_without():
    plan = plan_preheating(CAR, drive((60, 15e3), (4, 140e3), (10, 15e3)), START,
                           Goal(-12.0, charging_planned=False))
    assert plan.undeliverable_power_w > 5e3


def test_climb_is_heated_for_no_more_than_needed():
    route = drive((60, 15e3), (4, 140e3), (10, 15e3))
    plan = plan_of(route, target_c=-12.0)
    power_w = battery_power_w(CAR, plan, route)
    limit_w = bilinear(DISCHARGE_W, plan.soc[:-1], plan.battery_temperature_c[:-1])
    # A climb is met with at most 1e-5 of its power to spare; losses grow with it, to 1.3e-5.
    assert ((limit_w - power_w) / power_w)[60:64].min() <= 1.5e-5


def test_climb_leaves_the_battery_its_heater_for_nothing_else():
    route = drive((60, 15e3), (4, 140e3), (10, 15e3))
    plan = plan_of(route, target_c=-12.0)
    assert not plan.hvch_battery_power_w[64:].any()


@pytest.fixture(scope='module')
def too_steep():
    """Route and plan of a climb that no heating makes possible."""
    route = drive((20, 15e3), (3, 150e3), (2, 170e3), (3, 20e3))
    return route, plan_of(route, target_c=-12.0)


def test_climb_that_heating_cannot_meet_is_reported_where_it_is_worst(too_steep):
    _, plan = too_steep
    assert (plan.status, plan.undeliverable_at_s) == (Status.POWER_LIMITED, 23 * 30.0)


def missing_w(route, plan):
    soc, temperature_c = plan.soc[:-1], plan.battery_temperature_c[:-1]
    u, r = 365.0 + 75.0 * soc + 15.0 * soc**3, 4.2 / (temperature_c + 45.0)
    most_a = np.minimum(bilinear(DISCHARGE_W, soc, temperature_c) / u, u / (2 * r))
    return (route.propulsion_power_w + 1500.0 + 400.0) - (u * most_a - r * most_a**2)


def test_climb_that_heating_cannot_meet_is_reported_with_what_is_missing(too_steep):
    route, plan = too_steep
    assert plan.undeliverable_power_w == pytest.approx(missing_w(route, plan).max(), rel=1e-9)


def test_climb_that_heating_cannot_meet_is_explained(too_steep):
    route, plan = too_steep
    assert plan.explanation.startswith(
        f'In 11:30 min the route needs {missing_w(route, plan).max() / 1000:.1f} kW more than '
        'the battery can deliver;')


def test_climb_that_heating_cannot_meet_is_heated_for_with_all_there_is(too_steep):
    _, plan = too_steep
    assert plan.hvch_battery_power_w[:20].tolist() == [5500.0] * 20


def test_nothing_is_heated_where_the_battery_cannot_give_what_is_driven(too_steep):
    _, plan = too_steep
    assert not plan.hvch_battery_power_w[20:25].any()


def test_rest_of_a_route_with_a_climb_that_cannot_be_met_is_planned():
    plan = plan_of(drive((20, 15e3), (3, 170e3), (60, 20e3)), target_c=12.0)
    assert (plan.status, plan.arrival_temperature_c) == (
        Status.POWER_LIMITED, pytest.approx(12.0, abs=1e-3))


# Descents

def test_surplus_of_a_descent_is_heated_with_although_the_target_is_met_anyway():
    # 40 kW of regeneration; all that the battery cannot accept is free.
    plan = plan_of(drive((10, 5e3), (20, -40e3), (10, 15e3)), target_c=-12.0)
    assert plan.hvch_battery_power_w[10:14].tolist() == [5500.0] * 4


def test_descent_saves_energy_against_heating_at_the_end():
    route, goal = drive((10, 5e3), (40, -30e3), (60, 15e3)), Goal(14.0)
    switch = plan_preheating(CAR, route, START, goal, 'optimal_switch')
    driven = as_driven(switch, CAR, route, START, goal)
    plan = plan_preheating(CAR, route, START, goal)
    # The heater takes 5.5 kW that the brake would waste, for most of 20 min: about 1.5 kWh.
    assert plan.energy_wh.battery_total < driven.energy_wh.battery_total - 1000.0


# Cabin

def test_cabin_that_takes_more_than_the_heater_leaves_nothing():
    plan = plan_of(drive((40, 15e3), cabin_w=7500.0))
    assert (plan.status, plan.heating_start_s, plan.hvch_battery_power_w.any()) == (
        Status.TARGET_UNREACHABLE, None, False)


def test_battery_gets_what_a_changing_cabin_leaves():
    cabin_w = np.repeat([0.0, 7500.0, 3000.0, 7000.0, 1200.0], 12)
    plan = plan_of(drive((50, 15e3), (2, 180e3), (8, 15e3), cabin_w=cabin_w), target_c=30.0)
    # The limit is active at the climb only; everywhere else full power is wanted.
    assert np.delete(plan.hvch_battery_power_w, [50, 51]).tolist() == np.delete(
        np.repeat([7000.0, 0.0, 4000.0, 0.0, 5800.0], 12), [50, 51]).tolist()


# Reserve

def test_reserve_that_the_target_would_cost_is_explained_in_kelvin():
    route = drive((60, 15e3))
    unlimited = plan_of(route)
    reserve = unlimited.arrival_soc + 0.008
    plan = plan_of(route, minimum_arrival_soc=reserve)
    minutes, seconds = divmod(round(plan.heating_start_s), 60)
    assert (plan.status, plan.explanation) == (
        Status.SOC_LIMITED, f'To keep the {100 * reserve:.1f} % reserve, the target is missed '
        f'by {10.0 - plan.arrival_temperature_c:.1f} K: heating starts in {minutes}:{seconds:02d} '
        f'min; arrival in 30:00 min at {plan.arrival_temperature_c:.1f} degC, target 10.0 degC.')


def test_reserve_is_used_up_to_be_warm():
    route = drive((60, 15e3))
    reserve = plan_of(route).arrival_soc + 0.008
    # Met to 1e-5, or a watt-hour.
    assert plan_of(route, minimum_arrival_soc=reserve).arrival_soc == pytest.approx(
        reserve, abs=1.1e-5)


@pytest.fixture(scope='module')
def short_of_reserve():
    """Reserve and plan of a trip that misses the reserve in any case."""
    route = drive((60, 15e3))
    reserve = plan_of(route, charging_planned=False).arrival_soc + 0.03
    return reserve, plan_of(route, minimum_arrival_soc=reserve)


def test_reserve_that_is_missed_anyway_means_no_heating(short_of_reserve):
    _, plan = short_of_reserve
    assert (plan.status, plan.heating_start_s, plan.hvch_battery_power_w.any()) == (
        Status.SOC_LIMITED, None, False)


def test_reserve_that_is_missed_anyway_is_explained_in_per_cent(short_of_reserve):
    reserve, plan = short_of_reserve
    assert plan.explanation == (
        f'The battery arrives 3.0 % below the {100 * reserve:.1f} % reserve: the heater '
        f'stays off; arrival in 30:00 min at {plan.arrival_temperature_c:.1f} degC, target 10.0 degC.')


def test_lack_of_reserve_is_what_is_missing(short_of_reserve):
    _, plan = short_of_reserve
    assert plan.soc_shortfall == pytest.approx(0.03, rel=1e-9)


def test_lowest_state_of_charge_of_the_vehicle_is_a_reserve():
    # Half an hour at 16.9 kW and its losses, not the heat as well.
    state = BatteryState(-12.0, 0.05 + 0.5 * 16.9e3 / PACK_WH + 0.02)
    # Met to 1e-5.
    assert plan_of(drive((60, 15e3)), target_c=25.0, state=state).arrival_soc == pytest.approx(
        0.05, abs=1.1e-5)


# No charging

def test_no_charging_planned_means_no_heating_even_with_surplus():
    plan = plan_of(drive((10, 5e3), (20, -40e3), (10, 15e3)), charging_planned=False)
    assert (plan.status, plan.heating_start_s, plan.hvch_battery_power_w.any()) == (
        Status.NO_CHARGING_PLANNED, None, False)


# Extremes: a status and finite numbers, neither an exception nor a warning

EXTREMES = {
    'one_segment': (drive((1, 90e3)), 10.0, START),
    'one_segment_of_regeneration': (drive((1, -90e3)), 10.0, START),
    'all_descent': (drive((40, -60e3)), 10.0, START),
    'no_heater': (drive((20, 15e3), (5, -60e3), (5, 150e3), cabin_w=7000.0), 10.0, START),
    'no_heater_at_the_end': (drive(
        (20, 15e3), (5, -60e3), cabin_w=np.repeat([0.0, 9e3], [15, 10])), 10.0, START),
    'target_below_start': (drive((20, 15e3)), -30.0, START),
    # Free heat is used.
    'descent_and_target_below_start': (drive((20, 15e3), (5, -60e3)), -30.0, START),
    'full_with_regeneration': (drive((20, -60e3), (20, 15e3)), 10.0, BatteryState(-12.0, 1.0)),
    'lowest_charge': (drive((20, 15e3)), 10.0, BatteryState(-12.0, 0.05)),
    'empty': (drive((20, 15e3)), 10.0, BatteryState(-12.0, 0.0)),
    'highest_temperatures': (drive((20, -60e3), (20, 50e3), ambient_c=60.0), 60.0,
                             BatteryState(60.0, 0.8)),
    'lowest_temperatures': (drive((20, -60e3), (20, 50e3), ambient_c=-40.0), -40.0,
                            BatteryState(-40.0, 0.8)),
    'coldest_to_hottest': (drive((20, -60e3), (20, 150e3), ambient_c=-40.0), 60.0,
                           BatteryState(-40.0, 0.8)),
    'stops_only': (drive((40, 0.0), cabin_w=0.0), 10.0, START),
    'far_too_much': (drive((20, 400e3), step_s=900.0), 10.0, BatteryState(-12.0, 0.9)),
    'many_steps': (drive((1200, 15e3), (300, -60e3), (300, 20e3), step_s=0.25), 10.0, START),
    'long_steps': (drive((4, -60e3), (4, 30e3), step_s=3600.0), 10.0, START),
    'quarter_seconds': (drive((9600, 15e3), (2400, -60e3), (2400, 20e3), step_s=0.25), 10.0,
                        START)}


@pytest.mark.costly
@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', [
    pytest.param(name, marks=pytest.mark.deep if name == 'quarter_seconds' else ())
    for name in EXTREMES])
def test_extreme_trip_has_finite_numbers(name):
    route, target_c, state = EXTREMES[name]
    plan = plan_of(route, target_c, state)
    assert np.isfinite([
        *plan.battery_temperature_c, *plan.soc, *plan.hvch_battery_power_w,
        *plan.friction_brake_power_w, *vars(plan.energy_wh).values()]).all()


@pytest.mark.parametrize('name, status', [
    ('one_segment', Status.TARGET_UNREACHABLE), ('no_heater', Status.POWER_LIMITED),
    ('target_below_start', Status.NOT_NEEDED), ('descent_and_target_below_start', Status.WAITING),
    ('lowest_charge', Status.SOC_LIMITED),
    ('empty', Status.OUT_OF_CHARGE), ('stops_only', Status.TARGET_UNREACHABLE),
    ('far_too_much', Status.OUT_OF_CHARGE), ('coldest_to_hottest', Status.POWER_LIMITED),
    pytest.param('quarter_seconds', Status.WAITING, marks=pytest.mark.deep)])
def test_extreme_trip_has_a_status(name, status):
    route, target_c, state = EXTREMES[name]
    assert plan_of(route, target_c, state).status is status


@pytest.mark.deep
def test_steps_of_a_quarter_second_cost_what_steps_of_thirty_do():
    short, long = (plan_of(drive((4800 // n, 15e3), (1200 // n, -60e3), (2400 // n, 20e3),
                                 step_s=0.25 * n)) for n in (1, 120))
    # Limits are kept at the start of each step: half a minute's difference in regeneration, out of about 2.5 kWh.
    assert short.energy_wh.battery_total == pytest.approx(
        long.energy_wh.battery_total, abs=40.0)


def test_schedule_is_optimal_switch_itself_where_no_limit_acts():
    trip = make_trip(CAR, drive((40, 15e3)))
    plan, switch = (method(trip, START, Goal(5.0)) for method in (
        plan_merit_order, plan_optimal_switch))
    assert plan.temperature_c.tolist() == switch.temperature_c.tolist()
