# SPDX-License-Identifier: Apache-2.0
"""The charger in messages: refusals and their wording, the parsed charger, the texts of plans."""

from math import inf, nan

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from stepwise import Stepwise

from bev_preheat.charging.stop import Charger
from bev_preheat.control.decision import Decision
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import Measurement
from bev_preheat.control.settings import FIELD_OF_PARAMETER, Settings
from bev_preheat.errors import figure, InvalidInput
from bev_preheat.messages.planner_diagnostics import planner_diagnostics
from bev_preheat.messages.preheat_plan import charging_text, plan_message, session_texts
from bev_preheat.messages.route_plan import (
    mission_from_message,
    route_plan_message,
)
from bev_preheat.nodes.optimality_report import case_of_plan, case_of_state
from bev_preheat.nodes.planner_parameters import PARAMETERS
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

VEHICLE = load_vehicle('reference')
START_S = 1_700_000_000
STATE = BatteryState(6.0, 0.4375)
POWER = '1000 ... 2000000 W, or 0 or NaN: not known'
DEPARTURE = '0 ... 1, or 0 or NaN: not known, 0.8'


def route_message(**changed):
    """Return a RoutePlan of 30 min with a stop halfway."""
    message = RoutePlan(**{
        'route_id': 'far', 'segment_duration': [60.0] * 30, 'speed': [25.0],
        'propulsion_power': [15e3], 'ambient_temperature': [-8.0], 'charging_planned': True,
        'charger_power': 150e3, 'charging_departure_soc': 0.75,
        'stop_after_segment': [14], 'stop_duration': [900.0], 'stop_charger_power': [50e3],
        'departure_soc': [0.6], **changed})
    message.header.stamp = Time(sec=START_S)
    return message


def convert(**changed):
    return mission_from_message(route_message(**changed), VEHICLE.defaults, 30.0)


def chargers(**changed):
    return [leg.charger for leg in convert(**changed).legs]


@pytest.mark.parametrize('field, value, allowed', [
    *(('charger_power', value, POWER) for value in (999.0, 2.1e6, -150e3, inf, -inf)),
    *(('charging_departure_soc', value, DEPARTURE) for value in (1.25, -0.25, 80.0, inf))])
def test_a_bad_charger_is_refused(field, value, allowed):
    with pytest.raises(InvalidInput) as refusal:
        convert(**{field: value})
    assert refusal.value.problems == [f'{field}: {figure(value)} is not allowed; it must be {allowed}']


@pytest.mark.parametrize('value', [50.0, 2.1e6, -50e3, inf])
def test_a_bad_charger_at_a_stop_is_refused(value):
    with pytest.raises(InvalidInput) as refusal:
        convert(stop_charger_power=[value])
    assert refusal.value.problems == [
        f'stop_charger_power[0]: {figure(value)} is not allowed; it must be {POWER}']


def test_chargers_of_another_number_than_stops_are_refused():
    with pytest.raises(InvalidInput) as refusal:
        convert(stop_charger_power=[50e3, 50e3])
    assert refusal.value.problems == [
        'stop_charger_power: has 2 values; it must have 1, as stop_after_segment has, or none']


@pytest.mark.parametrize('changed, expected', [
    ({}, [Charger(50e3, 0.6), Charger(150e3, 0.75)]),
    ({'stop_charger_power': [], 'departure_soc': []}, [None, Charger(150e3, 0.75)]),
    ({'stop_charger_power': [0.0], 'charging_departure_soc': 0.0}, [None, Charger(150e3)]),
    ({'stop_charger_power': [nan], 'charging_departure_soc': nan}, [None, Charger(150e3)]),
    ({'departure_soc': [nan], 'charger_power': nan}, [Charger(50e3), None]),
    ({'departure_soc': [0.0], 'charger_power': 0.0}, [Charger(50e3), None])])
def test_a_charger_is_known_by_its_power(changed, expected):
    assert chargers(**changed) == expected


def test_a_stop_without_its_departure_leaves_with_the_usual_charge():
    assert convert(departure_soc=[]).legs[1].departure.soc == 0.8


def test_chargers_there_and_back():
    mission = convert()
    message = route_plan_message(mission)
    assert (message.charger_power, message.charging_departure_soc) == (150e3, 0.75)
    again = mission_from_message(message, VEHICLE.defaults, 30.0)
    assert [leg.charger for leg in again.legs] == [leg.charger for leg in mission.legs]


# Texts of plans

