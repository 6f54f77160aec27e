# SPDX-License-Identifier: Apache-2.0
"""Plans of cars with gates of their own: lowest charge, highest temperature, not in motion, steps of power."""

from dataclasses import replace
import math

from drives import route_of
import numpy as np
import pytest

from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import gate_problems, HeatingGates, NO_GATES
from bev_preheat.vehicle.heater_controller import Refusal

VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults)
STATE, GOAL = BatteryState(-7.0, 0.9), Goal(25.0, 0.0, True)
METHODS = 'value_function', 'optimal_switch', 'paper'


def planned(gates, state=STATE, method='value_function', route=ROUTE):
    return plan_preheating(replace(VEHICLE, heating_gates=gates), route, state, GOAL, method)


def heated(plan):
    return plan.hvch_battery_power_w > 1e-3


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('minimum_soc', [0.7, 0.8, 0.85])
def test_heat_ends_before_the_charge_is_too_low(method, minimum_soc):
    plan = planned(HeatingGates(minimum_soc=minimum_soc), method=method)
    assert heated(plan).any()
    assert plan.soc[1:][heated(plan)].min() >= minimum_soc
    if plan.shortfall_k > 0.2:
        assert f'The vehicle does not heat below {100 * minimum_soc:g} % of charge.' in plan.explanation


@pytest.mark.parametrize('method', METHODS)
def test_heat_ends_below_the_hottest_battery(method):
    plan = planned(HeatingGates(maximum_temperature_c=15.0), method=method)
    assert heated(plan).any()
    assert plan.battery_temperature_c[1:][heated(plan)].max() < 15.0
    assert plan.status is Status.TARGET_UNREACHABLE
    assert 'The vehicle does not heat from 15 degC on.' in plan.explanation


@pytest.mark.parametrize('method', METHODS)
def test_a_parked_battery_is_heated_up_to_the_gate_just_before_it_leaves(method):
    # Heat of the first hour would have leaked: 10 degC of then are 5 degC.
    parked = route_of((150, 0.0), step_s=60.0, speed_mps=0.0, ambient_c=-10.0, cabin_w=0.0, auxiliary_w=200.0)
    plan = planned(HeatingGates(maximum_temperature_c=10.0), BatteryState(-9.0, 0.9), method=method, route=parked)
    assert 9.7 < plan.arrival_temperature_c < 10.0
    assert heated(plan).tolist() == sorted(heated(plan).tolist())
    assert 'The vehicle does not heat from 10 degC on.' in plan.explanation


@pytest.mark.parametrize('method', METHODS)
def test_car_that_is_never_allowed_is_planned_without_heat(method):
    plan = planned(HeatingGates(minimum_soc=0.95), method=method)
    assert not heated(plan).any()
    assert plan.status is Status.TARGET_UNREACHABLE
    assert plan.explanation.startswith('The battery cannot be heated: ')
    assert 'below 95 % of charge' in plan.explanation


@pytest.mark.parametrize('method', METHODS)
def test_heat_only_while_standing(method):
    standing = np.zeros(len(ROUTE), dtype=bool)
    standing[40:80] = True
    route = replace(ROUTE, speed_mps=np.where(standing, 0.0, np.maximum(ROUTE.speed_mps, 1.0)))
    plan = planned(HeatingGates(only_while_standing=True), method=method, route=route)
    assert heated(plan).any()
    assert not heated(plan)[~standing].any()
    assert 'only while it stands' in plan.explanation


@pytest.mark.parametrize('method', METHODS)
def test_powers_are_those_of_the_heater(method):
    steps_w = (1500.0, 4000.0, 7000.0)
    plan = planned(HeatingGates(power_steps_w=steps_w), method=method)
    # Cabin heating leaves 5022 W.
    powers_w = {round(plan.power_at_w(time_s), 3) for time_s in np.arange(0.0, plan.arrival_time_s, 7.0)}
    assert powers_w == {0.0, 4000.0}
    assert 'The heater has steps of power (1500, 4000, 7000 W).' in plan.explanation


def test_a_heater_that_is_on_or_off_gives_the_heat_of_a_descent_in_pulses():
    route, state = load_route('alpine_pass', VEHICLE.defaults), BatteryState(-10.0, 0.9)
    free, stepped = (planned(HeatingGates(power_steps_w=steps_w), state, route=route)
                     for steps_w in ((), (4000.0,)))
    # Surplus of the descent is a few hundred watts: the plan of any power has many powers below 4 kW.
    assert ((free.hvch_battery_power_w > 50.0) & (free.hvch_battery_power_w < 3900.0)).sum() > 10
    assert stepped.arrival_temperature_c > 24.8
    assert stepped.energy_wh.hvch_electric == pytest.approx(free.energy_wh.hvch_electric, rel=0.1)
    between = (stepped.hvch_battery_power_w > 1e-3) & (np.abs(stepped.hvch_battery_power_w - 4000.0) > 1.0)
    # The first and the last one, for a part of their time.
    assert between.sum() <= 2


@pytest.mark.parametrize('share', [0.9, 0.5, 0.3, 0.0])
def test_of_the_steps_of_a_derated_heater_its_share_arrives(share):
    """A step of 4000 W is commanded; a share of 30 % gives less than the lowest step, and heats all the same."""
    car = replace(VEHICLE, heating_gates=HeatingGates(power_steps_w=(1500.0, 4000.0, 7000.0)))
    plan = plan_preheating(car, ROUTE, STATE, Goal(50.0), heater_share=share)
    assert plan.status is Status.TARGET_UNREACHABLE
    powers_w = {round(plan.power_at_w(time_s), 3) for time_s in np.arange(0.0, plan.arrival_time_s, 7.0)}
    assert powers_w == {round(share * 4000.0, 3)}


@pytest.mark.parametrize('gates, at, refusal', [
    (HeatingGates(minimum_soc=0.2), (0.199, 0.0, 0.0), Refusal.LOW_CHARGE),
    (HeatingGates(minimum_soc=0.2), (math.nan, 0.0, 0.0), Refusal.LOW_CHARGE),
    (HeatingGates(minimum_soc=0.2), (0.2, math.nan, math.nan), Refusal.NOT_REFUSED),
    (HeatingGates(maximum_temperature_c=30.0), (0.5, 30.0, 0.0), Refusal.HOT_BATTERY),
    (HeatingGates(maximum_temperature_c=30.0), (0.5, math.nan, 0.0), Refusal.HOT_BATTERY),
    (HeatingGates(only_while_standing=True), (0.5, 0.0, 0.31), Refusal.IN_MOTION),
    (HeatingGates(only_while_standing=True), (0.5, 0.0, -5.0), Refusal.IN_MOTION),
    (HeatingGates(only_while_standing=True), (0.5, 0.0, math.nan), Refusal.IN_MOTION),
    (HeatingGates(only_while_standing=True), (0.5, 0.0, 0.0), Refusal.NOT_REFUSED),
    (NO_GATES, (0.0, 99.0, 50.0), Refusal.NOT_REFUSED),
])
def test_verdict_of_a_gate(gates, at, refusal):
    assert gates.verdict(*at).refusal is refusal


@pytest.mark.parametrize('gates, words', [
    (HeatingGates(power_steps_w=(3000.0, 2000.0)), 'must rise from step to step'),
    (HeatingGates(power_steps_w=(3000.0, 8000.0)), '8000 W is above hvch.maximum_power_w, 7000 W'),
    (HeatingGates(maximum_temperature_c=-45.0), 'the vehicle would never heat'),
])
def test_implausible_gates(gates, words):
    (problem,) = gate_problems(gates, 7000.0, -40.0)
    assert words in problem
