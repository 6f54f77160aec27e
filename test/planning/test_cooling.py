# SPDX-License-Identifier: Apache-2.0
"""Plans of cars that cool their battery before a fast charge, in a plant of their own."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise

import numpy as np
from own_sources import ALONE, driven, REFERENCE, vehicle_with
import pytest
from refusals import problems_of

from bev_preheat.errors import InvalidInput
from bev_preheat.nonlinear_program.solve import solve_optimum
from bev_preheat.planning.heat_mix import HeatMix
from bev_preheat.planning.plan import energy_gap_wh
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.vehicle.core_library import without_core
from bev_preheat.vehicle.loading import load_vehicle

CHILLER = {'maximum_power_w': {'temperature_c': [20, 25], 'values': [0, 3000]},
           'heat_per_watt': {'ambient_c': [20, 45], 'temperature_c': [20, 45],
                             'values': [[-2.5, -3.2], [-1.6, -2.2]]}}
RADIATOR = {'maximum_power_w': {'temperature_c': [36, 44], 'values': [0, 200]}, 'heat_per_watt': -6.0,
            'only_while': 'driving'}


VEHICLE, BOTH = vehicle_with({'chiller': CHILLER}), vehicle_with({'chiller': CHILLER, 'radiator': RADIATOR})


def summer(name='reference', air_c=35.0):
    route = load_route(name, VEHICLE.defaults)
    return replace(route, ambient_temperature_c=np.full(len(route), air_c),
                   cabin_heating_power_w=np.zeros(len(route)))


ROUTE = summer()


def planned(vehicle=VEHICLE, temperature_c=45.0, most_c=35.0, route=ROUTE, soc=0.9, target_c=22.0, **how):
    return plan_preheating(vehicle, route, BatteryState(temperature_c, soc),
                           Goal(target_c, maximum_arrival_temperature_c=most_c), **how)


@pytest.mark.parametrize(('heat_per_watt', 'problem'), [
    (-0.01, '-0.01 is not allowed; it must be -10 ... -0.05'),
    ({'temperature_c': [0, 30], 'values': [-2, 1]}, '1 is not allowed; it must be -10 ... -0.05')])
def test_heat_per_watt_of_two_signs_or_none_is_refused(heat_per_watt, problem):
    assert problems_of(vehicle_with, {'chiller': {**CHILLER, 'heat_per_watt': heat_per_watt}}) == [
        f'the file: heat_sources.chiller.heat_per_watt: {problem}']


@pytest.mark.parametrize(('most_c', 'rise_k', 'problem'), [
    *((most_c, 0.0, 'maximum arrival temperature: .* must be 22 ... 60 degC')
      for most_c in (21.9, np.nan, -np.inf)),
    *((35.0, rise_k, 'local rise: .* must be 0 ... 150 K') for rise_k in (-0.1, np.nan))])
def test_a_highest_temperature_below_the_target_and_a_negative_rise_are_refused(most_c, rise_k, problem):
    goal = Goal(22.0, maximum_arrival_temperature_c=most_c, local_rise_k=rise_k)
    with pytest.raises(InvalidInput, match=problem):
        plan_preheating(VEHICLE, ROUTE, BatteryState(45.0, 0.9), goal)


@pytest.mark.parametrize(('target_c', 'arrival_c'), [(22.0, 34.3), (34.8, 34.8)])
def test_a_place_that_is_warmer_keeps_the_highest_temperature_if_the_target_allows_it(target_c, arrival_c):
    goal = Goal(target_c, maximum_arrival_temperature_c=35.0, local_rise_k=0.7)
    situation = VEHICLE, ROUTE, BatteryState(45.0, 0.9), goal
    for plan in (plan_preheating(*situation), solve_optimum(*situation).plan):
        assert (plan.arrival_temperature_c, plan.shortfall_k) == (
            pytest.approx(arrival_c, abs=0.05), pytest.approx(0.0, abs=0.05))


@pytest.mark.parametrize(('temperature_c', 'most_c'), [(45.0, 35.0), (30.0, 40.0), (50.0, 25.0)])
def test_the_battery_arrives_as_planned_in_another_plant(temperature_c, most_c):
    plan = planned(temperature_c=temperature_c, most_c=most_c)
    run = driven(plan, ROUTE, {'chiller': CHILLER}, 0.9)
    assert run.temperature_c == pytest.approx(most_c, abs=0.03)
    assert run.soc == pytest.approx(plan.arrival_soc, abs=2e-4)
    assert plan.heating_start_s is None and plan.intervals == ()
    assert plan.status is Status.WAITING_TO_COOL
    assert f'degC, at most {most_c:.1f} degC. Sources: chiller.' in plan.explanation


@pytest.mark.parametrize(('temperature_c', 'most_c'), [(45.0, 35.0), (38.0, 30.0)])
def test_close_to_the_program(temperature_c, most_c):
    plan = planned(temperature_c=temperature_c, most_c=most_c)
    optimum = solve_optimum(VEHICLE, ROUTE, BatteryState(temperature_c, 0.9),
                            Goal(22.0, maximum_arrival_temperature_c=most_c))
    assert optimum.solver_status == 'Solve_Succeeded'
    assert -0.1 < energy_gap_wh(plan, optimum.plan) < 0.5


@pytest.mark.parametrize(('vehicle', 'route', 'uncertainty'), [
    (VEHICLE, ROUTE, None), (BOTH, summer('alpine_pass'), None), (BOTH, ROUTE, Uncertainty(1.0))])
def test_the_core_plans_as_python_does(vehicle, route, uncertainty):
    native = planned(vehicle, route=route, uncertainty=uncertainty, soc=0.97)
    with without_core():
        python = planned(vehicle, route=route, uncertainty=uncertainty, soc=0.97)
    assert native.status is python.status
    assert native.energy_wh.battery_total == pytest.approx(python.energy_wh.battery_total, abs=0.1)
    assert native.arrival_temperature_c == pytest.approx(python.arrival_temperature_c, abs=0.005)


@pytest.mark.parametrize('start_c', [28.0, 29.5])
@pytest.mark.parametrize('is_native', [True, False])
def test_a_pause_of_cooling_is_not_bridged_by_heat(start_c, is_native):
    """Four seconds of heat cost less than the switch-on of later cooling."""
    route = ROUTE.after(2426.0)
    assert route.duration_s[0] == pytest.approx(4.0)
    with nullcontext() if is_native else without_core():
        plan = planned(load_vehicle('heat_pump_car'), start_c, 30.0, route, 0.7,
                       uncertainty=Uncertainty(0.02, direction=-1))
    powers_w = dict(plan.source_power_w)
    assert powers_w.pop('chiller').max() > 1000.0
    assert list(powers_w) == ['hvch', 'motor', 'heat_pump'] and not any(map(np.any, powers_w.values()))


def test_the_best_source_cools_first():
    mix, k = HeatMix(BOTH, ROUTE, np.full(len(ROUTE), 4000.0)), int(np.argmax(ROUTE.speed_mps))
    merit = mix.at(k, 45.0)
    efficiency = REFERENCE['hvch']['efficiency']
    ends_w = [-200.0 * 6.0 / efficiency, -(200.0 * 6.0 + 3000.0 * 2.6) / efficiency]
    assert list(merit.cold_ends_w) == pytest.approx(ends_w)
    assert list(merit.ends_w) == [4000.0]
    for heat_w, electric_w in ((ends_w[0] / 2.0, 100.0), (ends_w[1], 3200.0), (0.0, 0.0), (700.0, 700.0)):
        assert merit.electric_w(heat_w) == pytest.approx(electric_w)
        inverse = merit.cold_w if heat_w < 0.0 else merit.heat_w
        assert inverse(electric_w) == pytest.approx(heat_w)
    assert merit.capped_w(-1e6) == pytest.approx(ends_w[1])


def test_a_source_cools_only_when_it_may():
    stops = replace(ROUTE, speed_mps=np.where(np.arange(len(ROUTE)) % 4 == 0, 0.0, ROUTE.speed_mps))
    plan = planned(BOTH, route=stops, most_c=24.0)
    assert not plan.source_power_w['radiator'][stops.speed_mps == 0.0].any()
    assert plan.source_power_w['radiator'].any()
    start_c = plan.battery_temperature_c[:-1]
    allowed_w = np.interp(start_c, [20.0, 25.0], [0.0, 3000.0])
    assert (plan.source_power_w['chiller'] <= allowed_w + 1e-6).all()


def test_a_target_between_two_bounds_is_heated_or_cooled_for():
    cold, between, hot = (planned(temperature_c=start_c, target_c=30.0, most_c=34.0, route=summer(air_c=25.0))
                          for start_c in (-9.0, 16.0, 45.0))
    assert (cold.status, cold.arrival_temperature_c) == (Status.WAITING, pytest.approx(30.0, abs=1e-3))
    assert between.status is Status.NOT_NEEDED and 30.0 < between.arrival_temperature_c < 34.0
    assert (hot.status, hot.arrival_temperature_c) == (Status.WAITING_TO_COOL, pytest.approx(34.0, abs=1e-3))
    assert not any(map(np.any, between.source_power_w.values()))
    assert cold.cooling_start_s is None and not cold.source_power_w['chiller'].any()


def test_too_hot_is_said():
    short = ROUTE.segments(len(ROUTE) - 4, len(ROUTE))
    late = planned(route=short)
    assert late.status is Status.TARGET_UNREACHABLE and late.cooling_start_s == 0.0
    assert late.explanation.startswith('Cooling all the way is not enough: arrival in ')
    assert f'{late.shortfall_k:.1f} K above the 35.0 degC allowed.' in late.explanation
    without = planned(ALONE)
    assert without.status is Status.TARGET_UNREACHABLE
    assert without.explanation.startswith('The battery cannot be cooled: ')
    assert planned(route=short, most_c=np.inf).status is Status.NOT_NEEDED


def test_the_reserve_comes_first():
    wanted = planned(most_c=24.0)
    uncooled = planned(most_c=np.inf)
    reserve = 0.5 * (wanted.arrival_soc + uncooled.arrival_soc)
    goal = Goal(22.0, minimum_arrival_soc=reserve, maximum_arrival_temperature_c=24.0)
    plan = plan_preheating(VEHICLE, ROUTE, BatteryState(45.0, 0.9), goal)
    assert plan.arrival_soc == pytest.approx(reserve, abs=2e-4) and plan.arrival_soc >= reserve - 1e-6
    assert plan.status is Status.SOC_LIMITED and 'reserve, the battery is cooled less' in plan.explanation
    assert 24.0 < plan.arrival_temperature_c < uncooled.arrival_temperature_c - 5.0


def test_cooling_keeps_the_highest_temperature_on_the_way():
    lower = {'battery': {**REFERENCE['battery'], 'temperature_range_c': [-40, 48]}}
    car, route = vehicle_with({'chiller': CHILLER}, **lower), summer(air_c=40.0)
    plan, without = planned(car, 46.0, 40.0, route), planned(vehicle_with(
        {'chiller': {**CHILLER, 'maximum_power_w': 0}}, **lower), 46.0, 40.0, route)
    assert without.battery_temperature_c.max() > 50.0
    assert plan.battery_temperature_c.max() < 48.05
    assert plan.arrival_temperature_c == pytest.approx(40.0, abs=1e-2)


def test_colder_arrivals_cost_more():
    energies_wh = [planned(most_c=most_c).energy_wh.battery_total for most_c in (60.0, 45.0, 40.0, 35.0, 30.0)]
    assert all(warm_wh < cold_wh for warm_wh, cold_wh in pairwise(energies_wh))
