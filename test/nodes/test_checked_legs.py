# SPDX-License-Identifier: Apache-2.0
"""The checker on a route with stops: it checks the current leg."""

from dataclasses import replace

import pytest
from steady_drives import NOW_NS as START_NS
from steady_drives import steady_leg, VEHICLE
from stepwise import Stepwise

from bev_preheat.charging.stop import Charger
from bev_preheat.control.events import PreparationWanted
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import goal_of_leg, Measurement, Mission, with_stops
from bev_preheat.control.preparation_goal import PreparationGoal
from bev_preheat.control.settings import Settings
from bev_preheat.messages.preheat_plan import plan_message
from bev_preheat.nodes.optimality_report import as_driven, case_of_plan, case_of_state
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle.description import HeatPath

STATE = BatteryState(2.25, 0.8125)
# Two legs of 10 min, with 5 min between them.
GOALS = (Goal(21.0, 0.15), Goal(24.0, 0.25))


def leg(goal=GOALS[1], duration_s=600.0, **fields):
    return steady_leg(duration_s, propulsion_power_w=[15e3], ambient_temperature_c=[-4.0],
                      target_temperature_c=goal.target_temperature_c, minimum_arrival_soc=goal.minimum_arrival_soc,
                      **fields)


def started(*legs, vehicle=VEHICLE, settings=Settings()):
    """Return a supervisor with a trip, 5 min at each stop."""
    supervisor = Stepwise(vehicle, settings)
    supervisor.accept_mission(Mission('far', with_stops(legs, (300.0,) * (len(legs) - 1))))
    return supervisor


def two_legs(first=GOALS[0], **how):
    return started(leg(first), leg(departure=BatteryState(30.0, 0.7)), **how)


@pytest.fixture
def inputs():
    return two_legs()


def at(elapsed_s):
    return Measurement(STATE, START_NS + elapsed_s * NS_PER_S)


@pytest.mark.parametrize('elapsed_s, rest_s, goal', [
    (0, 600.0, GOALS[0]), (450, 150.0, GOALS[0]), (900, 600.0, GOALS[1]), (1100, 400.0, GOALS[1])])
def test_a_state_is_checked_in_its_leg(inputs, elapsed_s, rest_s, goal):
    case = case_of_state(inputs.state.mission, inputs.state.inbox, at(elapsed_s), None)
    assert (case.question.route.total_duration_s, case.question.goal) == (
        pytest.approx(rest_s), goal)


@pytest.mark.parametrize('elapsed_s', [600, 899, 1500])
def test_at_a_stop_and_after_the_end_nothing_is_checked(inputs, elapsed_s):
    assert case_of_state(inputs.state.mission, inputs.state.inbox, at(elapsed_s), None) is None


@pytest.mark.parametrize('elapsed_s, goal', [(450, GOALS[0]), (1100, GOALS[1])])
def test_a_plan_is_checked_in_its_leg(inputs, elapsed_s, goal):
    measurement = at(elapsed_s)
    inputs.accept_battery(measurement, measurement.stamp_ns)
    plan = plan_message(inputs.replan(measurement.stamp_ns), inputs.state.mission, measurement.stamp_ns,
                        inputs.later_decisions())
    case = case_of_plan(inputs.state.mission, inputs.state.inbox, [measurement], plan)
    assert (case.question.goal, case.start_ns) == (goal, measurement.stamp_ns)


def test_a_plan_for_a_goal_of_the_action_is_not_taken_for_the_routes(inputs):
    measurement = at(0)
    inputs.accept_battery(measurement, measurement.stamp_ns)
    # The same drive and the same target give the same plan.
    inputs.run(START_NS, PreparationWanted(PreparationGoal(START_NS + 600 * NS_PER_S, 21.0)))
    plan = plan_message(inputs.state.decision, inputs.state.active_mission, START_NS)
    assert plan.route_id == '~/prepare_battery'
    assert case_of_plan(inputs.state.mission, inputs.state.inbox, [measurement], plan) is None


