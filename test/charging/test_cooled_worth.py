# SPDX-License-Identifier: Apache-2.0
"""Worth of cooling a hot battery before the charger: against a scan of its own, and it does not always pay."""

from dataclasses import replace
import json
from pathlib import Path

import pytest

from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import stop_after
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import make_route
from bev_preheat.vehicle import load_vehicle

COOLED_THERE, PRICES = load_vehicle('heat_pump_car'), Prices(0.6, 10.0)
# The same car, whose chiller rests at a charger.
CAR = replace(COOLED_THERE, charging=replace(COOLED_THERE.charging, cooling=None))
# An hour at 110 km/h in air of 36 degC: the battery of the car arrives at 51 degC by itself.
COLUMNS = {'duration_s': [60.0] * 60, 'speed_mps': [30.5] * 60, 'propulsion_power_w': [22e3] * 60,
           'propulsion_power_rms_w': [28e3] * 60, 'ambient_temperature_c': [36.0] * 60,
           'cabin_heating_power_w': [0.0] * 60, 'auxiliary_power_w': [1800.0] * 60}
ROUTE, STATE, GOAL = make_route(COLUMNS, CAR.defaults), BatteryState(45.0, 0.8), Goal(22.0)


def cost_of(most_c):
    """Return the cost of a target, and the charging time [s]."""
    plan = plan_preheating(CAR, ROUTE, STATE, Goal(22.0, maximum_arrival_temperature_c=most_c))
    session = charge(CAR, stop_after(ROUTE, 150e3, 0.8), plan.arrival_state)
    return 0.6 * session.bought_energy_wh / 1000.0 + session.charging_time_s / 360.0, session.charging_time_s


def test_the_best_cooled_target_is_that_of_a_scan():
    worth = find_worth(CAR, ROUTE, STATE, GOAL, 150e3, 0.8, PRICES)
    assert worth.without_heating.arrival_temperature_c > 50.0
    costs = {most_c: cost_of(most_c)[0] for most_c in range(25, 51)}
    scanned_c = min(costs, key=costs.get)
    assert worth.best.cost <= costs[scanned_c] + 1e-6
    assert worth.best.target_c == pytest.approx(scanned_c, abs=1.0)
    cost, time_s = cost_of(worth.best.target_c)
    assert (worth.best.cost, worth.best.charging_time_s) == (pytest.approx(cost), pytest.approx(time_s))
    saved_s = worth.without_heating.charging_time_s - worth.best.charging_time_s
    assert saved_s > 600.0 and worth.best.hvch_electric_wh > 100.0
    assert worth.verdict.startswith(
        f'Worth it: cooling the battery to {worth.best.arrival_temperature_c:.1f} degC before arrival saves ')
    assert worth.bounds_in_words().startswith('Some cooling pays ')


def test_cooling_at_the_charger_leaves_less_to_gain_before_it():
    saved_s = [worth.without_heating.charging_time_s - worth.best.charging_time_s for worth in (
        find_worth(car, ROUTE, STATE, GOAL, 150e3, 0.8, PRICES) for car in (CAR, COOLED_THERE))]
    assert 60.0 < saved_s[1] < 0.5 * saved_s[0]


def test_no_cooling_where_it_does_not_pay():
    weak = find_worth(CAR, ROUTE, BatteryState(35.0, 0.8), GOAL, 11e3, 0.8, PRICES)
    assert weak.best is weak.without_heating and weak.best.hvch_electric_wh == 0.0
    assert 'Not worth it' in weak.verdict and 'cooling' in weak.verdict
    assert min(item.target_c for item in weak.targets) < weak.without_heating.target_c - 5.0
    # Its stairs lie at temperatures that it only comes to by cooling.
    assert weak.step is None


def test_the_command_says_cooling(said):
    rows = [','.join(COLUMNS), *(','.join(map(str, row)) for row in zip(*COLUMNS.values()))]
    Path('summer.csv').write_text('\n'.join(rows), encoding='utf-8')
    situation = ('--vehicle', 'heat_pump_car', '--route', './summer.csv', '--temperature', 45, '--soc', 0.8,
                 '--json', 'result.json')
    status, printed, _ = said('plan', *situation, '--max-arrival-temperature', 36.5)
    written = json.loads(Path('result.json').read_text())
    assert status == 0 and '22.00 … 36.50' in printed and 'Cooling starts after' in printed
    assert 'WAITING_TO_COOL: Cooling starts in ' in printed and 'eating starts in' not in printed
    assert written['maximum_arrival_temperature_c'] == 36.5 and written['heating_start_s'] is None
    assert written['cooling_start_s'] > 0.0 and sum(written['heat_source_power_w']['chiller']) > 0.0
    status, printed, _ = said('worth', *situation, '--charger-power', 150e3)
    assert status == 0 and 'Worth it: cooling the battery to ' in printed and 'without cooling' in printed
    assert 'Heating is needed' not in printed
