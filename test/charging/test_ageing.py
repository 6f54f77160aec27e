# SPDX-License-Identifier: Apache-2.0
"""Price of ageing: the published model by hand, its range, the best target and heating that it moves."""

from dataclasses import replace
import math

import numpy as np
from own_ageing import AGEING, own_cost_per_s, own_session_cost
from plain_car import drive, plain_car
import pytest
from test_worth import GOAL, PRICES, REFERENCE, STATE

from bev_preheat.charging.ageing import anode_potential_v, lost_per_s, outside_in_words, storage_factor
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_range import by_session, by_table, targets_in_range
from bev_preheat.charging.target_worth import pays_from_per_h, pays_to_price_per_kwh, TargetWorth
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle.curves import Table

STOP = ChargingStop(150e3, 0.9, -8.0, 0.0, 300.0)
AGED = replace(REFERENCE, charging=replace(REFERENCE.charging, ageing=AGEING))


def lost(soc, temperature_c, per_h, ageing=AGEING):
    """Return the loss of capacity in an hour."""
    return 3600.0 * float(lost_per_s(ageing, *map(np.array, (soc, temperature_c, per_h / 3600.0))))


def test_the_loss_is_that_of_the_published_model():
    # Table IV of Schimpe et al.: at 25 degC, 50 % and 1 C, where the anode is at 0.123 V.
    assert anode_potential_v(np.array(0.5)) == pytest.approx(0.123, abs=0.5e-3)
    assert storage_factor(np.array(0.5)) == pytest.approx(1.142, rel=1e-2)
    # 3.95 % in the first year.
    assert 2.0 * 8766.0 * lost(0.5, 25.0, 0.0, replace(AGEING, age_years=1.0)) == pytest.approx(0.0395, rel=1e-2)
    # 500 cycles of 3 Ah with 1 C: 1.55 % by plating; 0.80 % by cycling, half of that while charging.
    cycled = lost(0.5, 25.0, 1.0, replace(AGEING, full_cycles=500.0)) - lost(0.5, 25.0, 0.0)
    assert 2.0 * 500.0 * cycled == pytest.approx(0.01553 + 0.5 * 0.00797, rel=1e-3)
    # At 0 degC plating is e^2.05 times that at 25 degC; e^8.60 times above 82 %, less e^(7.84 · 0.7) with 0.3 C.
    assert lost(0.5, 0.0, 1.0) > 5.0 * lost(0.5, 25.0, 1.0)
    assert lost(0.83, 0.0, 1.0) - lost(0.81, 0.0, 1.0) == pytest.approx(3.0 * 2.031e-6 * 5435.0, rel=1e-2)
    assert lost(0.83, 0.0, 0.3) - lost(0.81, 0.0, 0.3) == pytest.approx(0.9 * 2.031e-6 * 5435.0 / 241.8, rel=1e-2)


def test_any_state_costs_what_the_equations_say():
    random = np.random.default_rng(5)
    for soc, temperature_c, per_h in random.uniform((0.0, -30.0, 0.0), (1.0, 70.0, 3.0), (300, 3)).tolist():
        assert AGEING.price * lost(soc, temperature_c, per_h) / 3600.0 == pytest.approx(
            own_cost_per_s(soc, temperature_c, per_h / 3600.0), rel=1e-9)


def test_outside_its_range_the_model_is_taken_at_the_edge_and_says_so():
    assert lost(0.5, -20.0, 0.5) == lost(0.5, 0.0, 0.5) and lost(0.5, 70.0, 0.5) == lost(0.5, 55.0, 0.5)
    storage = lost(0.5, 10.0, 0.0)
    assert lost(0.5, 10.0, 2.0) - storage == pytest.approx(2.0 * (lost(0.5, 10.0, 1.0) - storage))
    # 42 kWh: 20 kW are within, all at 100 kW is beyond 1 C; a battery at -1 degC warms while it is charged.
    car = plain_car(ageing=AGEING)
    within, fast = (charge(car, replace(STOP, charger_power_w=power_w), BatteryState(20.0, 0.3)) for power_w in (
        20e3, 100e3))
    cold = charge(plain_car(limit=Table((0.0,), (-40.0, 0.0, 0.5), ((-20e3, -20e3, -20e3),)), resistance_ohm=0.3,
                            ageing=AGEING), STOP, BatteryState(-1.0, 0.3))
    assert within.ageing.outside_share == 0.0 and fast.ageing.outside_share == 1.0
    soc_at_0 = np.interp(0.0, cold.battery_temperature_c, cold.soc)
    assert cold.battery_temperature_c[-1] > 0.0
    assert cold.ageing.outside_share == pytest.approx((soc_at_0 - 0.3) / 0.6, abs=0.01)
    assert outside_in_words(car, {'unheated': 0.0, 'heated': 0.514}).endswith(
        '0 ... 55 degC and up to 1 C: outside is 51 % of the charge heated, which counts as at the edge.')
    assert outside_in_words(car, {'unheated': 0.0}).endswith(': all charge is within.')
    assert outside_in_words(REFERENCE, {'unheated': 0.0}) is None


