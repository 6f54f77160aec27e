# SPDX-License-Identifier: Apache-2.0
"""
The program's solution against its own constraints, in a car whose equations are written a second time.

The planner's switching instant must cost no less than the program, and hardly more.
"""

from dataclasses import replace
from functools import cache
import math

import numpy as np
from own_car import Car
import pytest
import short_stretches

from bev_preheat.nonlinear_program import program, solve
from bev_preheat.nonlinear_program.program import SUCCESS
from bev_preheat.nonlinear_program.solve import (
    ARRIVAL_SOC,
    CHARGE,
    HIGHEST_SOC,
    HIGHEST_TEMPERATURE,
    LOWEST_SOC,
    NOT_SOLVED,
    solve_optimum,
    SolverFailure,
    TARGET,
)
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.route.segments import make_route
from bev_preheat.tunables import HEATING_PRICE
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

pytestmark = pytest.mark.costly

VEHICLES = {name: load_vehicle(name) for name in ('reference', 'small_car')}
REFERENCE = VEHICLES['reference']
STATE = BatteryState(temperature_c=-7.0, soc=0.9)
GOAL = Goal(25.0)


def made_route(**columns):
    return make_route({
        'duration_s': [30.0], 'speed_mps': [21.0], 'propulsion_power_w': [17e3],
        'ambient_temperature_c': [-6.0], 'cabin_heating_power_w': [1700.0],
        'auxiliary_power_w': [450.0], **columns}, REFERENCE.defaults)


def uneven_route():
    """Forty minutes of traffic in steps of 5 to 90 s."""
    random = np.random.default_rng(5)
    duration_s = random.uniform(5.0, 90.0, 50)
    power_w = random.uniform(2e3, 40e3, 50)
    return made_route(
        duration_s=duration_s, speed_mps=random.uniform(5.0, 35.0, 50),
        propulsion_power_w=power_w, propulsion_power_rms_w=power_w * random.uniform(1.0, 1.6, 50),
        ambient_temperature_c=random.uniform(-9.0, -3.0, 50),
        cabin_heating_power_w=random.uniform(300.0, 3000.0, 50))


# Twenty minutes downhill in deep cold, with some driving before and after.
DESCENT = made_route(propulsion_power_w=[14e3] * 20 + [-30e3] * 40 + [14e3] * 30,
                     ambient_temperature_c=[-12.0])

TRIPS = {
    'reference': (REFERENCE, load_route('reference', REFERENCE.defaults), STATE, GOAL),
    'uneven': (REFERENCE, uneven_route(), BatteryState(-4.0, 0.77), Goal(21.0)),
    'descent': (REFERENCE, DESCENT, BatteryState(-12.0, 0.83), Goal(13.0)),
    'small_car': (VEHICLES['small_car'],
                  load_route('winter_commute', VEHICLES['small_car'].defaults),
                  BatteryState(-3.0, 0.81), Goal(4.0, 0.2)),
}
# Trips on which no limit but the heater's is active.
UNLIMITED = ('reference', 'uneven', 'small_car')


@cache
def solution_of(name):
    """Optimum of a trip in TRIPS; each is solved once."""
    optimum = solve_optimum(*TRIPS[name])
    assert (optimum.solver_status, optimum.infeasible) == (SUCCESS, ())
    return optimum


@pytest.fixture(params=TRIPS)
def trip(request):
    """(vehicle, route, state, goal, plan) of each of TRIPS."""
    return (*TRIPS[request.param], solution_of(request.param).plan)


def test_states_and_energy_are_those_of_a_drive_under_its_powers(trip):
    vehicle, route, state, _, plan = trip
    run = Car(vehicle).drive(route, state, plan.hvch_battery_power_w, plan.friction_brake_power_w)
    # IPOPT closes each step to 1e-9 of a per cent and of a kelvin.
    assert np.abs(run[:, 0] - plan.soc).max() < 1e-8
    assert np.abs(run[:, 1] - plan.battery_temperature_c).max() < 1e-6
    assert plan.energy_wh.battery_total == pytest.approx(run[-1, 2], abs=1e-3)


def test_powers_states_and_arrival_keep_their_limits(trip):
    vehicle, route, _, goal, plan = trip
    heater_w, brake_w, battery, car = (
        plan.hvch_battery_power_w, plan.friction_brake_power_w, vehicle.battery, Car(vehicle))
    assert ((heater_w >= 0.0) & (heater_w <= car.heater_limit_w(route))).all()
    assert ((brake_w >= 0.0) & (brake_w <= np.maximum(-route.propulsion_power_w, 0.0))).all()
    assert battery.soc_range[0] <= plan.soc.min() and plan.soc.max() <= battery.soc_range[1]
    assert battery.temperature_range_c[0] <= plan.battery_temperature_c.min()
    assert plan.battery_temperature_c.max() <= battery.temperature_range_c[1]
    # Constraints hold to 1e-9 of their scaled size.
    assert plan.arrival_temperature_c >= goal.target_temperature_c - 1e-6
    assert plan.arrival_soc >= goal.minimum_arrival_soc - 1e-8
    # To a milliwatt out of about 10 kW.
    assert car.beyond_w(route, plan.soc, plan.battery_temperature_c, heater_w, brake_w).max() <= 1e-3


