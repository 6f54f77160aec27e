# SPDX-License-Identifier: Apache-2.0
"""The study of wrong signals: its cases, its figures on results written by hand, and drives of two cases."""


import pytest

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.robustness.signals import CASES, drive_case, SignalResult, summarise_cases

VEHICLE = load_vehicle('reference')
CONDITIONS = Conditions(VEHICLE, (load_route('reference', VEHICLE.defaults).before(300.0),),
                        BatteryState(5.0, 0.8), Goal(25.0))


def test_figures_of_results_written_by_hand():
    def result(number, named_s, heater=(), others=(), switch_ons=1):
        return SignalResult(number, 'voltage 300', number, named_s, others, heater, switch_ons)

    summary = summarise_cases([result(0, 10.0), result(1, 500.0, ('dead',)), result(2, None, (), ('source',)),
                               result(3, 120.0, switch_ons=4), result(4, 30.0)])
    assert summary == {'voltage 300': {
        'cars': 5, 'named': 0.8, 'in_time': 0.6, 'median_s': 75.0, 'worst_s': 500.0, 'heater_accused': 1,
        'others_named': 1, 'most_switch_ons': 4}}
    never, = summarise_cases([result(0, None)]).values()
    assert (never['named'], never['median_s'], never['worst_s']) == (0.0, None, None)


@pytest.mark.costly
def test_a_number_is_a_case_in_a_car():
    names = list(CASES)
    number = len(CASES) + names.index('voltage 300')
    result = drive_case(CONDITIONS, 1, number)
    assert (result.case, result.car, result.number) == ('voltage 300', 1, number)
    assert result.named_s is not None and result.named_s < 120.0
