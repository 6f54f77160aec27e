# SPDX-License-Identifier: Apache-2.0
"""A winter fleet: its trips, a trip that is driven in each way, and the figures."""

from functools import partial

import pytest

from bev_preheat_studies.fleet.figure import make_fleet_figure
from bev_preheat_studies.fleet.study import drive_trip, FleetResult, Stop, summarise_fleet
from bev_preheat_studies.fleet.winter_trips import ALWAYS, BEST, NONE, USUAL, WAYS


@pytest.mark.costly
def test_the_best_target_costs_least_and_a_thermostat_takes_most_energy():
    drives = map(partial(drive_trip, 1), range(20))
    ways = next(drive.ways for drive in drives if drive.ambient_c < -3.0 and drive.ways)
    assert tuple(ways) == WAYS
    assert ways[NONE].heater_wh == 0.0 < ways[USUAL].heater_wh < ways[ALWAYS].heater_wh
    assert 0.0 < ways['20 min'].heater_wh <= ways['30 min'].heater_wh <= ways['30/60 min'].heater_wh
    # The planner's choice may cost a hair more than the least of all.
    assert ways[BEST].cost <= 1.0005 * min(stop.cost for stop in ways.values())


def made(number, ambient_c, minutes, saved_s, car='reference'):
    return FleetResult(number, car, ambient_c, 70.0, {
        way: Stop(1000.0 * share, 10.0, 3.0 - share, minutes * 60.0 - saved_s * share, 40e3 + 500.0 * share)
        for way, share in {**dict.fromkeys(WAYS, 0.5), NONE: 0.0, ALWAYS: 2.0, USUAL: 1.5, BEST: 1.0}.items()})


def test_figures_by_group():
    results = [made(0, -20.0, 60.0, 600.0), made(1, -1.0, 40.0, 120.0), made(2, -1.0, 40.0, 0.0, 'small_car'),
               FleetResult(3, 'small_car', 0.0, 20.0, {}, 'never charged')]
    summary = summarise_fleet(results)
    assert (summary['trips'], summary['left_out']) == (3, 1)
    assert summary['groups'].keys() == {'all', 'below -10 degC', '-5 to 0 degC', '60 to 90 min', 'reference',
                                        'small_car'}
    best = summary['groups']['all']['ways'][BEST]
    assert best['saved_min'] == pytest.approx({'mean': 4.0, '5 %': 0.2, 'median': 2.0, '95 %': 9.2})
    assert best['more_kwh']['mean'] == pytest.approx(0.5) and best['heater_kwh'] == 1.0
    assert [summary['groups']['all']['ways'][way]['too_cold'] for way in (NONE, USUAL)] == [1.0, 0.0]
    # 4 min at 10 per hour, and 0.5 kWh at 0.60.
    assert best['more_cost'] == pytest.approx(0.3 - 4.0 / 6.0)
    assert summary['groups']['-5 to 0 degC']['ways'][USUAL]['saved_min']['mean'] == pytest.approx(1.5)
    figure = make_fleet_figure(summary)
    assert [line.get_label() for line in figure.axes[0].get_lines()[1:]] == [
        "the planner's choice of target", "the car's usual target", 'heater always on']
    assert list(figure.axes[0].get_lines()[1].get_ydata()) == pytest.approx([10.0, 1.0])