def planned(settings=Settings(estimation=False), **changed):
    """Return (Stepwise, PreheatPlan) at the start of a route without a stop."""
    supervisor = Stepwise(VEHICLE, settings)
    now_ns = START_S * NS_PER_S
    supervisor.run(now_ns)
    supervisor.accept_mission(convert(**{
        'stop_after_segment': [], 'stop_duration': [], 'stop_charger_power': [], 'departure_soc': [],
        **changed}))
    supervisor.accept_battery(Measurement(STATE, now_ns), now_ns)
    return supervisor, plan_message(supervisor.state.decision, supervisor.state.mission, now_ns)


@pytest.mark.parametrize('changed, source', [
    ({}, PreheatPlan.TARGET_CHOSEN), ({'target_battery_temperature': 21.0}, PreheatPlan.TARGET_GIVEN),
    ({'charger_power': 0.0}, PreheatPlan.TARGET_DEFAULT),
    ({'charging_planned': False}, PreheatPlan.TARGET_UNKNOWN)])
def test_a_plan_says_where_its_target_comes_from(changed, source):
    supervisor, plan = planned(**changed)
    assert plan.target_source == source
    choice = supervisor.state.decision.target
    figures = (plan.charging_time, plan.charging_time_unheated, plan.bought_energy,
               plan.bought_energy_unheated)
    if source in (PreheatPlan.TARGET_CHOSEN, PreheatPlan.TARGET_GIVEN):
        assert figures == (choice.charging_time_s, choice.unheated_charging_time_s,
                           choice.bought_energy_wh, choice.unheated_bought_energy_wh)
        assert 0.0 < plan.charging_time < plan.charging_time_unheated
        minutes = round(plan.charging_time / 60.0)
        assert f'{minutes - 1}:' in charging_text(plan) or f'{minutes}:' in charging_text(plan)
    else:
        assert np.isnan(figures).all() and charging_text(plan) == ''
    assert bool(plan.target_reason) is (source != PreheatPlan.TARGET_UNKNOWN)


def test_a_message_that_nobody_filled_has_no_session():
    assert session_texts(PreheatPlan()) is None
    endless = PreheatPlan(target_source=PreheatPlan.TARGET_CHOSEN, charging_time=60.0, bought_energy=500.0,
                          charging_time_unheated=inf, bought_energy_unheated=inf)
    assert session_texts(endless) == ('1:00 min, 0.50 kWh', 'never ends')
    endless.bought_energy = nan
    assert session_texts(endless) is None


def test_heating_that_does_not_pay_is_no_fault():
    supervisor, plan = planned(charger_power=50e3)
    assert plan.status == PreheatPlan.NOT_WORTH_IT and not plan.heating_planned
    entry = planner_diagnostics('/planner', supervisor.state, START_S * NS_PER_S)[0]
    assert entry.level == DiagnosticStatus.OK and entry.message.startswith('NOT_WORTH_IT: Not worth it')
    values = {pair.key: pair.value for pair in entry.values}
    assert values['target because'] == plan.target_reason


def test_a_decision_without_a_target_has_no_figures():
    plan = plan_message(Decision(Status.DISABLED, 'No.'), None, 0)
    assert plan.target_source == PreheatPlan.TARGET_UNKNOWN and plan.target_reason == ''


# The checker

@pytest.mark.parametrize('charger_w', [150e3, 50e3])
def test_the_checker_takes_the_target_that_was_chosen(charger_w):
    supervisor, plan = planned(charger_power=charger_w)
    measurement = supervisor.state.measurement
    # Its own inbox knows nothing of prices or estimates.
    inbox = Inbox(VEHICLE, Settings(estimation=False))
    goal_of, mission = inbox.goal_of, supervisor.state.mission
    assert goal_of(mission.legs[0]).target_temperature_c == 25.0
    for case in (case_of_plan(mission, goal_of, [measurement], plan),
                 case_of_state(mission, goal_of, measurement, plan)):
        assert case.question.goal.target_temperature_c == plan.target_battery_temperature < 21.0


# Parameters

def test_prices_are_parameters():
    prices = {parameter.name: parameter for parameter in PARAMETERS
              if parameter.name in ('energy_price', 'value_of_time')}
    assert {name: getattr(Settings(), FIELD_OF_PARAMETER[name]) for name in prices} == {
        name: parameter.default for name, parameter in prices.items()}
    assert prices['energy_price'].problem_with(-0.1) == (
        'energy_price: -0.1 per kWh is not allowed; it must be 0 ... 1000 per kWh')
    assert prices['value_of_time'].problem_with(nan) == (
        'value_of_time: nan per h is not allowed; it must be 0 ... 1000000 per h')
    assert not any(parameter.read_only for parameter in prices.values())
