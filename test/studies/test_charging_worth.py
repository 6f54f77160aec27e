# SPDX-License-Identifier: Apache-2.0
"""The table of the worth of heating on the reference trip: its cases arrive as stated."""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.charging.target_worth import TargetWorth
from bev_preheat.charging.worth import Worth
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.charging_worth import cases, main, row, start_soc, winter_cases, winter_row, WorthCase


def test_all_cases_of_the_page():
    assert {(case.charger_w, case.ambient_c, case.arrival_soc) for case in cases()} == {
        (charger_w, ambient_c, soc) for charger_w in (150e3, 50e3) for ambient_c in (-7.0, -15.0)
        for soc in (0.1, 0.2)}


def test_the_drive_starts_with_what_lets_it_arrive_as_the_case_says():
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    route = replace(route, ambient_temperature_c=np.full(len(route), -15.0))
    soc = start_soc(vehicle, route, Goal(25.0), WorthCase(150e3, -15.0, 0.2))
    assert plan_unheated(vehicle, route, BatteryState(-15.0, soc),
                         Goal(25.0)).arrival_soc == pytest.approx(0.2, abs=2e-6)


def test_a_row_compares_with_no_heating():
    without = TargetWorth(3.0, 3.0, 0.2, 0.0, 2400.0, 40e3, 30.0)
    best = TargetWorth(16.04, 16.0, 0.18, 900.0, 1800.0, 41e3, 29.25)
    fixed = TargetWorth(25.0, 25.0, 0.17, 1900.0, 1740.0, 42e3, 30.5)
    assert row(WorthCase(50e3, -7.0, 0.1), Worth((), best, without, fixed, 2.345, '', None, None)) == (
        '50 kW', '-7', '10 %', '3.0', '40:00 min', '29:00 min', '+0.50', '16.0', '30:00 min', '-0.75',
        '2.35')
    assert row(WorthCase(50e3, -7.0, 0.1), Worth((), without, without, fixed, None, '', None, None))[7:] == (
        'none', '40:00 min', '+0.00', '–')


def test_all_cases_of_the_winter_table():
    found = winter_cases()
    assert len(found) == 20 and {case.arrival_soc for case in found} == {0.1}
    assert {(case.charger_w, case.ambient_c) for case in found} == {
        (1e3 * kw, ambient_c) for kw in (50, 100, 150, 250) for ambient_c in (-20, -15, -10, -5, 0)}


def test_a_row_of_the_winter_table_compares_with_none_and_with_the_fixed_target():
    without = TargetWorth(3.0, 3.0, 0.2, 0.0, 2400.0, 40e3, 30.0)
    best = TargetWorth(16.04, 16.0, 0.18, 900.0, 1800.0, 41e3, 29.25)
    fixed = TargetWorth(25.0, 25.0, 0.17, 1900.0, 1740.0, 42e3, 30.5)
    case = WorthCase(50e3, -10.0, 0.1)
    assert winter_row(case, Worth((), best, without, fixed, 2.345, '', None, None)) == (
        '-10', '50 kW', '16.0', '40.0', '29.0', '30.0', '+10.0', '+1.00', '-0.75', '-1.0', '-1.00', '-1.25')
    # 40 s more than with the fixed target, and no zero with a minus.
    assert winter_row(case, Worth((), without, without, replace(
        fixed, charging_time_s=2400.4, cost=30.001), None, '', None, None))[2:] == (
            'none', '40.0', '40.0', '40.0', '+0.0', '+0.00', '+0.00', '+0.0', '-2.00', '+0.00')


def test_an_unknown_option_is_refused_in_a_line(capsys):
    with pytest.raises(SystemExit) as end:
        main(['--wintr'])
    assert end.value.code == 2
    errors = capsys.readouterr().err
    assert 'did you mean --winter?' in errors and errors.count('\n') == 1