def test_a_session_costs_the_integral():
    session = charge(AGED, STOP, STATE, step_s=5.0)
    assert session.ageing_cost == pytest.approx(own_session_cost(session), rel=1e-9)
    assert session.ageing_cost == pytest.approx(charge(AGED, STOP, STATE).ageing_cost, rel=5e-3)
    assert session.as_dictionary()['ageing'] == {'cost': session.ageing_cost, 'outside_share': session.ageing[1]}
    dearer = replace(AGEING, battery_price=2.0 * AGEING.battery_price, end_of_life=0.9)
    assert charge(replace(REFERENCE, charging=replace(REFERENCE.charging, ageing=dearer)), STOP, STATE,
                  step_s=5.0).ageing_cost == pytest.approx(5.0 * session.ageing_cost)
    unpriced = charge(REFERENCE, STOP, STATE, step_s=5.0)
    assert unpriced.ageing_cost == 0.0 and 'ageing' not in unpriced.as_dictionary()
    assert np.array_equal(unpriced.time_s, session.time_s)
    endless = charge(plain_car(limit=Table((0.0,), (0.0,), ((-10.0,),)), ageing=AGEING), STOP, STATE)
    assert endless.problem and endless.ageing_cost == math.inf


def test_the_best_target_moves_with_the_price():
    without, cheap, dear = (find_worth(
        replace(REFERENCE, charging=replace(REFERENCE.charging, ageing=ageing)), drive(), STATE, GOAL, 80e3, 0.8,
        PRICES) for ageing in (None, replace(AGEING, battery_price=1e-6), replace(AGEING, battery_price=30e3)))
    assert cheap.best.target_c == without.best.target_c and cheap.best.cost == pytest.approx(without.best.cost)
    assert dear.best.target_c > without.best.target_c + 1.0
    assert dear.best.ageing_cost < dear.without_heating.ageing_cost
    assert f'saves {dear.without_heating.ageing_cost - dear.best.ageing_cost:.2f} in ageing' in dear.verdict
    for target in dear.targets:
        assert target.cost == pytest.approx(PRICES.cost(target.bought_energy_wh, target.charging_time_s)
                                            + target.ageing_cost)
    assert {'ageing_cost', 'ageing_outside_share'} <= dear.best.as_dictionary().keys()
    assert not {'ageing_cost', 'ageing_outside_share'} & without.best.as_dictionary().keys()


@pytest.mark.parametrize('saved_s, more_wh, younger, per_h, to_price', [
    # An hour of 12, energy of 0.5 a kWh.
    (360.0, 800.0, 0.1, 3.0, 1.3 / 0.8), (360.0, 800.0, -0.2, 6.0, 1.0 / 0.8), (360.0, 800.0, 0.5, 0.0, 1.7 / 0.8),
    (0.0, 800.0, 0.5, 0.0, 0.5 / 0.8), (0.0, 800.0, 0.3, math.inf, 0.3 / 0.8), (0.0, 800.0, -0.1, math.inf, 0.0),
    (-360.0, 800.0, 0.5, math.inf, 0.0), (360.0, -100.0, 0.1, 0.0, math.inf)])
def test_ageing_counts_where_heating_pays(saved_s, more_wh, younger, per_h, to_price):
    without = TargetWorth(0.0, 0.0, 0.2, 0.0, 2000.0, 30e3, 0.0, ageing_cost=1.0)
    item = TargetWorth(9.0, 9.0, 0.2, 0.0, 2000.0 - saved_s, 30e3 + more_wh, 0.0, ageing_cost=1.0 - younger)
    assert pays_from_per_h(item, without, 0.5) == pytest.approx(per_h)
    assert pays_to_price_per_kwh(item, without, 12.0) == pytest.approx(to_price)


def test_a_range_of_targets_counts_it_and_a_table_of_times_cannot():
    stop = ChargingStop(50e3, 0.8, -8.0, 1500.0, 400.0)
    found = targets_in_range(AGED, drive(), STATE, GOAL, (8.0, 14.0), by_session(AGED, stop, PRICES), PRICES)
    assert all(item.ageing_cost > 0.0 and item.cost == pytest.approx(
        PRICES.cost(item.bought_energy_wh, item.charging_time_s) + item.ageing_cost) for item in found)
    with pytest.raises(InvalidInput, match=r'charging\.ageing: a table of charging times has no temperatures'):
        by_table(AGED, Table((0.0, 1.0), (0.0, 20.0), ((900.0, 800.0), (0.0, 0.0))), 0.8)
