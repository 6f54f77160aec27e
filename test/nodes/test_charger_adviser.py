# SPDX-License-Identifier: Apache-2.0
"""`charger_adviser`: chargers on the rest of the route, ranked by the node as by the function itself."""

import math

from planner_car import LATCHED, state_at
import pytest
from refusals import problems_of
from sensor_msgs.msg import BatteryState
from steady_drives import steady_leg, VEHICLE

from bev_preheat.charging.chargers import Candidate, rank_chargers, ranking_verdict
from bev_preheat.control.inputs import Mission
from bev_preheat.messages.rank_chargers import candidates_of
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning import situation
from bev_preheat_msgs.msg import RoutePlan
from bev_preheat_msgs.srv import RankChargers

START_S, SPEED_MPS, SEGMENTS, SEGMENT_S = 1000, 25.0, 40, 60.0
TEMPERATURE_C, SOC, END_SOC = -6.0, 0.375, 0.5
PRICE, VALUE_PER_H = 0.55, 12.0
CHARGERS = {'name': ['near', 'far'], 'distance': [15e3, 45e3], 'charger_power': [50e3, 150e3],
            'energy_price': [0.375, math.nan], 'detour': [120.0, 0.0], 'expected_wait': [0.0, 60.0]}


def leg_ahead(segments=SEGMENTS):
    return steady_leg(SEGMENT_S * segments, SEGMENT_S, speed_mps=[SPEED_MPS], propulsion_power_w=[15e3],
                      ambient_temperature_c=[-8.0], start_ns=START_S * NS_PER_S, charging_planned=False)


def route_ahead(segments=SEGMENTS):
    return leg_ahead(segments).route


def asked(**changed):
    return RankChargers.Request(**{**CHARGERS, 'end_soc': END_SOC, **changed})


# The request

def test_a_place_is_an_instant_of_the_rest_of_the_route():
    # 6 km are driven; 15 km from the start are 9 km ahead, at 25 m/s.
    near, far = candidates_of(asked(), route_ahead(), 6e3, PRICE)
    assert near == Candidate('near', 360.0, 50e3, 0.375, 120.0, 0.0)
    assert far == Candidate('far', 1560.0, 150e3, PRICE, 0.0, 60.0)


def test_what_is_left_out_is_the_parameter_and_nothing():
    near, _ = candidates_of(asked(energy_price=[], detour=[], expected_wait=[]), route_ahead(), 0.0, PRICE)
    assert (near.energy_price_per_kwh, near.detour_s, near.expected_wait_s) == (PRICE, 0.0, 0.0)


@pytest.mark.parametrize('changed, problems', [
    ({'name': []}, ['name: has 0 elements; it must have 1 ... 20', 'distance: has 2 elements; it must have 0']),
    ({'name': ['a', 'a']}, ["name: 'a' stands 2 times"]), ({'name': ['a', '']}, ['name[1]: must not be empty']),
    ({'distance': [15e3, 61e3]}, ['distance[1]: 61000 is not allowed; it must be 0 ... 60000 m, on the rest']),
    ({'distance': [math.nan, 1e3]}, ['distance[0]: nan is not allowed']),
    ({'charger_power': [0.0, 150e3]}, ['charger_power[0]: 0 is not allowed; it must be 1000 ... 2000000 W']),
    ({'energy_price': [-0.1, 0.3]}, ['energy_price[0]: -0.1 is not allowed; it must be 0 ... 1000 per kWh']),
    ({'detour': [math.inf, 0.0]}, ['detour[0]: inf is not allowed; it must be 0 ... 14400 s']),
    ({'expected_wait': [60.0]}, ['expected_wait: has 1 elements; it must have 2, as name has, or be empty'])])
def test_what_is_wrong_is_named(changed, problems):
    refused = problems_of(candidates_of, asked(**changed), route_ahead(), 0.0, PRICE)
    for problem in problems:
        assert any(found.startswith(problem) for found in refused), refused


# The node

class Drive:
    """An adviser, with a route that begins at START_S."""

    def __init__(self, bench):
        self._bench = bench
        self._states = bench.publisher(BatteryState, 'battery_state')
        routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
        bench.start('charger_adviser', '-p', f'energy_price:={PRICE}', '-p', f'value_of_time:={VALUE_PER_H}')
        routes.publish(route_plan_message(Mission('to the sea', (leg_ahead(),))))

    def answer(self, second, **changed):
        self._bench.now_ns = second * NS_PER_S
        self._states.publish(state_at(second * NS_PER_S, temperature=TEMPERATURE_C, percentage=SOC))
        return self._bench.call(RankChargers, '/charger_adviser/rank_chargers', asked(**changed))


@pytest.fixture
def drive(rehearsal):
    return Drive(rehearsal)


@pytest.mark.deep
@pytest.mark.parametrize('driven', [0, 5])
def test_they_are_ranked_as_the_function_ranks_them(drive, driven):
    answer = drive.answer(START_S + driven * int(SEGMENT_S))
    ahead = route_ahead(SEGMENTS - driven)
    ranked = rank_chargers(
        VEHICLE, ahead.resampled(30.0), situation.BatteryState(TEMPERATURE_C, SOC), situation.Goal(25.0),
        candidates_of(asked(), ahead, driven * SEGMENT_S * SPEED_MPS, PRICE), END_SOC, VALUE_PER_H)
    assert answer.ranked_name == [item.candidate.name for item in ranked]
    assert answer.message == ranking_verdict(ranked)
    assert list(answer.problem) == ['', '']
    assert list(answer.total_cost) == pytest.approx([item.total_cost for item in ranked], rel=1e-6)
    assert list(answer.total_cost) == sorted(answer.total_cost)
    for energy, time, total in zip(answer.energy_cost, answer.time_cost, answer.total_cost):
        assert energy + time == pytest.approx(total)
    best = ranked[0].worth.best
    assert answer.best_battery_temperature[0] == pytest.approx(best.arrival_temperature_c, abs=1e-3)
    assert answer.charging_time[0] == pytest.approx(best.charging_time_s, rel=1e-6)
    assert answer.charging_departure_soc[0] == pytest.approx(ranked[0].departure_soc, abs=1e-6)


def test_a_charger_that_is_behind_is_refused_by_its_place(drive):
    answer = drive.answer(START_S + 900)
    assert not answer.success
    assert answer.message.startswith('distance[0]: 15000 is not allowed; it must be 22500 ... 60000')


def test_one_that_cannot_serve_is_last_and_says_why(drive):
    # No charging is needed if the end is reachable without it.
    answer = drive.answer(START_S, end_soc=0.0625)
    assert all(problem.startswith('not needed') for problem in answer.problem)
    assert answer.message == 'No charger is needed: the charge is enough for the whole route.'
    assert all(map(math.isnan, answer.total_cost))


def test_a_route_that_has_ended_and_a_stale_battery_are_told(drive):
    answer = drive.answer(START_S + 3000)
    assert (answer.success, answer.message) == (False, 'the route ended 600 s ago')
    answer = drive.answer(START_S, end_soc=7.0)
    assert answer.message.startswith('end state of charge: 7 is not allowed')
