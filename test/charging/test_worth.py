# SPDX-License-Identifier: Apache-2.0
"""Worth of heating: the best target against an independent scan, break-even, verdicts, refused inputs."""

from dataclasses import replace
import math

import numpy as np
from own_ageing import AGEING, own_session_cost
from plain_car import constant, drive, plain_car
import pytest
from refusals import problems_of

from bev_preheat.charging.expectation import time_deviation
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.session import charge, STEP_S
from bev_preheat.charging.stop import ChargingProspect, ChargingStop, stop_after
from bev_preheat.charging.target_worth import pays_from_per_h, Prices, TargetWorth
from bev_preheat.charging.verdict import verdict_on
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Charging, Uncertainty

REFERENCE = load_vehicle('reference')
PRICES = Prices(0.55, 12.0)
# Warm enough that heating has a cost: for a colder battery it is free, as the heater at the charger would take
# long.
STATE, GOAL = BatteryState(6.0, 0.35), Goal(25.0)
COLD, WARM = BatteryState(-5.0, 0.35), BatteryState(12.0, 0.35)
ROUTE = drive()


def worth_of(vehicle=REFERENCE, charger_power_w=150e3, state=STATE, prices=PRICES, route=ROUTE, goal=GOAL,
             departure_soc=0.8, prospect=ChargingProspect()):
    return find_worth(vehicle, route, state, goal, charger_power_w, departure_soc, prices, prospect=prospect)


def cost_of(vehicle, charger_w):
    """Return the cost of one target as a function: plan, session and money one after the other."""
    stop = ChargingStop(charger_w, 0.8, -8.0, 1500.0, 400.0)
    heating = ChargerHeating(vehicle, stop, PRICES)

    def cost(target_c):
        plan = (plan_unheated(vehicle, ROUTE, STATE, GOAL) if target_c is None else
                plan_preheating(vehicle, ROUTE, STATE, Goal(target_c)))
        arrival = BatteryState(plan.arrival_temperature_c, plan.arrival_soc)
        session = charge(vehicle, stop, arrival, heating=heating.choose(arrival).limit)
        aged = 0.0 if session.ageing is None else own_session_cost(session)
        return (PRICES.energy_per_kwh * session.bought_energy_wh / 1000.0
                + PRICES.time_per_h * session.charging_time_s / 3600.0 + aged)

    return cost


@pytest.fixture(scope='module')
def usual():
    """Return the Worth of the reference at 150 kW."""
    return worth_of()


# Full power only in a narrow range of temperatures: one minimum there, another at a lower temperature.
CORNERS = Table((0.0,), (-20.0, 0.0, 2.0, 12.0, 13.0, 40.0), (
    (-30e3, -40e3, -80e3, -82e3, -140e3, -150e3),))


@pytest.mark.parametrize('vehicle, charger_w', [
    pytest.param(REFERENCE, 150e3, id='reference', marks=pytest.mark.deep),
    pytest.param(replace(REFERENCE, charging=Charging(CORNERS, False)), 140e3, id='corners'),
    pytest.param(replace(REFERENCE, charging=replace(REFERENCE.charging, ageing=AGEING)), 50e3, id='ageing')])
def test_the_best_target_is_that_of_a_fine_scan(vehicle, charger_w):
    worth, cost = worth_of(vehicle, charger_w), cost_of(vehicle, charger_w)
    assert worth.without_heating.cost == pytest.approx(cost(None), rel=1e-9)
    # Every half degree, and densely around its lowest point.
    scan_c = np.arange(math.ceil(worth.without_heating.target_c), 24.0, 0.5)
    lowest_c = scan_c[int(np.argmin([cost(target_c) for target_c in scan_c]))]
    scan_c = np.arange(lowest_c - 0.45, lowest_c + 0.45, 0.05)
    scanned = [cost(target_c) for target_c in scan_c]
    assert worth.best.cost <= min(scanned) + 1e-6
    assert worth.best.target_c == pytest.approx(scan_c[int(np.argmin(scanned))], abs=0.075)
    assert worth.best.cost == pytest.approx(cost(worth.best.target_c), rel=1e-9)


def test_targets_go_from_no_heating_to_the_vehicles_maximum(usual):
    targets_c = [target.target_c for target in usual.targets]
    assert targets_c == sorted(targets_c) and targets_c[-1] == 60.0
    assert usual.targets[0] == usual.without_heating and usual.without_heating.hvch_electric_wh == 0.0
    assert max(np.diff(targets_c)) <= 1.0
    assert usual.best in usual.targets and usual.fixed.target_c == 25.0