@pytest.mark.parametrize('name', UNLIMITED)
def test_optimal_switch_is_within_a_tenth_of_a_watt_hour_and_not_below(name):
    plan = plan_preheating(*TRIPS[name], 'optimal_switch')
    gap_wh = plan.energy_wh.battery_total - solution_of(name).plan.energy_wh.battery_total
    # Below by at most IPOPT's tolerance.
    assert -1e-3 < gap_wh < 0.1


def gap_of_short_stretch_wh(number):
    inputs = short_stretches.draw(number)
    return (plan_preheating(*inputs).energy_wh.battery_total
            - solve_optimum(*inputs, False).plan.energy_wh.battery_total)


def test_merit_order_is_within_a_tenth_of_a_watt_hour_where_a_short_stretch_makes_heating_cheaper():
    assert -1e-3 < gap_of_short_stretch_wh(2) < 0.1


@pytest.mark.deep
def test_plans_over_short_stretches_are_as_close_to_the_program_as_all_plans():
    gaps_wh = [gap_of_short_stretch_wh(number) for number in range(2, 40)]
    # Required of drawn drives: a median of 0.1, and 1 Wh at 95 %.
    assert min(gaps_wh) > -1e-3 and np.median(gaps_wh) < 0.1 and max(gaps_wh) < 1.0


def test_brake_takes_what_a_cold_battery_may_not_and_nothing_else():
    assert (solution_of('descent').plan.friction_brake_power_w > 1.0).any()
    warm = solve_optimum(REFERENCE, DESCENT, BatteryState(26.0, 0.83), Goal(13.0))
    # An interior point leaves 1 W of about 10 kW.
    for optimum in (warm, *map(solution_of, UNLIMITED)):
        assert optimum.plan.friction_brake_power_w.max() < 1.0


def test_a_price_of_heating_leaves_surplus_to_the_brake_that_saves_less():
    plans = {price: solve_optimum(*TRIPS['descent'][:3], Goal(-10.0), heating_price=price).plan
             for price in (0.0, 0.5)}
    for price, own in plans.items():
        costs_wh = [plan.energy_wh.battery_total + price * plan.energy_wh.hvch_electric
                    for plan in (own, plans[0.5 - price])]
        assert costs_wh[0] < costs_wh[1] - 10.0


def test_unreachable_target_lacks_what_full_heating_misses():
    vehicle, route, state, _ = TRIPS['reference']
    car, route = Car(vehicle), route.resampled(120.0)
    optimum = solve_optimum(vehicle, route, state, Goal(51.0))
    arrival_c = car.drive(route, state, car.heater_limit_w(route))[-1, 1]
    (deficit,) = optimum.deficit
    assert (deficit.constraint, deficit.unit) == (TARGET, 'K')
    # The prices of the slacks leave the heater 1e-6 short of its maximum.
    assert deficit.amount == pytest.approx(51.0 - arrival_c, abs=1e-3)
    assert optimum.infeasible == (f'target temperature: missed by {deficit.amount:.2f} K',)
    assert optimum.solver_status != SUCCESS
    assert optimum.plan.status is Status.TARGET_UNREACHABLE
    assert math.isnan(optimum.marginal_cost_wh_per_k)


def test_reserve_that_driving_alone_breaks_lacks_what_driving_misses():
    vehicle, route, state, _ = TRIPS['reference']
    route = route.resampled(120.0)
    arrival_soc = Car(vehicle).drive(route, state, np.zeros(len(route)))[-1, 0]
    optimum = solve_optimum(vehicle, route, state, Goal(-20.0, arrival_soc + 0.04))
    (deficit,) = optimum.deficit
    assert (deficit.constraint, deficit.unit) == (ARRIVAL_SOC, '%')
    assert deficit.amount == pytest.approx(4.0, abs=1e-3)


# The deficits of target and reserve, above, are daily.
@pytest.mark.deep
def test_charge_comes_before_warmth():
    vehicle, route, state, goal = TRIPS['reference']
    car, route = Car(vehicle), route.resampled(120.0)
    idle, full = (car.drive(route, state, share * car.heater_limit_w(route)) for share in (0, 1))
    reserve = 0.5 * (idle[-1, 0] + full[-1, 0])
    optimum = solve_optimum(vehicle, route, state, Goal(51.0, reserve))
    assert [item.constraint for item in optimum.deficit] == [TARGET]
    assert optimum.plan.arrival_soc == pytest.approx(reserve, abs=1e-7)


