# SPDX-License-Identifier: Apache-2.0
"""Synthetic cars under the planner: energy balance of a drive, figures of the vehicle files, and the command."""

from dataclasses import replace
import json
from types import SimpleNamespace

import numpy as np
import pytest

from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.identification import closed_loop, synthetic_car
from bev_preheat_studies.identification.__main__ import main
from bev_preheat_studies.identification.closed_loop import (
    closed_loop_summary,
    DATA_SHEET,
    draw_drive,
    drive_car,
    DriveResult,
    IDENTIFIED,
    TRUE,
    vehicle_with_truth,
)
from bev_preheat_studies.identification.synthetic_car import draw_car, draw_profile, DriveProfile, SyntheticPlant

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi'), pytest.mark.needs('scipy')]
SECONDS = 300
CAR = draw_car(np.random.default_rng(2), load_vehicle('small_car'))


def short_profile(generator):
    drawn = draw_profile(generator)
    return DriveProfile(drawn.speed_mps[:SECONDS], drawn.propulsion_w[:SECONDS], drawn.ambient_c, drawn.start_c)


@pytest.fixture
def short_drives(monkeypatch):
    monkeypatch.setattr(closed_loop, 'draw_profile', short_profile)


def test_a_drive_with_the_true_parameters_arrives_at_the_target_with_the_heat_that_it_takes(short_drives):
    vehicle = vehicle_with_truth(CAR, load_vehicle('small_car'))
    drive = draw_drive(CAR, np.random.default_rng(2))
    error_k, heater_wh, switch_ons = drive_car(CAR, drive, vehicle, Settings())
    # One step of the reading.
    assert abs(error_k) < 1.0
    assert 1 <= switch_ons <= 10
    # Only the heater makes the difference to the unheated drive, and only leakage takes part of its heat away.
    plant = SyntheticPlant(CAR, drive.profile.ambient_c, drive.profile.start_c, drive.soc)
    for propulsion_w, speed_mps in zip(drive.profile.propulsion_w.tolist(), drive.profile.speed_mps.tolist()):
        plant.advance(propulsion_w, 0.0, CAR.cabin_w + 500.0, speed_mps)
    stored_wh = CAR.heat_capacity_j_per_k * (drive.target_c + error_k - plant.temperature_c) / 3600.0
    assert stored_wh < CAR.heater_efficiency * heater_wh < 1.3 * stored_wh


# The command below drives the file of a data sheet, which is wrong in several ways, daily.
@pytest.mark.deep
def test_a_file_with_a_wrong_heat_capacity_arrives_warmer_than_the_truth(short_drives):
    vehicle = vehicle_with_truth(CAR, load_vehicle('small_car'))
    battery = replace(vehicle.battery, heat_capacity_j_per_k=1.5 * CAR.heat_capacity_j_per_k)
    wrong = replace(vehicle, battery=battery)
    drive, settings = draw_drive(CAR, np.random.default_rng(2)), Settings(estimation=False)
    true_k, true_wh, _ = drive_car(CAR, drive, vehicle, settings)
    wrong_k, wrong_wh, _ = drive_car(CAR, drive, wrong, settings)
    assert wrong_wh > true_wh
    assert wrong_k > true_k


def test_a_battery_at_rest_cools_as_an_exponential():
    resting = replace(CAR, heat_lag_s=1.0)
    plant = SyntheticPlant(resting, -10.0, 15.0, 0.8)
    for _ in range(3600):
        plant.advance(0.0, 0.0, 0.0, 0.0)
    capacity = resting.heat_capacity_j_per_k + synthetic_car.COOLANT_J_PER_K
    cooled_c = -10.0 + 25.0 * np.exp(-3600.0 * resting.leakage_w_per_k / capacity)
    assert plant.temperature_c == pytest.approx(cooled_c, abs=0.02)
    assert plant.soc == 0.8


# A drive that the battery carries: above, daily.
@pytest.mark.deep
def test_a_battery_too_small_for_a_drive_is_refused():
    plant = SyntheticPlant(CAR, -10.0, -10.0, 0.8)
    # U^2 / 4 R of about 370 V and 0.2 ohm is 170 kW.
    with pytest.raises(InvalidInput, match='the drive takes 300 kW'):
        plant.advance(300e3, 0.0, 0.0, 20.0)
    with pytest.raises(InvalidInput, match='none of 30 drives'):
        draw_drive(replace(CAR, capacity_ah=CAR.capacity_ah / 20.0), np.random.default_rng(0))


def test_the_figures_are_of_drives_with_all_files():
    def results(drive, errors_k, energies_wh):
        return [DriveResult(0, drive, file, 20.0, error_k, heater_wh, drive + 1)
                for file, error_k, heater_wh in zip((DATA_SHEET, IDENTIFIED, TRUE), errors_k, energies_wh)]

    found = [*results(0, (-2.0, 0.2, 0.1), (1100.0, 990.0, 1000.0)),
             *results(1, (1.0, 0.4, 0.0), (600.0, 500.0, 500.0)),
             # Interrupted before the last file.
             *results(2, (9.0, 9.0, 9.0), (9e9, 9e9, 1.0))[:2]]
    sheet, identified, true = closed_loop_summary(found)
    assert (sheet.file, identified.file, true.file) == (DATA_SHEET, IDENTIFIED, TRUE)
    assert sheet.drives == 2
    assert (sheet.worst_error_k, sheet.error_50_k) == (-2.0, -0.5)
    assert sheet.rms_error_k == pytest.approx(np.sqrt(2.5))
    assert sheet.energy_50 == pytest.approx(0.15)
    assert identified.energy_50 == pytest.approx(-0.005)
    assert (true.energy_50, true.energy_95, true.mean_switch_ons, true.most_switch_ons) == (0.0, 0.0, 1.5, 2)


def test_the_command_drives_each_file_on_the_same_drive(short_drives, monkeypatch, tmp_path, capfd):
    monkeypatch.setattr(closed_loop, 'record_car', lambda *arguments: [])
    # The identified file is known: the data sheet's.
    monkeypatch.setattr('bev_preheat.identification.identify.identify',
                        lambda vehicle, trips, name: SimpleNamespace(vehicle=vehicle))
    path = tmp_path / 'drives.json'
    assert main(['--closed-loop', '--cars', '1', '--first', '2', '--drives', '1', '--json', str(path)]) == 0
    written = json.loads(path.read_text())
    sheet, identified, true = written['results']
    assert written['complete']
    assert {**identified, 'file': DATA_SHEET} == sheet
    assert true['heater_wh'] != sheet['heater_wh']
    assert '1 drives of synthetic cars around small_car' in capfd.readouterr().out


@pytest.mark.parametrize('option', ['--cars', '--drives'])
def test_no_cars_and_no_drives_are_refused(option, capfd):
    assert main(['--closed-loop', option, '0']) == 2
    assert f'{option}: 0 is not allowed' in capfd.readouterr().err
