# SPDX-License-Identifier: Apache-2.0
"""Choice of a charger: by hand on a car without losses, against `find_worth`, and unsuitable candidates."""

from dataclasses import replace
import math

import numpy as np
from plain_car import CAPACITY_AH, constant, drive, plain_car, VOLTAGE_V
import pytest

from bev_preheat.charging.chargers import Candidate, load_chargers, rank_chargers, ranking_verdict
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle import load_vehicle

REFERENCE = load_vehicle('reference')
GOAL = Goal(25.0)
# Neither resistance nor leakage: all energies follow by hand. 15 kW, 1.5 kW cabin, 0.4 kW auxiliaries.
PLAIN = plain_car(limit=constant(-1e6))
DRIVE_W, SIDE_W = 16900.0, 1900.0
WHOLE_WH = VOLTAGE_V * CAPACITY_AH


def ranked(candidates, vehicle=PLAIN, state=None, end_soc=0.5, goal=GOAL, time_per_h=10.0, route=None):
    return rank_chargers(vehicle, route or drive(60), state or BatteryState(20.0, 0.6), goal, candidates,
                         end_soc, time_per_h)


@pytest.mark.parametrize('minutes', [10.0, 30.5, 60.0])
@pytest.mark.parametrize('detour_min', [0.0, 6.0])
def test_energies_and_costs_by_hand(minutes, detour_min):
    [item] = ranked([Candidate('here', 60.0 * minutes, 61900.0, 0.4, 60.0 * detour_min, 300.0)])
    way_wh = DRIVE_W * (minutes + 0.5 * detour_min) / 60.0
    rest_wh = DRIVE_W * (60.0 - minutes + 0.5 * detour_min) / 60.0
    # 60 kW into the battery. Heating brings nothing here, and costs the energy bought back.
    into_wh = (0.5 - 0.6) * WHOLE_WH + way_wh + rest_wh
    assert item.problem is None
    assert item.departure_soc == pytest.approx(0.5 + rest_wh / WHOLE_WH, abs=1e-5)
    assert item.end_soc == pytest.approx(0.5, abs=1e-5)
    assert item.worth.best == item.worth.without_heating
    assert item.worth.best.arrival_soc == pytest.approx(0.6 - way_wh / WHOLE_WH, abs=1e-6)
    assert item.worth.best.charging_time_s == pytest.approx(3600.0 * into_wh / 60e3, rel=1e-4)
    assert item.energy_cost == pytest.approx(0.4 * into_wh * (1.0 + SIDE_W / 60e3) / 1e3, rel=1e-4)
    assert item.charging_cost == pytest.approx(10.0 * into_wh / 60e3, rel=1e-4)
    assert item.detour_cost == pytest.approx(detour_min / 6.0)
    assert item.wait_cost == pytest.approx(10.0 * 300.0 / 3600.0)
    assert item.total_cost == pytest.approx(
        item.energy_cost + item.charging_cost + item.detour_cost + item.wait_cost)


@pytest.mark.costly
def test_all_are_compared_on_the_same_charge_at_the_end():
    found = ranked([Candidate('early', 900.0, 50e3, 0.5), Candidate('late', 3000.0, 150e3, 0.5, 120.0)],
                   REFERENCE, BatteryState(-5.0, 0.5), 0.5)
    assert [item.problem for item in found] == [None, None]
    for item in found:
        # The rest depends on the battery's temperature at departure; the departure is found to 1e-4.
        assert item.end_soc == pytest.approx(0.5, abs=2e-4)
        assert item.worth.best.cost <= min(target.cost for target in item.worth.targets)
    assert found[0].total_cost <= found[1].total_cost


def test_who_is_no_candidate_comes_last_with_the_reason():
    candidates = [Candidate('out of reach', 3500.0, 50e3, 0.1), Candidate('good', 600.0, 50e3, 0.5)]
    found = ranked(candidates, state=BatteryState(20.0, 0.3))
    assert [item.candidate.name for item in found] == ['good', 'out of reach']
    assert found[1].total_cost == math.inf and found[1].worth is None
    assert found[1].problem.startswith('out of reach: the battery will be empty after 44:')
    assert ranking_verdict(found).startswith('good, without heating before arrival: ')


@pytest.mark.parametrize('candidate, how, problem', [
    (Candidate('far', 3000.0, 50e3, 0.5), {'state': BatteryState(20.0, 0.45), 'goal': Goal(25.0, 0.15)},
     'out of reach: the charge would fall to 11.5 % on the way; the reserve is 15 %'),
    (Candidate('weak', 1800.0, 1500.0, 0.5), {},
     'This charger cannot charge the battery that far, heated or not: cabin and auxiliaries take all of the '
     '1.5 kW that charger and inlet provide.'),
    # 50 min at 16.9 kW of 42 kWh.
    (Candidate('early', 600.0, 50e3, 0.5), {'end_soc': 0.9},
     'even 100 % is not enough for the rest of the route: 66.5 % would be left at its end; 90 % is required'),
    (Candidate('early', 600.0, 50e3, 0.5), {'route': drive(240), 'end_soc': 0.2},
     'even 100 % is not enough for the rest of the route: the vehicle would strand; 20 % is required')],
    ids=['reserve', 'weak charger', 'too little at the end', 'stranded'])
def test_a_charger_that_does_not_suit_says_why(candidate, how, problem):
    [item] = ranked([candidate], **how)
    assert (item.problem, item.total_cost) == (problem, math.inf)
    # A charger that is reached may be judged.
    assert (item.as_dictionary()['worth'] is not None) == (candidate.name == 'weak')
    assert ranking_verdict([item]) == 'None of these chargers suits this route.'


