# SPDX-License-Identifier: Apache-2.0
"""The result of planning: in words and as JSON, compared with another plan, and the meaning of its status."""

from dataclasses import dataclass, replace
import json
from math import nan
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from bev_preheat.planning.plan import difference, energy_gap_wh
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Level, Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')


def made_plan(target_c, method='paper', cabin_w=1978.0, vehicle=VEHICLE, **how):
    route = make_route({
        'cabin_heating_power_w': np.atleast_1d(cabin_w), 'duration_s': [40.0, 10.0, 25.0, 60.0, 30.0, 5.0, 90.0],
        'speed_mps': [22.0], 'propulsion_power_w': [19e3], 'ambient_temperature_c': [-6.0]}, VEHICLE.defaults)
    return plan_preheating(vehicle, route, BatteryState(-3.0, 0.83), Goal(target_c), method, **how)


@pytest.fixture(scope='module')
def plan():
    # Partial heating reaches the target.
    return made_plan(-0.5)


def test_a_plan_that_another_process_has_sent_tells_itself(plan):
    assert pickle.loads(pickle.dumps(plan)).explanation == plan.explanation


@pytest.mark.parametrize('target_c', [-0.5, 40.0, -5.0],
                         ids=['waiting', 'unreachable', 'not_needed'])
def test_json_and_back_is_the_same(target_c):
    dictionary = made_plan(target_c).as_dictionary()
    # Strict JSON has no NaN.
    assert json.loads(json.dumps(dictionary, allow_nan=False)) == dictionary


# Heat arrives later than the car.
LATE = {'method': 'value_function', 'heat_lag_s': 300.0}


@pytest.mark.parametrize('how, told', [
    ({'cabin_w': 1978.0, **LATE}, 'Further heat would arrive too late: arrival in 4:20 min at '),
    ({'cabin_w': 7000.0, **LATE}, 'Cabin heating leaves no power for the battery: arrival in 4:20 min at '),
    ({'cabin_w': [1978.0] * 7}, 'Heating all the way is not enough: '),
    # The cabin takes the heater's whole power for a while.
    *(({'cabin_w': cabin_w}, 'Heating whenever cabin heating and limits allow is not enough: ') for cabin_w in (
        [7000.0] * 2 + [0.0] * 5, [0.0] * 3 + [7000.0] + [0.0] * 3, [0.0] * 6 + [7000.0])),
    ({'vehicle': replace(VEHICLE, hvch=replace(VEHICLE.hvch, maximum_power_w=0.0))},
     'The battery cannot be heated: arrival in ')])
def test_a_plan_that_misses_its_target_says_why(how, told):
    assert made_plan(40.0, **how).explanation.startswith(told)


def test_dictionary_is_the_plan(plan):
    dictionary = plan.as_dictionary()
    assert {key: dictionary[key] for key in (
        'status', 'method', 'explanation', 'target_temperature_c', 'heating_start_s',
        'arrival_time_s', 'arrival_temperature_c', 'arrival_soc', 'shortfall_k',
        'undeliverable_power_w', 'undeliverable_at_s', 'planning_time_s')} == {
            'status': 'WAITING', 'method': 'paper', 'explanation': plan.explanation,
            'target_temperature_c': -0.5, 'heating_start_s': plan.heating_start_s,
            'arrival_time_s': 260.0, 'arrival_temperature_c': plan.arrival_temperature_c,
            'arrival_soc': plan.arrival_soc, 'shortfall_k': plan.shortfall_k,
            'undeliverable_power_w': 0.0, 'undeliverable_at_s': None,
            'planning_time_s': plan.planning_time_s}
    for name in ('time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w'):
        assert dictionary[name] == list(getattr(plan, name)), name
    assert set(dictionary['energy_wh']) == {
        'joule', 'drivetrain_heat', 'hvch_heat', 'hvch_electric', 'leakage', 'battery_total'}


@dataclass(frozen=True)
class Made:
    shortfall_k: float = 0.0
    soc_shortfall: float = 0.0
    undeliverable_power_w: float = 0.0
    wh: float = 5000.0
    arrival_temperature_c: float = 25.0

    @property
    def energy_wh(self):
        return SimpleNamespace(battery_total=self.wh)


@pytest.mark.parametrize('plan, optimum, expected', [
    ({}, {}, ''),
    ({'shortfall_k': 0.19}, {}, ''),
    ({'shortfall_k': 0.21, 'arrival_temperature_c': 24.79}, {}, '0.21 K colder'),
    ({'shortfall_k': 14.13}, {'shortfall_k': 14.13}, ''),
    ({'shortfall_k': 15.5, 'arrival_temperature_c': 9.5}, {'shortfall_k': 14.25, 'arrival_temperature_c': 10.75},
     '1.25 K colder'),
    ({'shortfall_k': 1.5}, {'shortfall_k': 4.25, 'arrival_temperature_c': 22.25}, '2.75 K warmer'),
    ({'shortfall_k': 2.0, 'arrival_temperature_c': 37.0}, {'arrival_temperature_c': 35.0}, '2.00 K warmer'),
    ({'arrival_temperature_c': 35.0}, {'shortfall_k': 1.0, 'arrival_temperature_c': 36.0}, '1.00 K colder'),
    ({'soc_shortfall': 0.004}, {}, 'reserve missed'),
    ({}, {'soc_shortfall': 0.004}, 'reserve kept'),
    ({'soc_shortfall': 0.02}, {'soc_shortfall': 0.03}, ''),
    # Difference between planning by Euler and by Runge-Kutta.
    ({'soc_shortfall': 0.0004}, {}, ''),
    ({'undeliverable_power_w': 1500.0}, {}, 'power deficit 1.50 kW larger'),
    ({'undeliverable_power_w': 500.0}, {'undeliverable_power_w': 700.0}, 'power deficit 0.20 kW smaller'),
    ({'undeliverable_power_w': 705.0}, {'undeliverable_power_w': 700.0}, ''),
    ({'shortfall_k': nan}, {}, 'unknown arrival'),
    ({}, {'undeliverable_power_w': nan}, 'unknown power')])
def test_what_is_not_the_same_is_said(plan, optimum, expected):
    plan, optimum = Made(**plan, wh=5155.0), Made(**optimum)
    assert difference(plan, optimum) == expected
    assert energy_gap_wh(plan, optimum) == (None if expected else 155.0)


@pytest.mark.parametrize('status', Status, ids=lambda status: status.name)
def test_a_meaning_is_whole_and_contradicts_nothing(status):
    meaning = status.meaning
    assert meaning.word and meaning.look in ('off', 'wait', 'heat', 'cool', 'good', 'warn')
    # What needs a look is shown as such, and says what would help and what was missing.
    assert (meaning.look == 'warn') >= (meaning.level is Level.ERROR or meaning.is_alarm or meaning.is_doubt)
    assert bool(meaning.otherwise and meaning.obstacle) >= (meaning.is_alarm or meaning.is_doubt)
    # A doubt interrupts any plan; after the end of a trip there is none.
    assert meaning.is_doubt + meaning.is_of_plan + meaning.is_over <= 1
    assert bool(meaning.cause) <= meaning.is_doubt
    assert not (meaning.is_doubt and meaning.ends_by_plan)
    assert not meaning.otherwise or meaning.otherwise.endswith('.')
    assert not meaning.obstacle.endswith('.') and not meaning.cause.endswith('.')