def test_a_vehicle_that_is_late_is_checked_where_it_is(inputs):
    supervisor, planned, measurement = Stepwise(VEHICLE, Settings()), inputs.state.mission, at(90)
    supervisor.accept_mission(planned.delayed(60 * NS_PER_S))
    supervisor.accept_battery(measurement, measurement.stamp_ns)
    plan = plan_message(supervisor.replan(measurement.stamp_ns), supervisor.state.mission, 0)
    assert plan.delay == 60.0
    assert case_of_plan(planned, inputs.state.inbox, [measurement], plan) is None
    case = case_of_plan(as_driven(planned, plan), inputs.state.inbox, [measurement], plan)
    assert case.question.route.total_duration_s == pytest.approx(600.0 + 60.0 - 90.0)
    # A plan for another route does not apply to this one.
    plan.route_id = 'near'
    assert as_driven(planned, plan) is planned


@pytest.fixture
def heated():
    """Return (mission, inbox, measurement, plan) of a plan with heat under way at its start."""
    supervisor = two_legs(Goal(40.0, 0.15), vehicle=replace(VEHICLE, heat_path=HeatPath(60.0, 20e3, 400.0)))
    for elapsed_s in range(0, 120, 5):
        supervisor.accept_battery(at(elapsed_s), at(elapsed_s).stamp_ns)
    plan = plan_message(supervisor.replan(at(elapsed_s).stamp_ns), supervisor.state.mission, 0)
    return supervisor.state.mission, supervisor.state.inbox, at(elapsed_s), plan


def test_a_plan_is_checked_with_the_heat_under_way(heated):
    mission, inbox, measurement, plan = heated
    case = case_of_plan(mission, inbox, [measurement], plan)
    assert plan.heater_power[0] > 1000.0 and plan.coolant_excess_temperature[0] > 1.0
    assert (case.question.state.heater_power_w, case.question.state.coolant_excess_k) == (
        plan.heater_power[0], plan.coolant_excess_temperature[0])


@pytest.mark.parametrize('field', ['heater_power', 'coolant_excess_temperature'])
@pytest.mark.parametrize('values', [[], [0.0]])
def test_heat_under_way_of_another_length_is_no_plan_to_check(heated, field, values):
    mission, inbox, measurement, plan = heated
    setattr(plan, field, values)
    assert case_of_plan(mission, inbox, [measurement], plan) is None


@pytest.mark.parametrize('count, is_checked', [
    (0, False), (1, False), (4, False), (5, True), (6, True), (7, False)])
def test_a_model_with_another_number_of_factors_is_no_plan_to_check(heated, count, is_checked):
    mission, inbox, measurement, plan = heated
    plan.model_factors = [1.0] * count
    assert (case_of_plan(mission, inbox, [measurement], plan) is not None) is is_checked


@pytest.mark.parametrize('charger_w', [150e3, 50e3])
def test_the_target_that_the_planner_has_chosen_is_checked(charger_w):
    settings, measurement = Settings(estimation=False), at(0)
    supervisor = started(leg(Goal(None, 0.25), 1200.0, charger=Charger(charger_w)), settings=settings)
    supervisor.accept_battery(measurement, measurement.stamp_ns)
    mission = supervisor.state.mission
    plan = plan_message(supervisor.replan(measurement.stamp_ns), mission, measurement.stamp_ns)
    # Its own inbox knows nothing of prices or estimates.
    inbox = Inbox(VEHICLE, settings)
    assert goal_of_leg(mission.legs[0], VEHICLE, settings).target_temperature_c == 25.0
    for case in (case_of_plan(mission, inbox, [measurement], plan),
                 case_of_state(mission, inbox, measurement, plan)):
        assert case.question.goal.target_temperature_c == plan.target_battery_temperature < 21.0
