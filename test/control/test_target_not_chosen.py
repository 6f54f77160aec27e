# SPDX-License-Identifier: Apache-2.0
"""A known charger without a chosen target: the target is given, no search is possible, or heating does not pay."""

from dataclasses import replace
import math

from charger_trips import (
    a_mission,
    a_supervisor,
    cost,
    drive,
    FAST,
    feed,
    MEASURED,
    PRICES,
    search_input,
    SLOW,
    START_NS,
    STATE,
    VEHICLE,
)
import numpy as np
import pytest
from stepwise import Stepwise

from bev_preheat.charging.stop import Charger
from bev_preheat.charging.target_worth import TargetWorth
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.target import TargetSource
from bev_preheat.control.target_choice import TargetChooser
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.tunables import LEAST_GAIN_SHARE
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath


@pytest.mark.parametrize('leg, settings', [
    ({'target_temperature_c': 21.0}, MEASURED), ({}, replace(MEASURED, target_battery_temperature_c=21.0))],
    ids=['by the route', 'by the parameter'])
def test_a_given_target_is_kept(leg, settings):
    supervisor = a_supervisor(settings=settings, **leg)
    for second in range(3):
        decision = feed(supervisor, second)
        assert decision.plan.target_temperature_c == 21.0
    choice = decision.target
    assert choice.source is TargetSource.GIVEN and ('route plan' in choice.reason) is bool(leg)
    assert choice.charging_time_s * 12.0 / 3600.0 + choice.bought_energy_wh * 0.55e-3 == pytest.approx(
        cost(VEHICLE, drive(), STATE, 21.0, FAST), rel=1e-9)


@pytest.mark.parametrize('settings', [MEASURED, Settings()], ids=['measured', 'estimated'])
@pytest.mark.parametrize('vehicle, charger, why', [
    (VEHICLE, None, "does not say the charger's power"),
    (replace(VEHICLE, charging=None), FAST, 'charging.battery_heating is missing')], ids=['charger', 'vehicle'])
def test_without_charger_or_car_everything_is_as_without_them(vehicle, charger, why, settings):
    supervisors = a_supervisor(charger, settings, vehicle), a_supervisor(
        None, settings, vehicle, target_temperature_c=25.0)
    for second in range(3):
        decision, other = (feed(supervisor, second) for supervisor in supervisors)
        assert (decision.status, decision.explanation) == (other.status, other.explanation)
        for name in ('time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w'):
            assert np.array_equal(getattr(decision.plan, name), getattr(other.plan, name))
    assert decision.target.source is TargetSource.DEFAULT and why in decision.target.reason
    assert math.isnan(decision.target.charging_time_s)


@pytest.mark.parametrize('charger, state, why', [
    (Charger(150e3), BatteryState(6.0, 0.95), 'the state of charge for departure is unknown'),
    (Charger(150e3, 0.01), BatteryState(6.0, 0.08), 'is not enough for this trip'),
    (Charger(1800.0, 0.8), STATE, 'cannot charge the battery that far')],
    ids=['full enough', 'stranded', 'too weak'])
def test_where_nothing_can_be_chosen_the_default_holds(charger, state, why):
    decision = feed(a_supervisor(charger), state=state)
    assert decision.target.source is TargetSource.DEFAULT
    assert why in decision.target.reason and decision.plan.target_temperature_c == 25.0


# Not worth it

def test_where_heating_does_not_pay_there_is_none():
    supervisor = a_supervisor(SLOW)
    decision = feed(supervisor)
    worth = find_worth(VEHICLE, drive(), STATE, Goal(25.0), 50e3, 0.8, PRICES)
    assert worth.best is worth.without_heating
    assert decision.status is supervisor.state.latest_command.reason is Status.NOT_WORTH_IT
    assert supervisor.state.latest_command.battery_heating_power_w == 0.0
    assert decision.explanation.startswith(worth.verdict.split(':')[0])
    assert 'The heater stays off: arrival in 25:00 min' in decision.explanation
    plan, target = decision.plan, worth.without_heating.target_c
    assert plan.target_temperature_c == plan.arrival_temperature_c == pytest.approx(target)
    assert plan.heating_start_s is None and plan.shortfall_k == 0.0


