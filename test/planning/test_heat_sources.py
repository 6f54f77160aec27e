# SPDX-License-Identifier: Apache-2.0
"""Plans of cars with several heat sources, in a plant and a mix of their own."""

from dataclasses import replace
from itertools import product

import numpy as np
from own_sources import ALONE, as_curve, driven, heat_of, REFERENCE, vehicle_with
import pytest
from refusals import problems_of

from bev_preheat.code_generation.ecu_export import vehicle_source
from bev_preheat.errors import InvalidInput
from bev_preheat.nonlinear_program.solve import solve_optimum
from bev_preheat.planning.heat_mix import HeatMix
from bev_preheat.planning.methods import KeptValues
from bev_preheat.planning.plan import energy_gap_wh
from bev_preheat.planning.planner import as_driven, plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle.core_library import without_core
from bev_preheat.vehicle.description import STANDING_MPS

MOTOR = {'maximum_power_w': 2300, 'heat_per_watt': 0.7, 'only_while': 'driving'}
PUMP = {
    'maximum_power_w': {'temperature_c': [-12, -8], 'values': [0, 2600]},
    'heat_per_watt': {'ambient_c': [-25, -5, 10], 'temperature_c': [-20, 5, 30],
                      'values': [[1.4, 1.2, 1.0], [2.3, 1.9, 1.5], [3.3, 2.8, 2.2]]}}
SOURCES = {'motor': MOTOR, 'heat_pump': PUMP}
GOAL = Goal(25.0)
NO_NAME = 'is no name for a source beside hvch; lower-case letters, digits and _ are allowed'


VEHICLE = vehicle_with(SOURCES)
STEPPED = vehicle_with({'motor': {**MOTOR, 'power_steps_w': [2300]}, 'heat_pump': {
    **PUMP, 'power_steps_w': [900, 1800, 2400], 'minimum_on_time_s': 300, 'minimum_off_time_s': 180}})
ROUTE = load_route('reference', VEHICLE.defaults)


def planned(vehicle=VEHICLE, temperature_c=-14.0, route=ROUTE, goal=GOAL, soc=0.9, **how):
    return plan_preheating(vehicle, route, BatteryState(temperature_c, soc), goal, **how)


@pytest.mark.parametrize(('sources', 'changes', 'problem'), [
    ({'hvch': MOTOR}, {}, f"heat_sources: 'hvch' {NO_NAME}"),
    ({'Heat pump': PUMP}, {}, f"heat_sources: 'Heat pump' {NO_NAME}"),
    ({True: PUMP}, {}, f"heat_sources: 'True' {NO_NAME}"),
    ({}, {}, 'heat_sources: has 0 values; it must have at least 1'),
    (dict.fromkeys('abcde', PUMP), {}, 'heat_sources: has 5 values; it must have at most 4'),
    ({'motor': {**MOTOR, 'heat_per_watt': 0}}, {},
     'heat_sources.motor.heat_per_watt: 0 is not allowed; it must be 0.05 ... 10'),
    ({'pump': {**PUMP, 'maximum_power_w': {'temperature_c': [0, 10], 'values': [0, 60000]}}}, {},
     'heat_sources.pump.maximum_power_w: 60000 is not allowed; it must be 0 ... 50000 W'),
    ({'pump': {**PUMP, 'heat_per_watt': {'ambient_c': [5, -5], 'values': [2, 1]}}}, {},
     'heat_sources.pump.heat_per_watt.ambient_c: [5.0, -5.0] must rise from point to point'),
    ({'pump': {**PUMP, 'heat_per_watt': {'ambient_c': [-5, 5], 'temperature_c': [0, 9], 'values': [2, 1]}}}, {},
     'heat_sources.pump.heat_per_watt.values: must have 2 x 2 values, one for each point of its axes'),
    # No value of a table with the wrong shape is blamed.
    ({'pump': {**PUMP, 'heat_per_watt': {
        'ambient_c': [-5, 5], 'temperature_c': [0, 9, 20], 'values': [[2, 3], [2, 3], [1, 2]]}}}, {},
     'heat_sources.pump.heat_per_watt.values: must have 2 x 3 values, one for each point of its axes'),
    # In kilowatts; a chiller that rests at its first point.
    ({'pump': {**PUMP, 'maximum_power_w': 2.6}}, {}, 'heat_sources.pump.maximum_power_w: 2.6 W at most is not '
     'allowed; it must be at least 10 W; check the unit'),
    ({'chiller': {'maximum_power_w': 3000, 'heat_per_watt': {'temperature_c': [10, 30], 'values': [0, -2]}}}, {},
     'heat_sources.chiller.heat_per_watt: 0 is not allowed; it must be -10 ... -0.05'),
    (SOURCES, {'heat_path': {'heater_lag_s': 30}}, 'heat_path.heater_lag_s: 30 s is not allowed beside '
     'heat_sources, whose lag is not described; it must be 0'),
    ({'pump': {**PUMP, 'power_steps_w': [2000, 1000]}}, {},
     'heat_sources.pump.power_steps_w: [2000.0, 1000.0] must rise from step to step'),
    ({'pump': {**PUMP, 'power_steps_w': [1000, 2700]}}, {},
     'heat_sources.pump.power_steps_w: 2700 W is above heat_sources.pump.maximum_power_w, 2600 W'),
    ({'pump': {**PUMP, 'power_steps_w': [1, 2000]}}, {},
     'heat_sources.pump.power_steps_w[0]: 1 is not allowed; it must be at least 50 and at most 50000'),
    ({'pump': {**PUMP, 'minimum_on_time_s': 3601}}, {},
     'heat_sources.pump.minimum_on_time_s: 3601 is not allowed; it must be at least 0 and at most 3600')])
