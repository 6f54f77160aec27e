# SPDX-License-Identifier: Apache-2.0
"""The public interface: its names, its results beside those of the commands, and its errors."""

import json
from pathlib import Path
import re
import subprocess
import sys

import numpy as np
import pytest

import bev_preheat as bp
from bev_preheat.commands.main import main

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'reference' / 'python.md'
STATE = bp.BatteryState(-7.0, 0.9)
SITUATION = ['--vehicle', 'reference', '--route', 'reference', '--temperature', '-7', '--soc', '0.9']


def json_of(capsys, *words):
    assert main([*words, '--json', '-']) == 0
    return json.loads(capsys.readouterr().out)


def without_times(result):
    return {key: value for key, value in result.items() if key not in (
        'planning_time_s', 'solve_time_s', 'route_made_for', 'vehicle_assumed', 'sensitivity')}


def test_each_public_name_has_a_docstring_and_is_in_the_api_reference():
    directives = re.findall(r'^\.\. auto(function|class|exception):: (\w+)$', PAGE.read_text(), re.MULTILINE)
    assert sorted(name for _, name in directives) == sorted(bp.__all__)
    for kind, name in directives:
        public = getattr(bp, name)
        assert public.__doc__, name
        assert kind == ('function' if not isinstance(public, type) else
                        'exception' if issubclass(public, Exception) else 'class'), name


SHEET = {'chemistry': 'nmc', 'charging_power_kw': 135.0, 'usable_energy_kwh': 77.0, 'gross_energy_kwh': 82.0,
         'battery_mass_kg': 493.0, 'cells_in_series': 96, 'vehicle_mass_kg': 2200.0}


@pytest.mark.parametrize('wrong, message', [
    ({'gros_energy_kwh': 80.0},
     "'gros_energy_kwh' is not a figure of a data sheet; did you mean gross_energy_kwh?"),
    ({'charging_power_kw': '135'}, "charging_power_kw: '135' is not a number"),
    ({'charging_power_kw': 135e3},
     'charging_power_kw: 135000 kW is implausible; it must be 5 ... 2000 kW; 135000 W would be 135 kW'),
    ({'battery_mass_kg': float('nan')}, "battery_mass_kg: 'nan' is not a number"),
    ({'cells_in_series': 96.5}, 'cells_in_series: 96.5 is not a whole number'),
    ({'chemistry': 'lead'}, "chemistry: 'lead' is not one of nmc, lfp"),
    ({'cells_in_series': None}, 'nominal_voltage_v or cells_in_series is needed')])
def test_a_wrong_data_sheet_is_refused(wrong, message):
    with pytest.raises(bp.InvalidInput, match=f'^{re.escape(message)}$'):
        bp.make_vehicle('own', **{**SHEET, **wrong})


def test_powers_of_a_plan_close_the_balance_of_energy(vehicle):
    # Over the pass all limits are met: the battery's on the descent, the heater's on the climb.
    pass_route = bp.load_route('alpine_pass', vehicle)
    plan = bp.plan(vehicle, pass_route, bp.BatteryState(-10.0, 0.9))
    duration_s = np.diff(plan.time_s)
    assert float(plan.battery_power_w @ duration_s) / 3600.0 == pytest.approx(plan.energy_wh['battery_total'])
    assert plan.energy_wh == plan.to_dict()['energy_wh']
    # Power at the terminals by hand; the Joule heat is the rest.
    terminal_w = (pass_route.propulsion_power_w + pass_route.cabin_heating_power_w + pass_route.auxiliary_power_w
                  + plan.hvch_battery_power_w + plan.friction_brake_power_w)
    joule_wh = float((plan.battery_power_w - terminal_w) @ duration_s) / 3600.0
    assert joule_wh == pytest.approx(plan.energy_wh['joule'], rel=1e-6)
    assert (plan.hvch_battery_power_w <= plan.heater_limit_w + 1e-6).all()
    # The battery is warmed just enough for the descent: the charge limit is touched at one end of a step.
    margin_w = plan.battery_power_w - np.maximum(plan.charge_limit_w[:-1], plan.charge_limit_w[1:])
    assert margin_w.min() == pytest.approx(0.0, abs=20.0)
    assert (plan.battery_power_w <= plan.discharge_limit_w[:-1]).all()


def test_a_plan_is_that_of_the_command(vehicle, route, capsys):
    plan = bp.plan(vehicle, route, STATE)
    assert without_times(plan.to_dict()) == without_times(json_of(capsys, 'plan', *SITUATION))
    assert plan.status == 'WAITING' and plan.arrival_temperature_c == pytest.approx(25.0, abs=1e-3)
    assert len(plan.time_s) == len(plan.soc) == len(plan.hvch_battery_power_w) + 1
    spent_wh = float((plan.hvch_battery_power_w * np.diff(plan.time_s)).sum()) / 3600.0
    assert plan.heating_energy_wh == pytest.approx(spent_wh, rel=1e-6)