def test_nothing_is_bought_where_the_battery_arrives_with_what_it_leaves_with(usual):
    worth = worth_of(departure_soc=usual.without_heating.arrival_soc)
    assert worth.best == worth.without_heating
    assert (worth.best.charging_time_s, worth.best.bought_energy_wh, worth.best.cost) == (0.0, 0.0, 0.0)
    # The heater's energy has to be bought.
    assert min(target.cost for target in worth.targets if target.hvch_electric_wh > 0.0) > 0.0


def test_not_heating_costs_the_time_and_money_of_both_sessions(usual):
    cost = cost_of(REFERENCE, 150e3)
    figures = usual.as_dictionary()
    assert figures['unheated_more_cost'] == pytest.approx(cost(None) - cost(usual.best.target_c), rel=1e-6)
    assert figures['unheated_more_cost'] > 0.0
    assert figures['unheated_longer_charging_s'] == (
        usual.without_heating.charging_time_s - usual.best.charging_time_s)
    assert f'the stop would cost {figures["unheated_more_cost"]:.2f} more in all' in usual.unheated_in_words()


def test_break_even_is_the_value_of_time_at_which_the_best_target_changes():
    # Heating at the charger depends on the value of time, too, so this car cannot heat there.
    car = replace(REFERENCE, charging=replace(REFERENCE.charging, battery_heating=False))
    break_even = worth_of(car, state=WARM).break_even_value_of_time_per_h
    assert 0.1 < break_even < 12.0
    below, above = (worth_of(car, state=WARM, prices=Prices(0.55, share * break_even)) for share in (0.9, 1.1))
    assert below.best == below.without_heating and above.best != above.without_heating
    assert below.break_even_value_of_time_per_h == pytest.approx(break_even, rel=0.02)
    assert below.verdict == (f'Not worth it at {0.9 * break_even:.2f} an hour: heating pays as soon as an '
                             f'hour is worth {below.break_even_value_of_time_per_h:.2f} to you.')


@pytest.mark.parametrize('more_wh, saved_s, per_h', [
    # 0.5 a kWh: 0.4 for a tenth of an hour.
    (800.0, 360.0, 4.0), (-100.0, 360.0, 0.0), (0.0, 360.0, 0.0), (800.0, 0.0, math.inf),
    (800.0, -60.0, math.inf), (-800.0, -60.0, math.inf)])
def test_from_which_value_of_time_on_a_target_pays(more_wh, saved_s, per_h):
    without = TargetWorth(5.0, 5.0, 0.2, 0.0, 2000.0, 40e3, 1.0)
    heated = TargetWorth(9.0, 9.0, 0.2, 900.0, 2000.0 - saved_s, 40e3 + more_wh, 1.0)
    assert pays_from_per_h(heated, without, 0.5) == pytest.approx(per_h)
    # Charged two times in five, heat for 0.2 is lost one and a half times for each: 0.3 for a tenth of an hour.
    assert pays_from_per_h(heated, without, 0.5, 0.4, 0.2) == pytest.approx(
        max(0.0, 5e-3 * more_wh + 3.0) if saved_s > 0.0 else math.inf)


@pytest.mark.deep
def test_at_a_charger_of_4_kw_in_the_cold_the_battery_is_charged_and_not_heated():
    # By hand: 2.1 kW are left. The heater takes them up to 25 degC, where 45 K times 34.9 W/K leak: 1.8 kW hold
    # the temperature, and 0.3 kW charge the missing 19 % of about 80 kWh: more than 50 h. Unheated, 2.1 kW charge.
    best = worth_of(charger_power_w=4000.0, state=BatteryState(-18.0, 0.35), route=drive(ambient_c=-20.0),
                    departure_soc=0.45).best
    assert (best.charger_heating, best.hvch_electric_wh) == ('never', 0.0)
    assert best.charging_time_s == pytest.approx((0.45 - best.arrival_soc) * 80e3 / 2100.0 * 3600.0, rel=0.05)
    stop = ChargingStop(4000.0, 0.45, -20.0, 1500.0, 400.0)
    session = charge(REFERENCE, stop, BatteryState(25.0, 0.26))
    assert session.problem is not None and session.problem.endswith('after 24 h')
    assert session.hvch_battery_power_w[10:].mean() == pytest.approx(45.0 * 34.8868 / 0.87, rel=1e-2)