def test_refused_in_words(sources, changes, problem):
    assert problems_of(vehicle_with, sources, **changes) == [f'the file: {problem}']


def test_the_mix_takes_the_least_power_of_all_mixes():
    random = np.random.default_rng(5)
    mix = HeatMix(VEHICLE, ROUTE, np.full(len(ROUTE), 4000.0))
    sources = [(lambda *at: 4000.0, lambda *at: 1.0)] + [
        (as_curve(source['maximum_power_w']), as_curve(source['heat_per_watt'])) for source in SOURCES.values()]
    for k in random.integers(0, len(ROUTE), 12).tolist():
        at = float(ROUTE.ambient_temperature_c[k]), float(random.uniform(-20.0, 30.0))
        merit = mix.at(k, at[1])
        limits_w, watts = np.array([[most(*at), heat(*at) / REFERENCE['hvch']['efficiency']]
                                    for most, heat in sources]).T
        watts[0] = 1.0
        most_w = float(limits_w @ watts)
        assert merit.capped_w(1e6) == pytest.approx(most_w)
        wanted_w = float(random.uniform(0.0, most_w))
        # Of all vertices of the linear program: all sources but one at an end.
        least_w = min(
            float(np.delete(limits_w, free) @ np.delete(np.array(full, dtype=float), free)) + rest_w
            for free in range(3) for full in product((0, 1), repeat=3)
            if 0.0 <= (rest_w := (wanted_w - sum(limits_w[i] * watts[i] * full[i] for i in range(3) if i != free)
                                  ) / watts[free]) <= limits_w[free] + 1e-9)
        assert merit.electric_w(wanted_w) == pytest.approx(least_w)
        assert merit.heat_w(merit.electric_w(wanted_w)) == pytest.approx(wanted_w)
        split_w = mix.split_w(np.full(len(ROUTE), wanted_w), np.full(len(ROUTE), at[1]))
        assert [power_w[k] for power_w in split_w.values()] @ watts == pytest.approx(wanted_w)