def test_state_of_charge_that_leaves_its_range_on_the_way_is_lacking():
    # Nearly empty over a hill: on the way down it recovers.
    route = made_route(duration_s=[60.0], propulsion_power_w=[10e3] * 20 + [-20e3] * 10,
                       ambient_temperature_c=[14.0])
    state = BatteryState(16.0, 0.07)
    run = Car(REFERENCE).drive(route, state, np.zeros(30))
    assert run[-1, 0] > 0.05
    optimum = solve_optimum(REFERENCE, route, state, Goal(-10.0))
    (deficit,) = optimum.deficit
    assert (deficit.constraint, deficit.unit) == (LOWEST_SOC, '%')
    # No heating could help; the worst instant is the top of the hill.
    assert deficit.amount == pytest.approx(100.0 * (0.05 - run[20, 0]), abs=1e-3)
    assert deficit.text.endswith('% below its range at 1200 s')


def test_regeneration_into_a_full_battery_without_limits_is_lacking():
    route = made_route(propulsion_power_w=[-30e3] * 40, ambient_temperature_c=[14.0])
    state = BatteryState(16.0, 0.99)
    optimum = solve_optimum(REFERENCE, route, state, Goal(-10.0), limited=False)
    (deficit,) = optimum.deficit
    assert (deficit.constraint, deficit.unit) == (HIGHEST_SOC, '%')
    # Even with the heater at full power.
    car = Car(REFERENCE)
    full = car.drive(route, state, car.heater_limit_w(route))
    assert deficit.amount == pytest.approx(100.0 * (full[-1, 0] - 1.0), abs=1e-3)


@pytest.mark.deep
@pytest.mark.parametrize('number', [545, 772])
def test_an_optimum_at_a_corner_of_a_map_is_found(number):
    trip = draw_limit_trip(REFERENCE, 1, number)
    # At the plan's price of heating, or they solve different problems.
    optimum = solve_optimum(trip.vehicle, trip.route, trip.state, trip.goal, heating_price=HEATING_PRICE)
    assert (optimum.solver_status, optimum.deficit) == (SUCCESS, ())
    plan, heater_w = optimum.plan, optimum.plan.hvch_battery_power_w
    best = plan_preheating(trip.vehicle, trip.route, trip.state, trip.goal)
    assert best.energy_wh.battery_total - 0.1 < plan.energy_wh.battery_total < best.energy_wh.battery_total
    car, powers_w = Car(REFERENCE), (heater_w, plan.friction_brake_power_w)
    driven = car.drive(trip.route, trip.state, *powers_w)
    assert driven[-1, 1:] == pytest.approx([plan.arrival_temperature_c, plan.energy_wh.battery_total], abs=1e-3)
    assert car.beyond_w(trip.route, driven[:, 0], driven[:, 1], *powers_w).max() <= 15.0


# The gap study meets both trips, in make test-deep.
@pytest.mark.parametrize('number', [pytest.param(137, marks=pytest.mark.deep), 324])
def test_power_of_a_climb_comes_before_the_highest_temperature(number):
    trip = draw_limit_trip(REFERENCE, 1, number)
    car, highest_c = Car(REFERENCE), REFERENCE.battery.temperature_range_c[1]

    def driven(heater_w):
        """Return the worst power deficit of a step, at either end [W], and the highest temperature."""
        soc, temperature_c, _ = car.drive(trip.route, trip.state, heater_w).T
        beyond_w = car.beyond_w(trip.route, soc, temperature_c, heater_w, np.zeros(len(heater_w)))
        return beyond_w[:, 0].max(), temperature_c.max()

    optimum = solve_optimum(trip.vehicle, trip.route, trip.state, trip.goal)
    (deficit,) = optimum.deficit
    assert (deficit.constraint, deficit.unit) == (HIGHEST_TEMPERATURE, 'K')
    deficit_w, warmest_c = driven(optimum.plan.hvch_battery_power_w)
    assert deficit_w < 1.0
    assert deficit.amount == pytest.approx(warmest_c - highest_c, abs=1e-3)
    # Heat for the climb takes the least charge shortly before it: whatever the heat, either temperature or power
    # gives.
    limit_w, climb = car.heater_limit_w(trip.route), int(trip.route.propulsion_power_w.argmax())
    most_j = (limit_w * trip.route.duration_s)[:climb]
    later_j = np.append(np.cumsum(most_j[::-1])[::-1][1:], 0.0)
    warmest = []
    for heat_j in np.linspace(0.0, most_j.sum(), 8):
        heater_w = np.zeros(len(trip.route))
        heater_w[:climb] = np.clip(heat_j - later_j, 0.0, most_j) / trip.route.duration_s[:climb]
        deficit_w, warmest_c = driven(heater_w)
        assert deficit_w > 0.0 or warmest_c > highest_c, heat_j
        warmest += [warmest_c] if deficit_w <= 0.0 else []
    assert warmest and deficit.amount <= min(warmest) - highest_c + 1e-3


