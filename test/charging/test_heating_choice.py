# SPDX-License-Identifier: Apache-2.0
"""Heating at the charger as a decision: against brute force with an integrator of its own, and its invariants."""

from dataclasses import replace
from itertools import product
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from own_ageing import AGEING
from plain_car import own_session, plain_car
import pytest

from bev_preheat.charging.heating_choice import ChargerHeating, HeatingDecision
from bev_preheat.charging.heating_policy import ALWAYS, HeatingLimit, NEVER
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import HeatPath

REFERENCE, LARGE = load_vehicle('reference'), load_vehicle('large_suv')
PRICES = Prices(0.6, 10.0)
# A limit that rises with the temperature and falls with the charge.
COLD_LIMIT = Table((0.0, 1.0), (-20.0, 0.0, 25.0), ((-8e3, -35e3, -120e3), (-1e3, -12e3, -60e3)))
CAR = plain_car(resistance_ohm=0.08, leakage_w_per_k=25.0, limit=COLD_LIMIT, heats=True)


def stop_at(charger_w, ambient_c=-15.0, departure_soc=0.8):
    return ChargingStop(charger_w, departure_soc, ambient_c, 900.0, 350.0)


def is_between(stretches):
    """Return the rule that heats in any of the stretches (start [s], end [s])."""
    return lambda elapsed_s, soc, temperature_c: any(start <= elapsed_s < end for start, end in stretches)


@pytest.mark.parametrize('charger_w, prices, ageing', [
    (11e3, PRICES, None), (22e3, PRICES, None), (50e3, Prices(0.4, 3.0), None), (150e3, Prices(0.3, 25.0), None),
    (50e3, Prices(0.4, 3.0), AGEING)])
def test_no_stretches_of_heating_beat_the_choice(charger_w, prices, ageing):
    """Brute force over one and two stretches, and over thermostats that rise or fall with the charge."""
    stop, state = stop_at(charger_w), BatteryState(-11.0, 0.3)
    car = replace(CAR, charging=replace(CAR.charging, ageing=ageing))
    choice = ChargerHeating(car, stop, prices).compare(state)
    longest_s = charge(CAR, stop, state).time_s[-1]
    instants = [share * longest_s for share in (0.0, 0.1, 0.2, 0.35, 0.5, 0.7)]
    rules = [is_between([(start, end)]) for start in instants for end in instants if end > start]
    rules += [is_between([(0.0, first), (again, end)]) for first, again, end in product(instants[1:], repeat=3)
              if first < again < end]
    rules += [lambda elapsed_s, soc, at_c, low=low, slope=slope: at_c < low + slope * (soc - 0.3)
              for low in (-12.0, -8.0, -4.0, 0.0, 5.0, 10.0, 15.0, 20.0)
              for slope in (-15.0, 0.0, 10.0, 20.0, 35.0)]
    best = min(own_session(car, stop, state, 30.0, rule).cost(prices) for rule in rules)
    assert choice.cost <= best * 1.001
    # The integrator above agrees with the session.
    always, never = (own_session(car, stop, state, 2.0, lambda *_, on=on: on).cost(prices) for on in (True, False))
    assert choice.cost_always == pytest.approx(always, rel=2e-3)
    assert choice.cost_never == pytest.approx(never, rel=1e-3)


