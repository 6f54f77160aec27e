# SPDX-License-Identifier: Apache-2.0
"""Planner calls for an estimate: corrected vehicle, uncertainty, and a heater that does not obey."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest
from steady_drives import steady_leg, VEHICLE

from bev_preheat.control.forecast_plan import ForecastPlanner, in_words, PlanningTask
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.settings import Settings
from bev_preheat.estimation.estimate import (
    Estimate,
    HEAT_CAPACITY,
    HEAT_LAG,
    PROPULSION,
    SENSOR_PLACE,
    SIZE,
    SOC,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.estimation.hypotheses import Heater, HeaterReport, SuspectedFault
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.tunables import MOST_REVEALED_K
from bev_preheat.vehicle import load_vehicle

GOAL = Goal(25.0)
ANSWERS = HeaterReport(Heater.ANSWERS, 1.0, 1.0)


ROUTE = steady_leg(step_s=60.0).route


def make_estimate(temperature_c=20.0, deviations=None, heater=ANSWERS, **mean):
    """Return an Estimate; `deviations` by element of the state, `mean` by its name in lower case."""
    elements = {'under_way': UNDER_WAY, 'heat_lag': HEAT_LAG, 'propulsion': PROPULSION, 'place': SENSOR_PLACE}
    means, covariance = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    means[TEMPERATURE], means[SOC] = temperature_c, 0.8
    for name, value in mean.items():
        means[elements[name]] = value
    for element, deviation in (deviations or {}).items():
        covariance[element, element] = deviation**2
    return Estimate(0, means, covariance, heater, 0.0)


@pytest.fixture
def asked(monkeypatch):
    questions = []

    def plan(vehicle, route, state, goal, method, uncertainty, **how):
        made = plan_preheating(vehicle, route, state, goal, method, uncertainty, **how)
        questions.append(SimpleNamespace(
            vehicle=vehicle, route=route, state=state, uncertainty=uncertainty, plan=made, **how))
        return made

    monkeypatch.setattr('bev_preheat.control.forecast_plan.plan_preheating', plan)
    return questions


def make_after(maker, estimate, goal=GOAL, settings=Settings(), vehicle=VEHICLE):
    """Return the planner after a Decision, and the Decision."""
    return maker.make(vehicle, PlanningTask(ROUTE, goal, Inbox(vehicle, settings).moment(0), 0.0), estimate)


def make(estimate, **task):
    return make_after(ForecastPlanner(), estimate, **task)[1]


# Uncertainty

def test_a_share_of_what_the_arrival_may_deviate_beyond_the_temperature_now_becomes_known(asked):
    maker, estimate = ForecastPlanner(), make_estimate(deviations={TEMPERATURE: 0.2, HEAT_CAPACITY: 0.05})
    maker, before = make_after(maker, estimate)
    # The arrival's uncertainty is unknown before the first plan, so two plans are made.
    assert [len(asked), asked[0].uncertainty] == [2, None]
    make_after(maker, estimate)
    assert len(asked) == 3
    revealed_k = math.sqrt(before.forecast.as_planned_k**2 - 0.2**2)
    assert asked[2].uncertainty.deviation_k == pytest.approx(revealed_k)


def test_an_uncertainty_that_is_not_a_number_counts_as_the_most(asked):
    make(make_estimate(deviations={HEAT_LAG: math.nan}))
    assert asked[-1].uncertainty.deviation_k == MOST_REVEALED_K


@pytest.mark.parametrize('lag_s, outside_s', [(40.0, 40.0), (160.0, 80.0)])
def test_heat_that_may_come_later_than_believed_is_part_of_it(asked, lag_s, outside_s):
    # A lag of 40 s may be 40 s times e^0.5. The heater warms the battery by 0.87 * 7000 W / 377376 J/K.
    maker, estimate = ForecastPlanner(), make_estimate(
        deviations={HEAT_LAG: 0.5}, heat_lag=math.log(lag_s / 40.0))
    maker, before = make_after(maker, estimate)
    make_after(maker, estimate)
    later_k = outside_s * (math.exp(0.5) - 1.0) * 0.87 * 7000.0 / 377376.0
    assert asked[-1].uncertainty.deviation_k == pytest.approx(
        math.hypot(before.forecast.as_planned_k, later_k))


def test_a_long_least_time_on_does_not_leave_the_battery_cold():
    # 3 K take some 4 min, less than the least time on, which lasts up to 1 K above the target.
    plan = make(make_estimate(22.0), settings=Settings(minimum_on_time_s=600.0)).plan
    assert plan.status is Status.WAITING
    assert plan.arrival_temperature_c == pytest.approx(25.0, abs=0.2)


# The state, and the corrected vehicle

@pytest.mark.parametrize('temperature_c, planned_from_c', [(10.0, 10.0), (61.0, 60.0), (-41.0, -40.0)])
@pytest.mark.parametrize('under_way_k', [0.0, 0.5])
def test_plans_start_with_the_heat_that_is_under_way(asked, temperature_c, planned_from_c, under_way_k):
    make(make_estimate(temperature_c, under_way=under_way_k))
    assert asked[-1].state.temperature_c == planned_from_c
    # As of a heater whose power decays with the lag.
    assert 0.87 * 40.0 * asked[-1].state.heater_power_w == pytest.approx(377376.0 * under_way_k)


@pytest.mark.parametrize('lag_s, place, outside_s', [
    (60.0, 0.0, 60.0), (160.0, 0.0, 80.0), (160.0, 1.0, 40.0), (160.0, 4.0, 16.0), (160.0, -0.5, 80.0)])
@pytest.mark.parametrize('under_way_k, heat_k', [(0.2, 0.2), (-0.2, 0.0)])
def test_plans_start_from_the_mean_with_the_heat_that_is_outside_the_battery(
        asked, lag_s, place, outside_s, under_way_k, heat_k):
    make(make_estimate(10.0, under_way=under_way_k, heat_lag=math.log(lag_s / 40.0), place=place))
    state, all_c = asked[-1].state, 10.0 + heat_k
    assert asked[-1].vehicle.heat_path.heat_lag_s == pytest.approx(outside_s)
    assert state.temperature_c == pytest.approx(all_c - heat_k * outside_s / lag_s)
    assert 0.87 * outside_s * state.heater_power_w == pytest.approx(377376.0 * (all_c - state.temperature_c))


@pytest.mark.parametrize('name, temperature_c, start_c, lag_s', [
    ('heat_pump_car', 10.0, 10.2, 80.0), ('heat_pump_car', -36.0, -35.0, 80.0),
    # A car that cools begins up to 20 K above its range.
    ('heat_pump_car', 76.0, 75.0, 80.0),
    ('shell_and_core', 10.0, 10.0, 0.0), ('shell_and_core', -36.0, -35.0, 0.0),
    ('shell_and_core', 56.0, 55.0, 0.0)])
def test_plans_of_heat_sources_start_with_all_heat_and_those_of_a_described_shell_from_the_core(
        asked, name, temperature_c, start_c, lag_s):
    vehicle = load_vehicle(name)
    estimate = make_estimate(temperature_c, under_way=0.2, heat_lag=math.log(4.0))
    make(replace(estimate, path=vehicle.heat_path), vehicle=vehicle)
    assert (asked[-1].state.temperature_c, asked[-1].heat_lag_s) == pytest.approx((start_c, lag_s))


def test_plans_follow_the_lag_of_a_described_shell_by_its_conductance(asked):
    vehicle, maker = load_vehicle('shell_and_core'), ForecastPlanner()
    for factor in (1.0, 2.0, 4.0):
        estimate = replace(make_estimate(heat_lag=math.log(factor)), path=vehicle.heat_path)
        maker, _ = make_after(maker, estimate, vehicle=vehicle)
        assert asked[-1].vehicle.heat_path.coolant_conductance_w_per_k == pytest.approx(400.0 / factor)


def test_plans_know_the_lag_and_the_consumption_of_this_car(asked):
    make(make_estimate(heat_lag=math.log(2.0), propulsion=math.log(1.25)))
    assert asked[-1].vehicle.heat_path.heat_lag_s == pytest.approx(80.0)
    assert asked[-1].route.propulsion_power_w == pytest.approx(np.full(20, 25e3))


@pytest.mark.parametrize('lag_s', [60.0, 100.0, 600.0])
def test_a_target_that_is_too_far_is_predicted_with_the_heat_that_arrives_in_time(lag_s):
    plan = make(make_estimate(-10.0, heat_lag=math.log(lag_s / 40.0))).plan
    promptly = make(make_estimate(-10.0, heat_lag=math.log(2.0 / 40.0))).plan
    assert plan.status is promptly.status is Status.TARGET_UNREACHABLE
    assert (plan.hvch_battery_power_w == promptly.hvch_battery_power_w).all()
    # At the end of a constant power P, P times the lag times 1 - e^(-t / lag) is still under way. Heat that is
    # late by more than 80 s is in the battery.
    outside_s = min(lag_s, 80.0)
    late_s = outside_s * -math.expm1(-1200.0 / outside_s) - 2.0
    late_k = 0.87 * (7000.0 - 1500.0) * late_s / 377376.0
    # A colder battery leaks less, and makes more Joule heat.
    assert 0.85 * late_k < promptly.arrival_temperature_c - plan.arrival_temperature_c < late_k


@pytest.mark.parametrize('share', [1.0, 0.5, 0.0])
def test_heat_sources_heat_until_arrival_at_a_target_that_is_too_far(asked, share):
    heater = ANSWERS if share == 1.0 else HeaterReport(Heater.DERATED if share else Heater.DEAD, 1.0, share)
    found = make(make_estimate(-10.0, heater=heater), goal=Goal(50.0), vehicle=load_vehicle('heat_pump_car'))
    assert found.plan.status is Status.TARGET_UNREACHABLE and found.command_share == share
    # Cabin heating leaves the HVCH 5 kW; the last minute counts, too.
    assert found.commanded.source_power_w['hvch'][-1] == pytest.approx(share * 5000.0)
    assert found.commanded.source_power_w['heat_pump'][-1] == 2500.0
    assert found.plan.arrival_temperature_c < found.commanded.arrival_temperature_c


def test_what_is_only_suspected_is_never_said_to_be_certain():
    plan = plan_preheating(VEHICLE, ROUTE, BatteryState(-7.0, 0.8), GOAL)
    suspected = SuspectedFault(Heater.DEAD, 0.9993, 0.0, 300.0, 2.0, None)
    assert in_words(plan, reserve=0.0, suspected=(('hvch', suspected),)).startswith('The heater may be dead (99 %')
