# SPDX-License-Identifier: Apache-2.0
"""The planner with a method of another package."""

import installed_packages
from planner_car import is_off_for, PlannerCar
import pytest
from rcl_interfaces.srv import DescribeParameters
from rehearsal import START_NS

from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status

STEPS, STEP_S = 60, 30.0
BROKEN = """
def negative(situation):
    return -situation.heater_limit_w
"""


def test_the_planner_heats_by_an_installed_method_and_refuses_a_broken_one(rehearsal, tmp_path, monkeypatch):
    installed_packages.put_example(tmp_path, 'fixed_minutes_method')
    (tmp_path / 'broken_method.py').write_text(BROKEN)
    installed_packages.write_metadata(tmp_path, 'broken-method', {'negative': 'broken_method:negative'})
    installed_packages.use_folder(monkeypatch, tmp_path)
    car = PlannerCar(rehearsal)
    car.start('-p', 'estimation:=false', '-p', 'method:=last_20_minutes')
    # 30 min to a fast charger.
    car.send_route(segment_duration=[STEP_S] * STEPS, cabin_heating_power=[1600.0],
                   target_battery_temperature=12.0)
    assert is_off_for(Status.WAITING)(car.after_state(START_NS + NS_PER_S))
    plan = car.plans.latest
    assert plan.method == 'last_20_minutes'
    # The last 20 of 30 minutes.
    assert sum(plan.hvch_power) * STEP_S == pytest.approx(1200.0 * (7000.0 - 1600.0), rel=1e-3)
    command = car.after_state(START_NS + 605 * NS_PER_S)
    assert command.battery_heating_power > 5000.0 and command.reason == Status.HEATING

    described = rehearsal.call(DescribeParameters, '/planner/describe_parameters',
                               DescribeParameters.Request(names=['method'])).descriptors[0]
    assert 'a method of an installed package' in described.additional_constraints
    refused = car.set(method='last_25_minutes')
    assert not refused.successful
    assert refused.reason == ("method: 'last_25_minutes' is not one of value_function, optimal_switch, paper, "
                              'last_10_minutes, last_20_minutes, last_30_minutes, negative')
    assert car.set(method='negative').successful
    assert is_off_for(Status.INVALID_INPUT)(car.after_state(START_NS + 607 * NS_PER_S))
    assert car.plans.latest.explanation.startswith(
        'method negative of package broken-method 1.0: the answer is refused: -5400 W')