def test_a_source_with_steps_has_the_power_of_the_step_below_its_limit():
    # The cabin takes 500 W of the pump's 2600 W beyond -8 degC, and 500 W of the HVCH's 5000 W.
    pump, route = {**PUMP, 'shares_cabin_limit': True}, replace(
        ROUTE, cabin_heating_power_w=np.full(len(ROUTE), 500.0))
    hvch = {**REFERENCE['hvch'], 'maximum_power_w': 5000}
    stepped = planned(vehicle_with({'pump': {**pump, 'power_steps_w': [1000, 2000, 2500]}}, hvch=hvch,
                                   heating_gates={'power_steps_w': [1500, 4000]}), -7.0, route, Goal(40.0))
    limited = planned(vehicle_with({'pump': {**pump, 'maximum_power_w': 2500}},
                                   hvch={**hvch, 'maximum_power_w': 4500}), -7.0, route, Goal(40.0))
    assert stepped.source_power_w['pump'].max() == pytest.approx(2000.0)
    assert stepped.source_power_w['hvch'].max() == pytest.approx(4000.0)
    for name in 'pump', 'hvch':
        assert stepped.source_power_w[name] == pytest.approx(limited.source_power_w[name], abs=1.0)
    assert stepped.arrival_temperature_c == pytest.approx(limited.arrival_temperature_c, abs=1e-3)
    # Where the limit rises with the battery's temperature, step by step: 650 W for each kelvin from -12 degC on.
    mix = HeatMix(vehicle_with({'pump': {**PUMP, 'power_steps_w': [1000, 2000]}}), ROUTE, np.zeros(len(ROUTE)))
    assert [mix.by_merit(at_c)['pump'][1] for at_c in (-10.5, -10.46, -8.93, -8.92, 20.0)] == [
        0.0, 1000.0, 1000.0, 2000.0, 2000.0]


@pytest.mark.parametrize('temperature_c', [-20.0, -11.0, 2.0])
def test_the_battery_arrives_as_planned_in_another_plant(temperature_c):
    plan = planned(temperature_c=temperature_c)
    assert plan.status is Status.WAITING
    run = driven(plan, ROUTE, SOURCES, 0.9)
    assert run.temperature_c == pytest.approx(25.0, abs=0.03)
    assert run.soc == pytest.approx(plan.arrival_soc, abs=2e-4)


def test_of_a_car_with_a_shell_the_heat_is_that_of_the_sources():
    vehicle = vehicle_with(SOURCES, thermal={'shell_share': 0.2, 'conductance_w_per_k': 300, 'sensor': 'shell'})
    plans = [planned(vehicle, -11.0), solve_optimum(vehicle, ROUTE, BatteryState(-11.0, 0.9), GOAL).plan]
    for plan in plans:
        heat_wh = heat_of(plan, ROUTE, SOURCES) @ ROUTE.duration_s / 3600.0
        assert heat_wh > 1.2 * plan.energy_wh.hvch_electric
        assert plan.energy_wh.hvch_heat == pytest.approx(heat_wh, rel=1e-4)


def test_two_sources_like_the_hvch_are_one_larger_hvch():
    hvch = REFERENCE['hvch']
    second = {'maximum_power_w': hvch['maximum_power_w'] - 3000.0, 'heat_per_watt': hvch['efficiency']}
    one, two = planned(ALONE), planned(vehicle_with({'second': second}, hvch={**hvch, 'maximum_power_w': 3000.0}))
    # One switches on within a step, the other heats whole steps.
    assert energy_gap_wh(two, one) == pytest.approx(0.0, abs=0.3)
    assert two.arrival_temperature_c == pytest.approx(one.arrival_temperature_c, abs=1e-3)


# Where a source's step depends on the battery's temperature, the program finds the best plan nearby only.
@pytest.mark.parametrize(('temperature_c', 'vehicle'), [
    (-25.0, VEHICLE), (-14.0, VEHICLE), (5.0, VEHICLE), (-8.5, STEPPED), (5.0, STEPPED)])
def test_close_to_the_program_and_cheaper_than_the_hvch(temperature_c, vehicle):
    plan = planned(vehicle, temperature_c)
    optimum = solve_optimum(vehicle, ROUTE, BatteryState(temperature_c, 0.9), GOAL)
    assert optimum.solver_status == 'Solve_Succeeded'
    assert -1.5 < energy_gap_wh(plan, optimum.plan) < 0.5
    assert plan.energy_wh.battery_total < planned(ALONE, temperature_c).energy_wh.battery_total - 100.0


