# SPDX-License-Identifier: Apache-2.0
"""The table of values behind a plan, and its picture."""

import numpy as np
import pytest

from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.tunables import HEATING_PRICE, SWITCH_ON_WH
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.__main__ import main
from bev_preheat_studies.value_picture import value_table, worth_over_cost

VEHICLE = load_vehicle('reference')
ROUTE = load_route('alpine_pass', VEHICLE.defaults).resampled(120.0)
STATE, GOAL = BatteryState(-10.0, 0.9), Goal(25.0)
SITUATION = ['--vehicle', 'reference', '--temperature', '-10', '--soc', '0.9']


@pytest.fixture(scope='module')
def table():
    return value_table(make_trip(VEHICLE, ROUTE), STATE, GOAL)


@pytest.fixture(scope='module')
def plan():
    return plan_preheating(VEHICLE, ROUTE, STATE, GOAL)


def test_the_value_at_the_start_is_the_cost_of_the_plan(table, plan):
    started_wh = np.interp(STATE.temperature_c, table.temperature_c, table.values_j[0]) / JOULES_PER_WH
    switched_on_wh = SWITCH_ON_WH * len(plan.intervals)
    heating_wh = HEATING_PRICE * plan.energy_wh.hvch_electric
    # The table is coarser than the last pass.
    assert started_wh == pytest.approx(plan.energy_wh.battery_total + switched_on_wh + heating_wh, abs=10.0)


def test_the_plan_heats_where_a_kelvin_is_worth_its_cost(table, plan):
    worth = worth_over_cost(table)[1:]
    column = np.searchsorted(table.temperature_c, plan.battery_temperature_c[1:]) - 1
    on_path = worth[np.arange(len(worth)), column]
    # While the drive regenerates, part of the heat is free.
    is_driven = ROUTE.propulsion_power_w > 0.0
    share = plan.hvch_battery_power_w / make_trip(VEHICLE, ROUTE).heater_limit_w
    assert (on_path[is_driven & (share > 0.99)] > 0.95).all()
    assert (on_path[is_driven & (share == 0.0)] < 1.05).all()


def test_the_command_makes_a_picture(tmp_path, capsys):
    path = tmp_path / 'value.png'
    route = tmp_path / 'short.csv'
    route.write_text('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n' + '60,20,15000,0\n' * 10)
    assert main(['value_picture', *SITUATION, '--route', str(route), '--plot', str(path)]) == 0
    assert path.read_bytes().startswith(b'\x89PNG')
    assert main(['value_picture', *SITUATION, '--route', str(route), '--plot', str(tmp_path / 'value.txt')]) == 2
    assert '--plot' in capsys.readouterr().err


def test_a_trip_that_the_charge_does_not_carry_has_no_picture(tmp_path, capsys):
    arguments = ['value_picture', '--vehicle', 'reference', '--temperature', '-10', '--soc', '0.02',
                 '--route', 'alpine_pass']
    assert main([*arguments, '--plot', str(tmp_path / 'value.png')]) == 1
    assert 'the charge does not carry the trip' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