def test_a_heater_that_is_on_is_switched_off_at_once():
    settings = replace(MEASURED, minimum_on_time_s=600.0, target_battery_temperature_c=None)
    supervisor = a_supervisor(settings=settings, target_temperature_c=50.0)
    feed(supervisor)
    assert supervisor.state.latest_command.battery_heating_power_w > 1000.0
    supervisor.accept_mission(a_mission(SLOW))
    feed(supervisor, 1.0)
    assert supervisor.state.latest_command.battery_heating_power_w == 0.0


def test_a_battery_with_more_than_is_asked_for_is_not_heated():
    decision = feed(a_supervisor(Charger(150e3, 0.6)), state=BatteryState(6.0, 0.9))
    assert decision.status is Status.NOT_WORTH_IT and 'needs no charging' in decision.explanation
    assert (decision.target.charging_time_s, decision.target.bought_energy_wh) == (0.0, 0.0)


def test_a_gain_that_is_too_small_is_none():
    without = TargetWorth(5.0, 5.0, 0.2, 0.0, 1800.0, 40e3, 30.0)
    little = replace(without, target_c=8.0, arrival_temperature_c=8.0, cost=30.0 - 0.9 * LEAST_GAIN_SHARE * 30.0)

    class Search:
        way = 'heating'

        def best(self):
            return little

        def break_even_per_h(self):
            return 7.125

        def step_in_words(self):
            return 'A step.'

    search = Search()
    search.without = without
    _, choice = TargetChooser().best_of(search, search_input(0.0))
    assert not choice.heating_pays and choice.target_c is None
    assert choice.reason == (
        'Not worth it: heating the battery to 8.0 degC before arrival would save less than 0.05 % of the '
        'cost. Some heating pays as soon as an hour is worth 7.12 to you. A step.')


def test_a_trip_that_cannot_be_carried_says_so_first():
    decision = feed(a_supervisor(SLOW), state=BatteryState(6.0, 0.08))
    assert decision.status is Status.OUT_OF_CHARGE


@pytest.mark.costly
@pytest.mark.parametrize('seed', [0, pytest.param(1, marks=pytest.mark.deep)])
def test_whatever_charger_car_and_state_come_together_nothing_fails(seed):
    random = np.random.default_rng(seed)
    for _ in range(8):
        vehicle = load_vehicle(random.choice(['reference', 'small_car', 'mid_size_lfp', 'large_suv']))
        if random.random() < 0.5:
            vehicle = replace(vehicle, heat_path=HeatPath(45.0, 15e3, 300.0, 30.0))
        charger = Charger(10.0**random.uniform(3.0, 6.3), random.choice([None, 0.0, 0.3, 0.8, 1.0]))
        settings = replace(MEASURED, estimation=bool(random.random() < 0.5),
                           energy_price_per_kwh=random.choice([0.0, 0.5, 1e3]),
                           value_of_time_per_h=random.choice([0.0, 10.0, 1e6]))
        supervisor = a_supervisor(charger, settings, vehicle, route=drive(
            4, random.uniform(-20.0, 20.0), random.uniform(0.0, 6e3), random.uniform(-20e3, 90e3)))
        state = BatteryState(random.uniform(-25.0, 45.0), random.choice([0.0, 0.03, 0.4, 0.8, 1.0]))
        for second in range(0, 245, 60):
            # A step that failed would raise here.
            decision = feed(supervisor, second, state)
            command = supervisor.state.latest_command
            assert command.battery_heating_power_w == 0.0 or decision.status is not Status.NOT_WORTH_IT
            assert decision.target is None or len(decision.target.reason) > 20


# Stops

def test_each_leg_has_the_target_for_its_own_charger():
    legs = [Leg(drive(), START_NS, charger=FAST),
            Leg(drive(), START_NS + 2100 * NS_PER_S, departure=BatteryState(6.0, 0.35), charger=SLOW)]
    supervisor = Stepwise(VEHICLE, MEASURED)
    supervisor.run(START_NS)
    supervisor.accept_mission(Mission('far', tuple(legs)))
    first = feed(supervisor)
    assert first.target.heating_pays
    assert feed(supervisor, 1800.0).target is None
    second = feed(supervisor, 2100.0)
    assert second.leg is legs[1] and second.status is Status.NOT_WORTH_IT


def test_without_charging_nothing_is_chosen():
    decision = feed(a_supervisor(charging_planned=False))
    assert decision.status is Status.NO_CHARGING_PLANNED and decision.target is None
