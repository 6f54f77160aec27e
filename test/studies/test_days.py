# SPDX-License-Identifier: Apache-2.0
"""Drawn days: their phases, their tally on records written by hand, and a day that is driven."""

from dataclasses import asdict, replace
import json

import pytest

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.simulation.phases import Park
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.results_file import value_of
from bev_preheat_studies.robustness.days import DayResult, drive_day, summarise_days, TripOutcome
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.robustness.drawn_days import draw_day

VEHICLE = load_vehicle('reference')
ROUTES = tuple(load_route(name, VEHICLE.defaults) for name in ('reference', 'winter_commute'))
CONDITIONS = Conditions(VEHICLE, ROUTES, BatteryState(-7.0, 0.9), Goal(25.0), 2.0, plant='all')


@pytest.fixture(scope='module')
def days():
    return [draw_day(CONDITIONS, 3, number) for number in range(300)]


def test_days_are_made_again_from_seed_and_number(days):
    again = draw_day(CONDITIONS, 3, 7)
    assert (again.paces, again.route_numbers, again.drawn.mismatch) == (
        days[7].paces, days[7].route_numbers, days[7].drawn.mismatch)
    assert draw_day(CONDITIONS, 4, 7).paces != days[7].paces


def test_a_fault_begins_in_the_first_trip():
    for number in range(30):
        day = draw_day(replace(CONDITIONS, fault='dead'), 3, number)
        fault, = day.drawn.heater_faults
        first_s = ROUTES[day.route_numbers[0]].total_duration_s
        assert 0.1 * first_s <= fault.from_s <= 0.5 * first_s


def trip(position, error_k, pace=1.0, is_told=False, switch_ons=1, route=0):
    return TripOutcome(position, route, pace, is_told, error_k, switch_ons)


def test_figures_of_days_written_by_hand():
    results = [
        DayResult(0, True, (trip(0, 0.5), trip(1, -0.2, 1.08), trip(2, 0.9, 0.95, is_told=True)),
                  heated_charging_s=4.0, hours=2.0),
        DayResult(1, False, (trip(0, -0.1, switch_ons=2), trip(1, None, switch_ons=5, route=1)),
                  heater_verdicts=('dead, drive 2, 7 s',), heated_parked_s=700.0, hours=3.0)]
    summary = summarise_days(results, False, hilly=(1,))
    errors = summary['arrival_error_k']
    assert (errors['first, time known']['trips'], errors['first, time known']['median']) == (2, pytest.approx(0.2))
    assert errors['later, time known']['worst'] == 0.9
    assert errors['early or late without a word']['worst'] == -0.2
    assert summary['heater_accused'] == ['day 1: dead, drive 2, 7 s']
    assert summary['heated_charging_s']['with power'] == {'total': 4.0, 'most': 4.0}
    assert summary['heated_parked_s']['without'] == {'total': 700.0, 'most': 700.0}
    assert (summary['switch_ons']['most'], summary['switch_ons']['most over hills']) == (2, 5)
    met = {each['name']: each['met'] for each in summary['requirements']}
    assert met == {
        'arrival error 5 %, first, time known': True, 'arrival error 95 %, first, time known': True,
        'arrival error 5 %, later, time known': True, 'arrival error 95 %, later, time known': True,
        'healthy heaters reported as faulty': False, 'good signals reported as in doubt': True,
        'heating while charging, beyond the stated time': False,
        'heating while parked, beyond the stated time': True,
        'switch-ons in any trip, except over hills': True}


@pytest.mark.costly
def test_a_day_is_driven_to_its_end_and_kept():
    short = replace(CONDITIONS, routes=(ROUTES[1].before(300.0),), goal=Goal(0.0), period_s=10.0)
    result = drive_day(short, 3, 1)
    day = draw_day(short, 3, 1)
    assert [each.position for each in result.trips] == list(range(len(day.paces)))
    assert [each.pace for each in result.trips] == list(day.paces)
    assert result.knows_power is day.conditions.reports_power
    assert result.hours > sum(phase.duration_s for phase in day.phases if isinstance(phase, Park)) / 3600.0
    assert value_of(DayResult, json.loads(json.dumps(asdict(result)))) == result