def test_worth_is_that_of_the_command(worth, capsys):
    shown = json_of(capsys, 'worth', *SITUATION, '--charger-power', '150000', '--departure-soc', '0.8')
    assert (worth.best_target_c, worth.verdict) == (shown['best']['target_c'], shown['verdict'])
    assert worth.to_dict()['targets'] == shown['targets']


def test_a_session_is_that_of_the_command(session, capsys):
    shown, = json_of(capsys, 'charge', '--vehicle', 'reference', '--arrival-temperature', '5', '--arrival-soc',
                     '0.2', '--ambient', '-7', '--charger-power', '150000', '--departure-soc', '0.8')['sessions']
    assert float(session.charging_power_w @ np.diff(session.time_s)) / 3600.0 == pytest.approx(
        session.to_dict()['energy_wh']['terminal'])
    assert session.soc[-1] == pytest.approx(0.8) and len(session.battery_temperature_c) == len(session.time_s)
    assert session.to_dict() == {key: value for key, value in shown.items() if key != 'name'}


@pytest.mark.needs('casadi')
def test_all_methods_beside_the_optimum(vehicle, route):
    # A module of the same room may have been imported before.
    import bev_preheat.nonlinear_program.solve  # noqa: F401
    compared = bp.compare(vehicle, route, STATE)
    assert tuple(compared.plans) == ('value_function', 'optimal_switch', 'paper')
    assert compared.above_optimum_wh['value_function'] == pytest.approx(0.0, abs=0.01)
    assert compared.above_optimum_wh['paper'] > 1.0
    assert compared.optimum.marginal_cost_wh_per_k > 0.0 and compared.optimum.infeasible == ()


@pytest.mark.needs('pandas')
def test_the_frame_of_a_session(session):
    frame = session.to_frame()
    assert frame.index[-1] == pytest.approx(session.charging_time_s)
    assert frame['soc'].iloc[0] == 0.2 and frame['soc'].iloc[-1] == pytest.approx(0.8, abs=1e-6)
    assert np.isnan(frame['charging_power_w'].iloc[-1]) and not frame.iloc[:-1].isna().to_numpy().any()
    with pytest.raises(KeyError):
        frame['power']


@pytest.mark.needs('pandas')
def test_the_frame_of_targets(worth):
    frame = worth.to_frame()
    assert frame['cost'].idxmin() == worth.best_target_c
    assert len(frame) == len(worth.to_dict()['targets']) and frame.index.is_unique


@pytest.mark.needs('pandas')
def test_the_frame_of_a_drive(drive):
    frame = drive.to_frame()
    assert len(frame.columns) == 5 and len(frame) == len(drive.time_s)
    assert frame['true_temperature_c'].iloc[-1] == pytest.approx(drive.arrival_temperature_c, abs=0.05)
    # The command's energy, with each command until the next one.
    spent_wh = float((frame['command_w'].to_numpy()[:-1] * np.diff(frame.index)).sum()) / 3600.0
    assert spent_wh == pytest.approx(drive.heating_energy_wh, rel=0.01)


@pytest.mark.needs('pandas', 'casadi')
def test_the_frames_of_a_comparison_and_an_optimum(vehicle, route):
    compared = bp.compare(vehicle, route, STATE, methods=['paper'])
    frame = compared.to_frame()
    assert list(frame.index) == ['paper', 'optimum']
    assert frame.loc['optimum', 'above_optimum_wh'] == 0.0
    assert frame.loc['paper', 'above_optimum_wh'] == pytest.approx(
        frame.loc['paper', 'battery_energy_wh'] - frame.loc['optimum', 'battery_energy_wh'])
    optimum = compared.optimum.to_frame()
    assert optimum['battery_temperature_c'].iloc[-1] == pytest.approx(25.0, abs=0.01)
    # A warm battery is not heated; the frame then has NaN as the start.
    warm = bp.compare(vehicle, route, bp.BatteryState(30.0, 0.9), methods=['paper']).to_frame()
    assert warm['heating_start_s'].isna().all() and (warm['heating_energy_wh'] < 0.1).all()


def test_importing_loads_nothing_heavy():
    loaded = subprocess.run(
        [sys.executable, '-c', 'import sys, bev_preheat; print("numpy" in sys.modules, "yaml" in sys.modules)'],
        capture_output=True, text=True, check=True).stdout
    assert loaded.split() == ['False', 'False']