def test_sources_are_named_in_the_order_of_their_use():
    cold = planned(temperature_c=-25.0, soc=0.95)
    assert ' Sources: hvch' in cold.explanation and 'degC, then heat_pump' in cold.explanation
    assert planned(temperature_c=5.0).explanation.endswith(' Sources: heat_pump.')
    assert 'Sources' not in planned(temperature_c=30.0).explanation
    assert list(cold.as_dictionary()['heat_source_power_w']) == ['hvch', 'motor', 'heat_pump']
    assert cold.as_dictionary()['hvch_battery_power_w'] == cold.as_dictionary()['heat_source_power_w']['hvch']


@pytest.mark.parametrize('vehicle', [ALONE, VEHICLE], ids=['hvch', 'sources'])
def test_in_the_last_second_of_a_drive_heat_is_too_late_and_not_impossible(vehicle):
    plan = planned(vehicle, 24.75, ROUTE.before(1.0), uncertainty=Uncertainty(1.0, 0))
    assert plan.explanation.startswith('Further heat would arrive too late: ')


def test_a_source_heats_only_when_it_may():
    stops = ROUTE.with_propulsion(np.where(np.arange(len(ROUTE)) % 4 == 0, 0.0, 1.0))
    stops = replace(stops, speed_mps=np.where(stops.propulsion_power_w == 0.0, 0.0, stops.speed_mps))
    stands = stops.speed_mps == 0.0

    def motor_w(**entries):
        plan = planned(vehicle_with({'motor': {**MOTOR, **entries}}), -25.0, stops, Goal(55.0))
        return plan.source_power_w['motor']

    driving_w, standing_w = motor_w(), motor_w(only_while='standing')
    assert driving_w[~stands].max() == pytest.approx(2300.0) and not driving_w[stands].any()
    assert standing_w[stands].max() == pytest.approx(2300.0) and not standing_w[~stands].any()
    left_w = 2300.0 - ROUTE.cabin_heating_power_w.max()
    assert motor_w(shares_cabin_limit=True).max() == pytest.approx(left_w)
    # A car that heats only while it stands opens none of its sources on the way.
    car = vehicle_with({'motor': {'maximum_power_w': 2300, 'heat_per_watt': 0.7}})
    gated = replace(car, heating_gates=replace(car.heating_gates, only_while_standing=True))
    gated_w = planned(gated, -25.0, stops, Goal(55.0)).source_power_w['motor']
    assert gated_w[stands].max() == pytest.approx(2300.0) and not gated_w[~stands].any()


@pytest.mark.costly
@pytest.mark.parametrize(('entries', 'gated', 'moving_w', 'standing_w'), [
    ({}, False, 2300.0, 0.0), ({'only_while': 'standing'}, False, 0.0, 2300.0),
    ({'only_while': ''}, False, 2300.0, 2300.0), ({'shares_cabin_limit': True}, False, 300.0, 0.0),
    ({}, True, 0.0, 0.0), ({'only_while': 'standing'}, True, 0.0, 2300.0),
    ({'only_while': ''}, True, 0.0, 2300.0)])