def test_a_trip_that_the_charge_does_not_carry_is_not_given_to_the_solver():
    # The same climb until the battery is empty.
    trip = draw_limit_trip(REFERENCE, 1, 72)
    optimum = solve_optimum(trip.vehicle, trip.route, trip.state, trip.goal)
    (deficit,) = optimum.deficit
    assert (optimum.solver_status, deficit.constraint, deficit.unit) == (NOT_SOLVED, CHARGE, 'Wh')
    assert (optimum.plan.status, optimum.plan.soc.min(), optimum.plan.energy_wh.hvch_electric) == (
        Status.OUT_OF_CHARGE, 0.0, 0.0)
    minutes, seconds = divmod(round(optimum.plan.stranding.at_s), 60)
    instant = (f'{minutes}:{seconds:02d} min' if minutes < 60 else
               f'{minutes // 60}:{minutes % 60:02d}:{seconds:02d} h')
    assert f'empty in {instant}' in optimum.plan.explanation
    assert optimum.infeasible == (
        f'charge: {optimum.plan.stranding.deficit_wh / 1e3:.2f} kWh short; the '
        f'battery will be empty at {optimum.plan.stranding.at_s:.0f} s',)


def test_solver_that_may_not_iterate_is_a_failure(monkeypatch):
    monkeypatch.setitem(program.IPOPT_OPTIONS, 'ipopt.max_iter', 2)
    # Programs are cached per vehicle; this one has none yet.
    with pytest.raises(SolverFailure, match='Maximum_Iterations_Exceeded'):
        solve_optimum(replace(REFERENCE), made_route(duration_s=[60.0] * 15), BatteryState(-4.0, 0.8), Goal(2.0))


@pytest.fixture
def failing_runs(monkeypatch):
    """
    Report the first runs of the program itself as failed; their number is to be set.

    The first of them is the run without power limits.
    """
    limit, attempt = {'runs': 0}, solve.attempt

    def failing(problem, limited, give=program.Give.NOTHING, starts=()):
        result = attempt(problem, limited, give, starts)
        if give is program.Give.NOTHING and limit['runs'] > 0:
            limit['runs'] -= 1
            return replace(result, status='Restoration_Failed')
        return result

    monkeypatch.setattr(solve, 'attempt', failing)
    return limit


@pytest.mark.parametrize('runs, within_wh', [
    pytest.param(2, 1e-3, id='from there', marks=pytest.mark.deep),
    pytest.param(3, 0.02, id='with rounded corners')])
def test_failure_on_a_trip_that_can_be_kept_is_tried_again(failing_runs, runs, within_wh):
    failing_runs['runs'] = runs
    optimum = solve_optimum(*TRIPS['uneven'])
    assert (optimum.solver_status, optimum.deficit) == (SUCCESS, ())
    assert optimum.plan.energy_wh.battery_total == pytest.approx(
        solution_of('uneven').plan.energy_wh.battery_total, abs=within_wh)


def test_failure_on_a_trip_that_can_be_kept_is_no_optimum(failing_runs):
    failing_runs['runs'] = 4
    with pytest.raises(SolverFailure, match='Restoration_Failed'):
        solve_optimum(*TRIPS['uneven'])


def test_marginal_cost_is_what_one_more_kelvin_costs():
    vehicle, route, state, _ = TRIPS['reference']
    colder_wh, warmer_wh = (
        solve_optimum(vehicle, route, state, Goal(target_c)).plan.energy_wh.battery_total
        for target_c in (24.0, 26.0))
    # The cost grows by less than 1 % per kelvin, so the central difference is accurate to 0.1 %.
    assert solution_of('reference').marginal_cost_wh_per_k == pytest.approx(
        0.5 * (warmer_wh - colder_wh), rel=5e-3)


def test_nothing_is_heated_where_no_charging_is_planned():
    vehicle, route, state, _ = TRIPS['reference']
    optimum = solve_optimum(vehicle, route, state, Goal(25.0, charging_planned=False))
    idle_wh = Car(vehicle).drive(route, state, np.zeros(len(route)))[-1, 2]
    assert (optimum.plan.status, optimum.deficit) == (Status.NO_CHARGING_PLANNED, ())
    assert optimum.plan.energy_wh.battery_total == pytest.approx(idle_wh, abs=1e-2)