def test_verdict_of_heating_that_pays(usual):
    best, without = usual.best, usual.without_heating
    saved_s = round(without.charging_time_s - best.charging_time_s)
    more = 0.55 * (best.bought_energy_wh - without.bought_energy_wh) / 1000.0
    assert usual.verdict == (
        f'Worth it: heating the battery to {best.target_c:.1f} degC before arrival saves '
        f'{saved_s // 60}:{saved_s % 60:02d} min at the charger and costs {more:.2f} more for energy. '
        f'Some heating pays as soon as an hour is worth {usual.break_even_value_of_time_per_h:.2f} to '
        'you.')


@pytest.mark.parametrize('per_h, verdict', [
    (10.0, 'Worth it: heating the battery to 9.0 degC before arrival saves 4:00 min at the charger and costs '
     'nothing for energy. Some heating pays whatever your time is worth.'),
    (0.0, 'Not worth it at 0.00 an hour: heating pays as soon as your time is worth anything.')])
def test_verdict_where_energy_is_free(per_h, verdict):
    without = TargetWorth(5.0, 5.0, 0.2, 0.0, 600.0, 40e3, per_h / 6.0)
    heated = TargetWorth(9.0, 9.0, 0.2, 900.0, 360.0, 41e3, per_h / 10.0)
    assert verdict_on(min(without, heated, key=lambda item: item.cost), without, 0.0, Prices(0.0, per_h),
                      None) == verdict


def test_the_spread_of_time_of_constant_power_is_that_of_the_consumption():
    # Without resistance, leakage and a limit only the energy of the drive counts.
    car = plain_car(limit=constant(-1e6))
    deviation = time_deviation(car, ROUTE, BatteryState(20.0, 0.6), Goal(10.0), 61900.0, 0.8, PRICES)
    # 60 kW into the battery; 8 % of the 6.25 kWh of the drive.
    assert deviation.without_heating_s == pytest.approx(
        3600.0 * 15e3 * 25.0 / 60.0 * math.sinh(0.08) / 60e3, rel=1e-3)
    assert (deviation.heated_s, deviation.saved_s) == (deviation.without_heating_s, 0.0)


def test_the_spread_of_time_of_an_identified_car_is_that_of_its_file():
    variances = [time_deviation(
        replace(REFERENCE, uncertainty=uncertainty), ROUTE, COLD, GOAL, 150e3, 0.8, PRICES).without_heating_s**2
        for uncertainty in (Uncertainty(*(share * np.array([0.058, 0.115, 0.115, 0.029])).tolist())
                            for share in (1.0, 0.75, 0.5))]
    # The consumption's is always the same.
    assert (variances[0] - variances[1]) / (variances[0] - variances[2]) == pytest.approx(
        (1.0 - 0.75**2) / (1.0 - 0.5**2), rel=0.02)


@pytest.mark.parametrize('changes, problems', [
    ({'prices': Prices(-0.1, 12.0)}, ['energy price: -0.1 is not allowed; it must be 0 ... 1000 per '
                                      'kWh']),
    ({'prices': Prices(math.nan, -1.0)}, [
        'energy price: nan is not allowed; it must be 0 ... 1000 per kWh',
        'value of time: -1 is not allowed; it must be 0 ... 1000000 per h']),
    ({'charger_power_w': 0.0, 'prices': Prices(0.5, math.inf)}, [
        'charger power: 0 is not allowed; it must be 1000 ... 2000000 W',
        'value of time: inf is not allowed; it must be 0 ... 1000000 per h']),
    ({'state': BatteryState(math.nan, 0.35)}, [
        "battery temperature: nan is not allowed; it must be -40 ... 60 degC, the range of the vehicle's "
        'battery']),
    ({'state': BatteryState(-5.0, 0.06)}, [
        'state of charge: 6 % is not enough for this trip, even without heating: the battery will be empty in']),
    ({'state': BatteryState(-5.0, 0.7), 'departure_soc': 0.5}, [
        'departure state of charge: 0.5 is below the 0.6'])])
def test_refused_in_words(changes, problems):
    for said, problem in zip(problems_of(worth_of, **changes), problems, strict=True):
        assert said.startswith(problem)


# Without heat at the charger, sessions do not depend on the prices.
SIMPLE = replace(REFERENCE, charging=Charging(CORNERS, False))


@pytest.fixture(scope='module')
def simple():
    return worth_of(SIMPLE, 140e3)


