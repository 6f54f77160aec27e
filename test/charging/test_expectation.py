# SPDX-License-Identifier: Apache-2.0
"""Expected cost of preheating if charging is uncertain: by hand, its limits, its optimum, and refused inputs."""

from dataclasses import replace
from itertools import product
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from plain_car import drive, plain_car
import pytest
from refusals import problems_of

from bev_preheat.charging.expectation import Expectation
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import ChargingProspect, held_prospect, stop_after
from bev_preheat.charging.target_worth import Prices, TargetWorth
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.messages.route_plan import mission_from_message
from bev_preheat.numerics import FLOATS
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat_msgs.msg import RoutePlan

REFERENCE, PRICES = load_vehicle('reference'), Prices(0.6, 30.0)
STATE, GOAL = BatteryState(-7.0, 0.5), Goal(25.0)
ROUTE = drive()


def worth(prospect, vehicle=REFERENCE):
    return find_worth(vehicle, ROUTE, STATE, GOAL, 150e3, 0.8, PRICES, prospect=prospect)


@pytest.fixture(scope='module')
def certain():
    return worth(ChargingProspect())


@pytest.fixture(scope='module')
def doubtful():
    """Return the Worth at 40 %."""
    return worth(ChargingProspect(0.4))


def test_expected_cost_by_hand(certain, doubtful):
    """Charged as if certain; not charged, the difference of the charge on arrival is bought again."""
    battery = REFERENCE.battery
    unheated_soc = plan_unheated(REFERENCE, ROUTE, STATE, GOAL).arrival_soc
    charged = {item.target_c: item.cost for item in certain.targets}
    for item in doubtful.targets:
        if item.target_c not in charged or item is doubtful.without_heating:
            continue
        plan = plan_preheating(REFERENCE, ROUTE, STATE, Goal(item.target_c))
        socs = np.linspace(plan.arrival_soc, unheated_soc, 50)
        volts = [battery.open_circuit_voltage.function(FLOATS)(soc, plan.arrival_temperature_c) for soc in socs]
        lost_kwh = (unheated_soc - plan.arrival_soc) * battery.capacity_as * float(np.mean(volts)) / 3.6e6
        expected = 0.4 * charged[item.target_c] + 0.6 * 0.6 * lost_kwh
        assert item.cost == pytest.approx(expected, rel=1e-5)
    assert doubtful.without_heating.cost == pytest.approx(0.4 * certain.without_heating.cost, rel=1e-12)


@given(st.floats(0.01, 1.0))
@settings(max_examples=30, deadline=None)
def test_the_optimum_is_no_dearer_than_always_or_never(certain, doubtful, probability):
    costs = [probability * item.charged_cost + (1.0 - probability) * item.not_charged_cost
             for item in doubtful.targets]
    always = min(doubtful.targets, key=lambda item: item.charged_cost)
    never = doubtful.without_heating
    best = min(costs)
    for item in (always, never):
        assert best <= probability * item.charged_cost + (1.0 - probability) * item.not_charged_cost
    # Below the break-even probability no target is cheaper than no heating.
    if probability < doubtful.pays_from_probability:
        assert best == pytest.approx(probability * never.charged_cost, rel=1e-12)


def test_a_session_that_never_ends_unheated_is_a_sentence():
    """The battery takes nothing below 0 degC."""
    limit = Table((0.0,), (-20.0, 0.0, 10.0), ((0.0, 0.0, -60e3),))
    found = worth(ChargingProspect(0.3), plain_car(limit=limit))
    assert found.verdict.startswith('30 % chance of charging: ') and found.verdict.endswith('.')
    assert all(math.isfinite(item.cost) for item in found.targets)


def test_jitter_changes_nothing_but_certainty_does():
    unlikely, certain = ChargingProspect(0.9), ChargingProspect(1.0)
    assert held_prospect(certain, unlikely) is unlikely
    assert held_prospect(unlikely, ChargingProspect(0.93)) is unlikely
    assert held_prospect(unlikely, certain) is certain
    late = replace(certain, arrival_deviation_s=1.0)
    assert held_prospect(certain, late) is late


@pytest.fixture(scope='module')
def heated():
    """Return the Plan to GOAL, and the TargetWorth of certain charging after it."""
    plan = plan_preheating(REFERENCE, ROUTE, STATE, GOAL)
    state, stop = plan.arrival_state, stop_after(ROUTE, 150e3, 0.8)
    session = ChargerHeating(REFERENCE, stop, PRICES).choose(state).session
    return plan, TargetWorth(
        GOAL.target_temperature_c, plan.arrival_temperature_c, plan.arrival_soc, plan.energy_wh.hvch_electric,
        session.charging_time_s, session.bought_energy_wh,
        PRICES.cost(session.bought_energy_wh, session.charging_time_s))


def expected(heated, *prospect):
    plan, item = heated
    return Expectation(REFERENCE, ROUTE, STATE, stop_after(ROUTE, 150e3, 0.8), ChargingProspect(*prospect), PRICES,
                       plan_unheated(REFERENCE, ROUTE, STATE, GOAL)).of(item, plan)


@pytest.mark.parametrize('deviation_s', [0.0, 60.0])
def test_the_earlier_it_is_known_that_the_car_does_not_charge_the_less_heat_is_lost(heated, deviation_s):
    late, earlier, at_once = (expected(heated, 0.4, deviation_s, known_s).not_charged_cost
                              for known_s in (0.0, 300.0, 2.0 * ROUTE.total_duration_s))
    assert late > earlier > at_once
    assert at_once == pytest.approx(0.0, abs=1e-9)


def test_a_car_that_waits_for_the_charger_pays_the_wait_and_a_session_from_colder(heated):
    charged, waited = expected(heated, 0.4), expected(heated, 0.4, 0.0, 0.0, 1800.0)
    assert waited.charged_cost == charged.charged_cost
    # Half an hour at 30 per hour.
    assert waited.not_charged_cost - 15.0 > waited.charged_cost


@pytest.mark.parametrize('field, value', [('charging_probability', 1.1), *product(
    ('charging_probability', 'arrival_time_deviation', 'charging_known_before_arrival'),
    (math.nan, -0.1, math.inf))])
def test_a_bad_prospect_in_a_message_is_refused(field, value):
    problems = problems_of(mission_from_message, RoutePlan(**{field: value}), REFERENCE.defaults, 30.0)
    assert any(problem.startswith(f'{field}: {value:g} is not allowed; it must be 0 ... ') for problem in problems)


def test_an_arrival_that_hardly_varies_costs_as_an_exact_one(heated):
    exact, nearly = expected(heated, 0.4), expected(heated, 0.4, 1.0)
    # Sessions after uncertain arrivals are interpolated between simulated ones.
    assert nearly.charged_cost == pytest.approx(exact.charged_cost, rel=3e-4)
    assert nearly.not_charged_cost == pytest.approx(exact.not_charged_cost, rel=1e-3)
    assert nearly.cost == pytest.approx(0.4 * nearly.charged_cost + 0.6 * nearly.not_charged_cost, rel=1e-12)


def test_a_probability_above_one_is_refused():
    told, = problems_of(worth, ChargingProspect(1.1))
    assert told.startswith('charging probability: 1.1 is not allowed')