def test_the_program_heats_with_a_source_only_when_it_may(entries, gated, moving_w, standing_w):
    # It stands in each fourth step, else it just moves; once the cabin takes more than the source has.
    stands, route = np.arange(16) % 4 == 0, ROUTE.segments(0, 16)
    route = replace(
        route.with_propulsion(np.where(stands, 0.0, 1.0)), speed_mps=np.where(stands, 0.0, STANDING_MPS),
        cabin_heating_power_w=np.where(np.arange(16) == 6, 2500.0, 2000.0))
    motor = {name: value for name, value in {**MOTOR, **entries}.items() if value}
    vehicle = vehicle_with({'motor': motor}, heating_gates={'only_while_standing': gated})
    plan = planned(vehicle, -25.0, route, Goal(55.0))
    # The program reaches the plan's arrival temperature, and none higher.
    beyond, optimum = (solve_optimum(vehicle, route, BatteryState(-25.0, 0.9), Goal(
        plan.arrival_temperature_c + off_k)) for off_k in (0.05, -0.05))
    assert beyond.solver_status != 'Solve_Succeeded' == optimum.solver_status
    for heats_w in plan.source_power_w['motor'], optimum.plan.source_power_w['motor']:
        assert heats_w[~stands].max() == pytest.approx(moving_w, abs=1.0)
        assert heats_w[stands].max() == pytest.approx(standing_w, abs=1.0)


def test_limits_hold_with_all_sources():
    route, state = load_route('alpine_pass', VEHICLE.defaults), BatteryState(-18.0, 0.97)
    plan = planned(temperature_c=-18.0, route=route, soc=0.97)
    assert plan.undeliverable_power_w == 0.0 and plan.friction_brake_power_w.any()
    run = driven(plan, route, SOURCES, 0.97, plan.friction_brake_power_w)
    assert run.beyond_w.max() < 100.0
    assert run.temperature_c == pytest.approx(plan.arrival_temperature_c, abs=0.05)
    again = as_driven(plan, VEHICLE, route, state, GOAL)
    assert again.energy_wh.battery_total == pytest.approx(plan.energy_wh.battery_total, abs=0.1)


@pytest.mark.parametrize(('route', 'temperature_c', 'soc', 'vehicle'), [
    ('winter_commute', -16.0, 0.8, VEHICLE), ('alpine_pass', -11.0, 0.97, VEHICLE),
    ('reference', -15.0, 0.3, VEHICLE),
    ('reference', -11.0, 0.8, STEPPED), ('winter_commute', -11.5, 0.8, STEPPED)])
def test_the_core_plans_as_python_does(route, temperature_c, soc, vehicle):
    situation = {'vehicle': vehicle, 'route': load_route(route, VEHICLE.defaults), 'temperature_c': temperature_c,
                 'soc': soc}
    native = planned(**situation)
    with without_core():
        python = planned(**situation)
    assert native.status is python.status
    assert native.energy_wh.battery_total == pytest.approx(python.energy_wh.battery_total, abs=0.05)
    assert native.arrival_temperature_c == pytest.approx(python.arrival_temperature_c, abs=0.005)


def test_values_are_followed_with_several_sources():
    kept, uncertainty = KeptValues(), Uncertainty(1.5)
    first = planned(uncertainty=uncertainty, kept=kept)
    rest = ROUTE.segments(1, len(ROUTE))
    state = BatteryState(float(first.battery_temperature_c[1]), float(first.soc[1]))
    left_k = 1.5 * rest.total_duration_s / ROUTE.total_duration_s
    before = kept.latest
    followed = plan_preheating(VEHICLE, rest, state, GOAL, uncertainty=Uncertainty(left_k), kept=kept)
    assert kept.latest == before
    again = plan_preheating(VEHICLE, rest, state, GOAL, uncertainty=Uncertainty(left_k))
    assert followed.energy_wh.battery_total == pytest.approx(again.energy_wh.battery_total, abs=5.0)


@pytest.mark.parametrize('method', ['optimal_switch', 'paper'])
def test_other_methods_heat_with_the_hvch_alone(method):
    assert planned(method=method).energy_wh == planned(ALONE, method=method).energy_wh
    assert planned(method=method).source_power_w == {}


def test_what_does_not_know_the_sources_uses_the_hvch_alone():
    trip = make_trip(VEHICLE, ROUTE)
    assert (trip.heater_limit_w > trip.hvch_limit_w).all()
    assert trip.hvch_limit_w == pytest.approx(make_trip(ALONE, ROUTE).heater_limit_w)
    with pytest.raises(InvalidInput, match='heat_sources are not exported; the export needs a file'):
        vehicle_source(VEHICLE)