@pytest.mark.parametrize('share, pays', [(0.97, True), (1.03, False)])
@pytest.mark.parametrize('is_certain', [True, False])
def test_heating_pays_up_to_the_energy_price_that_is_named(simple, is_certain, share, pays):
    prospect = ChargingProspect(1.0 if is_certain else 0.5 * (1.0 + simple.pays_from_chance))
    named = worth_of(SIMPLE, 140e3, prospect=prospect)
    assert f'up to an energy price of {named.pays_to_price_per_kwh:.2f} per kWh' in named.bounds_in_words()
    # In doubt the heat that is lost counts.
    assert is_certain or named.pays_to_price_per_kwh < simple.pays_to_price_per_kwh
    prices = Prices(share * named.pays_to_price_per_kwh, PRICES.time_per_h)
    other = worth_of(SIMPLE, 140e3, prices=prices, prospect=prospect)
    assert (other.best is not other.without_heating) is pays


def test_bounds_are_none_if_heating_never_or_always_pays():
    never = worth_of(SIMPLE, 140e3, BatteryState(40.0, 0.35))
    assert (never.pays_to_price_per_kwh, never.bounds_in_words()) == (0.0, '')
    assert never.as_dictionary()['break_even_charging_probability'] is None
    # So cold that the battery is never charged without heat.
    closed = Table((0.0,), (-20.0, 5.0, 6.0, 40.0), ((0.0, 0.0, -50e3, -100e3),))
    always = worth_of(replace(REFERENCE, charging=Charging(closed, False)), 140e3, COLD, route=drive(cabin_w=0.0))
    assert (always.pays_to_price_per_kwh, always.pays_from_chance) == (math.inf, 0.0)
    assert always.bounds_in_words() == 'Some heating pays at any energy price and at any chance of charging.'
    assert always.unheated_in_words() == ''


def test_the_kelvins_that_save_most_time_at_the_charger_are_named():
    # It hardly warms while charging, and its power has a step from 20 to 22 degC.
    car = plain_car(limit=Table((0.0, 1.0), (-20.0, 20.0, 22.0, 50.0), ((-40e3, -40e3, -160e3, -160e3),) * 2))
    worth = worth_of(car, state=WARM)
    from_c, to_c, saved_s = worth.step
    assert 20.0 <= from_c + 0.05 and to_c <= 22.05 and to_c - from_c <= 2.05
    stop = stop_after(ROUTE, 150e3, 0.8)
    soc = {target.arrival_temperature_c: target.arrival_soc for target in worth.targets}
    low, high = (charge(car, stop, BatteryState(at_c, soc[at_c])).charging_time_s for at_c in (from_c, to_c))
    assert saved_s == pytest.approx(low - high, abs=STEP_S) and saved_s > 300.0
    span = f'{to_c - from_c:.1f} K more on arrival, from {from_c:.1f} to {to_c:.1f} degC'
    assert worth.step.in_words().startswith(f'{span}, are worth ')
    assert worth.as_dictionary()['step'] == {'from_c': from_c, 'to_c': to_c, 'saved_s': saved_s}


@pytest.mark.parametrize('share, pays', [(0.97, False), (1.03, True)])
def test_heating_pays_from_the_chance_that_is_named(simple, share, pays):
    assert 0.0 < simple.pays_from_chance < 1.0 and simple.pays_from_probability is None
    other = worth_of(SIMPLE, 140e3, prospect=ChargingProspect(share * simple.pays_from_chance))
    assert (other.best is not other.without_heating) is pays
    assert other.pays_from_chance == other.pays_from_probability
    assert other.pays_from_chance == pytest.approx(simple.pays_from_chance, rel=0.02)
    # The verdict has named it already.
    assert 'chance' in simple.bounds_in_words() and 'chance' not in other.bounds_in_words()


@pytest.mark.parametrize('car, reserve_soc, reason', [
    (REFERENCE, 0.3, 'below the 30.0 % reserve: the heater stays off'),
    (replace(REFERENCE, hvch=replace(REFERENCE.hvch, maximum_power_w=0.0)), 0.0, 'The battery cannot be heated')])
def test_heat_that_is_not_possible_is_not_judged(car, reserve_soc, reason):
    worth = worth_of(car, state=COLD, goal=Goal(25.0, reserve_soc))
    assert worth.best == worth.without_heating
    assert worth.verdict.startswith('No heating before arrival: ') and reason in worth.verdict
    assert 'neither time nor money' not in worth.verdict