def test_a_rest_that_falls_below_the_reserve_though_it_ends_above():
    # Over a pass: 30 min up, 30 min down.
    power_w = np.repeat([30e3, -20e3], 30)
    route = replace(drive(60), propulsion_power_w=power_w, propulsion_power_rms_w=np.abs(power_w),
                    propulsion_power_magnitude_w=np.abs(power_w))
    valley, state = [Candidate('valley', 60.0, 50e3, 0.5)], BatteryState(20.0, 0.3)
    # 29 min up take 15.4 kWh of 42, 30 min down bring 9.05 back: from 45.2 % over 8.5 % to 30 %.
    [item] = ranked(valley, PLAIN, state, 0.3, Goal(25.0, 0.1), route=route)
    assert item.problem == ('a departure with 45.2 % would reach the end with 30 %, but fall to '
                            '8.5 % on the rest of the route; the reserve is 10 %')
    [item] = ranked(valley, PLAIN, state, 0.3, Goal(25.0, 0.08), route=route)
    assert item.problem is None and item.departure_soc == pytest.approx(0.452, abs=1e-3)
    # It would not even reach the top.
    [item] = ranked(valley, PLAIN, state, 0.2, route=route)
    assert item.problem.endswith('but fall to 0.0 % on the rest of the route; the reserve is 0 %')


@pytest.mark.parametrize('end_soc, goal', [(1.2, GOAL), (math.nan, GOAL), (0.2, Goal(25.0, 0.3))])
def test_an_end_that_is_not_allowed(end_soc, goal):
    with pytest.raises(InvalidInput, match='^end state of charge: .* is not allowed; it must be '):
        ranked([Candidate('any', 1800.0, 50e3, 0.5)], end_soc=end_soc, goal=goal)


def test_the_price_of_waiting_decides():
    near, far = (Candidate('near', 1800.0, 61900.0, 0.4, 0.0, 900.0),
                 Candidate('far', 1800.0, 61900.0, 0.45))
    # 0.05 a kWh for 13 kWh is less than a quarter of an hour at 10, and more than one at 1.
    assert [item.candidate.name for item in ranked([near, far])] == ['far', 'near']
    assert [item.candidate.name for item in ranked([near, far], time_per_h=1.0)] == ['near', 'far']


# --- files ---


def loaded(tmp_path, text, route=drive(60)):
    path = tmp_path / 'chargers.yaml'
    path.write_text(text)
    candidates, _ = load_chargers(path, route, 0.6)
    return candidates


def test_what_a_file_says(tmp_path):
    one, other = loaded(tmp_path, """
chargers:
  - {name: one, at_km: 45, charger_power_w: 50000, detour_min: 4, free_probability: 0.75, wait_min: 20}
  - {name: other, at_min: 60, charger_power_w: 150000, energy_price_per_kwh: 0.35}
""")
    # 25 m/s.
    assert one == Candidate('one', 1800.0, 50e3, 0.6, 240.0, 300.0, free_probability=0.75)
    assert other == Candidate('other', 3600.0, 150e3, 0.35, 0.0, 0.0)


def test_where_a_vehicle_stands_it_is_there_from_the_first_instant_on(tmp_path):
    speed_mps = np.repeat([25.0, 0.0, 25.0], [10, 10, 40])
    [candidate] = loaded(tmp_path, 'chargers: [{name: a, at_km: 15, charger_power_w: 50000}]',
                         replace(drive(60), speed_mps=speed_mps))
    assert candidate.instant_s == pytest.approx(600.0)


@pytest.mark.parametrize('charger, problem', [
    ('name: a, charger_power_w: 50000', r'chargers\[0\] \(a\): needs either at_km or at_min'),
    ('name: a, charger_power_w: 50000, at_km: 1, at_min: 1', r'\(a\): needs either at_km or at_min'),
    ('name: a, charger_power_w: 50000, at_km: 91', r'\(a\).at_km: 91 is beyond the route, which ends at '
     '90.0 km'),
    ('name: a, charger_power_w: 50000, at_min: 61', r'\(a\).at_min: 61 is beyond the route, which ends at '
     '60.0 min'),
    ('name: a, charger_power_w: 0, at_km: 1', r'chargers\[0\].charger_power_w: 0 is not allowed; it must'),
    ('name: a, charger_power_w: .nan, at_km: 1', 'charger_power_w: nan is not a finite number'),
    ('name: a, charger_power_w: 50000, at_km: -1', 'at_km: -1 is not allowed; it must be above 0'),
    ('name: a, charger_power_w: 50000, at_km: 1, energy_price_per_kwh: -0.1', 'energy_price_per_kwh: -0.1 is '
     'not allowed; it must be at least 0'),
    ('name: a, charger_power_w: 50000, at_km: 1, free_probability: 1.5, wait_min: 3', 'free_probability: 1.5 '
     'is not allowed'),
    ('name: a, charger_power_w: 50000, at_km: 1, free_probability: 0.5', 'free_probability and wait_min must be '
     'given together'),
    ('name: a, charger_power_w: 50000, at_km: 1, detour_mn: 3', "unknown key 'detour_mn'; did you mean "
     "'detour_min'"),
    ('name: a, charger_power_w: 50000, at_km: 1}, {name: a, charger_power_w: 50000, at_km: 2',
     r"duplicate name 'a' \(2 times\)")])
def test_a_file_that_is_refused_in_one_line(tmp_path, charger, problem):
    with pytest.raises(InvalidInput, match=problem) as error:
        loaded(tmp_path, f'chargers: [{{{charger}}}]')
    assert len(error.value.problems) == 1 and str(tmp_path) in error.value.problems[0]
