# SPDX-License-Identifier: Apache-2.0
"""`preheat identify --state-file`: values learned on line become a vehicle file."""

import math

import numpy as np
import pytest
import yaml

from bev_preheat.estimation.prior import Learned, prior_factor_covariance
from bev_preheat.estimation.state_file import save_state
from bev_preheat.numerics import FLOATS
from bev_preheat.vehicle import load_vehicle, vehicle_contents, vehicle_fingerprint

# Heat capacity, leakage, resistance, heater efficiency, propulsion, other sources' heat.
FACTORS = (1.1, 0.8, 1.2, 0.95, 1.0, 1.0)


@pytest.fixture
def state_file(tmp_path):
    path = tmp_path / 'state.json'
    covariance = 0.25 * prior_factor_covariance()
    save_state(path, vehicle_fingerprint(vehicle_contents('small_car')),
               Learned(np.log(np.array(FACTORS)), covariance))
    return path


def test_each_value_is_the_file_s_times_its_factor(state_file, tmp_path, said):
    output = tmp_path / 'my.yaml'
    status, printed, _ = said('identify', '--state-file', state_file, '--vehicle', 'small_car', '--output', output)
    assert status == 0
    start, car = load_vehicle('small_car'), load_vehicle(output)
    assert car.battery.heat_capacity_j_per_k == pytest.approx(1.1 * start.battery.heat_capacity_j_per_k, rel=1e-4)
    assert car.battery.leakage.gamma_0_w_per_k == pytest.approx(
        0.8 * start.battery.leakage.gamma_0_w_per_k, rel=1e-4)
    assert car.battery.leakage.gamma_v_w_per_k_per_mps == pytest.approx(
        0.8 * start.battery.leakage.gamma_v_w_per_k_per_mps, rel=1e-4)
    assert car.hvch.efficiency == pytest.approx(0.95 * start.hvch.efficiency, rel=1e-4)
    for soc, at_c in ((0.2, -10.0), (0.5, 0.0), (1.0, 25.0)):
        assert car.battery.resistance.function(FLOATS)(soc, at_c) == pytest.approx(
            1.2 * start.battery.resistance.function(FLOATS)(soc, at_c), rel=1e-3)
    # Everything else is the start file's.
    mine, theirs = yaml.safe_load(output.read_text()), yaml.safe_load(vehicle_contents('small_car'))
    for key in ('defaults', 'charging', 'road_load', 'drivetrain'):
        assert mine[key] == theirs[key]
    assert mine['battery']['open_circuit_voltage'] == theirs['battery']['open_circuit_voltage']
    # Half the prior's deviation, and 0.01 for the time since.
    assert {name: own for name, own in vars(car.uncertainty).items() if own} == pytest.approx({
        name: math.hypot(0.5 * prior, 0.01) for name, prior in (
            ('heat_capacity', 0.058), ('leakage', 0.32), ('resistance', 0.115), ('heater_efficiency', 0.058))},
        rel=5e-3)
    # Half the prior's standard deviation of 0.058, and 0.01 for the time since, times 1.645.
    low = 1.1 * math.exp(-1.6449 * math.hypot(0.029, 0.01))
    assert f'{low:.4g}' in printed


# Also where the HVCH cannot be as efficient as it seemed: 1.15 times 0.9.
@pytest.mark.parametrize('of_heater', [0.95, 1.15])
def test_other_heat_sources_give_what_they_were_seen_to_give(of_heater, tmp_path, said):
    start, output = load_vehicle('heat_pump_car'), tmp_path / 'my.yaml'
    save_state(tmp_path / 'state.json', vehicle_fingerprint(vehicle_contents('heat_pump_car')),
               Learned(np.log([1.0, 1.0, 1.0, of_heater, 1.0, 0.8]), 0.25 * prior_factor_covariance()))
    status, printed, _ = said(
        'identify', '--state-file', 'state.json', '--vehicle', 'heat_pump_car', '--output', output)
    assert status == 0 and 'source heat' in printed
    assert "0.8 times START's, 90 % interval 0.7356 ... 0.87, beside hvch.efficiency\nheat_s" in output.read_text()
    car = load_vehicle(output)
    assert car.hvch.efficiency == pytest.approx(min(of_heater * 0.9, 1.0))
    for mine, theirs in zip(car.heat_sources, start.heat_sources):
        # Heat and cold have the heater's factor, too.
        factor = of_heater * 0.8
        for ambient_c, temperature_c in ((-17.0, 3.0), (5.0, 30.0), (30.0, 35.0)):
            heat, told = (vehicle.hvch.efficiency * source.hvch_watts.function(FLOATS)(ambient_c, temperature_c)
                          for vehicle, source in ((car, mine), (start, theirs)))
            assert heat == pytest.approx(factor * told, rel=1e-4)
    # Half the prior's deviation of 0.1, and 0.01 for the time since.
    assert car.uncertainty.source_heat == pytest.approx(math.hypot(0.05, 0.01), rel=5e-3)


def test_a_factor_that_no_drive_told_keeps_the_uncertainty_of_the_start_file(tmp_path, said):
    start, output = tmp_path / 'start.yaml', tmp_path / 'my.yaml'
    start.write_bytes(vehicle_contents('small_car') + b'\nuncertainty: {leakage: 0.09, resistance: 0.07}\n')
    scale = np.diag([0.2, 1.0, 0.2, 1.0, 1.0, 1.0])
    save_state(tmp_path / 'state.json', vehicle_fingerprint(start.read_bytes()),
               Learned(np.zeros(6), scale @ prior_factor_covariance() @ scale))
    assert said('identify', '--state-file', 'state.json', '--vehicle', start, '--output', output)[0] == 0
    told = load_vehicle(output).uncertainty
    assert (told.heat_capacity, told.resistance) == pytest.approx(
        (math.hypot(0.2 * 0.058, 0.01), math.hypot(0.2 * 0.115, 0.01)), rel=5e-3)
    assert (told.leakage, told.heater_efficiency) == (0.09, None)


@pytest.mark.parametrize('words, line', [
    ('--state-file state.json --vehicle reference',
     'nothing learned about this vehicle file; name the file with which the planner ran'),
    ('--state-file state.json --vehicle small_car drive.csv', '--state-file: not allowed with logs'),
    ('--state-file state.json --vehicle small_car --repair', '--state-file: not allowed with --repair'),
    ('--state-file nowhere.json --vehicle small_car', 'nowhere.json: no such file'),
    ('--state-file other.json --vehicle small_car', 'other.json: is not a state file of this planner'),
    ('--vehicle small_car', 'LOG: missing')])
@pytest.mark.usefixtures('state_file')
def test_another_car_logs_beside_it_and_what_is_no_state_file_are_refused(tmp_path, refused, words, line):
    (tmp_path / 'other.json').write_text('{"mine": 1}')
    assert line in refused('identify', '--output', 'x.yaml', *words.split())