@settings(max_examples=settings.default.max_examples // 4)
@given(st.sampled_from([REFERENCE, LARGE, replace(REFERENCE, heat_path=HeatPath(30.0, 15e3, 300.0))]),
       st.sampled_from([7e3, 11e3, 22e3, 50e3, 150e3]), st.floats(-28.0, 10.0), st.floats(0.0, 30.0),
       st.floats(0.05, 0.5), st.floats(0.1, 0.4), st.floats(0.0, 1.0), st.floats(0.0, 80.0))
def test_the_choice_never_costs_more_than_always_and_never(
        vehicle, charger_w, ambient_c, warmer_k, soc, charged, price, per_h):
    stop, prices = stop_at(charger_w, ambient_c, soc + charged), Prices(price, per_h)
    state = BatteryState(ambient_c + warmer_k, soc)
    heating = ChargerHeating(vehicle, stop, prices)
    costs = [prices.cost(session.bought_energy_wh, session.charging_time_s) for session in (
        charge(vehicle, stop, state, heating=limit) for limit in (ALWAYS, NEVER))]
    for choice in (heating.choose(state), heating.compare(state)):
        assert choice.cost <= min(costs) * (1.0 + 2e-5)
    assert choice.cost_always == costs[0] and choice.cost_never == costs[1]


def test_both_are_told_where_only_heat_ends_the_session():
    frozen = Table((0.0,), (-5.0, 20.0), ((0.0, -90e3),))
    car = plain_car(limit=frozen, heats=True, resistance_ohm=0.05)
    choice = ChargerHeating(car, stop_at(50e3), PRICES).compare(BatteryState(-11.0, 0.3))
    assert choice.cost_never == math.inf and math.isfinite(choice.cost)
    assert 'heated it reaches 80 % in ' in choice.sentence()
    assert 'unheated it never does, because at 30.0 % and -11.0 degC the battery takes less than 50 W' in (
        choice.sentence())


def test_a_weak_charger_is_to_blame_and_not_the_heater_that_nobody_needs():
    # Cabin and auxiliaries leave 250 W: 6 kWh in 24 h, into a warm battery of 42 kWh.
    car = plain_car(limit=Table((0.0,), (0.0, 20.0), ((-9e4, -9e4),)), heats=True)
    choice = ChargerHeating(car, stop_at(1500.0), PRICES).choose(BatteryState(10.0, 0.3))
    assert choice.session.problem == f'the battery has only {30.0 + 600.0 / 42.0:.1f} % after 24 h'


def test_a_car_that_cannot_says_nothing():
    car = plain_car(limit=COLD_LIMIT)
    choice = ChargerHeating(car, stop_at(50e3), PRICES).choose(BatteryState(-11.0, 0.3))
    assert choice.decision is HeatingDecision.UNABLE and choice.sentence() == ''
    assert choice.session.charging_time_s == charge(car, stop_at(50e3), BatteryState(-11.0, 0.3)).charging_time_s


def test_a_limit_is_linear_between_its_points_and_never_above_the_cars():
    limit = HeatingLimit((0.2, 0.4), (10.0, 30.0)).function(25.0)
    assert [limit(soc) for soc in (0.1, 0.2, 0.25, 0.4, 0.9)] == pytest.approx([10.0, 10.0, 15.0, 25.0, 25.0])
    assert HeatingLimit((0.2, 0.4), (10.0, 30.0)).function(-math.inf)(0.3) == -math.inf
    assert ALWAYS.function(25.0)(0.3) == 25.0 and NEVER.function(25.0)(0.3) == -math.inf


def test_where_the_choice_is_always_the_session_is_todays():
    """Free energy and a battery that is the limit: all heat saves time."""
    stop, state = ChargingStop(400e3, 0.8, -15.0, 900.0, 350.0), BatteryState(-11.0, 0.3)
    car = replace(CAR, charging=replace(CAR.charging, heating_limit_c=0.0))
    choice = ChargerHeating(car, stop, Prices(0.0, 10.0)).choose(state)
    today = charge(car, stop, state)
    assert choice.decision is HeatingDecision.ALWAYS
    assert (choice.session.charging_time_s, choice.session.bought_energy_wh) == (
        today.charging_time_s, today.bought_energy_wh)
    # Until then it heats, and not later; no heated step ends warmer.
    power_w, ends_s, ends_c = (
        today.hvch_battery_power_w, today.time_s[1:], today.battery_temperature_c[1:])
    assert power_w[ends_s == choice.until_s] > 0.0 and not power_w[ends_s > choice.until_s].any()
    assert choice.until_c == max(end_c for end_c, heater_w in zip(ends_c, power_w) if heater_w > 0.0)
