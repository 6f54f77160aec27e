# SPDX-License-Identifier: Apache-2.0
"""The score of a drive: switching counted along the commands, energies and error those of the car."""

from math import isnan

import pytest

from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import make_route
from bev_preheat.simulation.drive_score import instants, score_of, Switching
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.vehicle import load_vehicle

TARGET_C = 14.0


@pytest.mark.parametrize('powers_w, count, first_s', [
    ([], 0, None), ([0.0, 0.0], 0, None), ([5.0, 5.0, 0.0], 1, 0.0), ([0.0, 1.0, 2.0, 0.0, 3.0], 2, 10.0)])
def test_rises_from_0_are_counted(powers_w, count, first_s):
    switching = Switching()
    for number, power_w in enumerate(powers_w):
        switching.note(10.0 * number, power_w)
    assert (switching.switch_ons, switching.first_switch_on_s) == (count, first_s)


def test_the_score_is_that_of_the_commands_that_the_car_got():
    vehicle = load_vehicle('reference')
    route = make_route({'duration_s': [30.0] * 20, 'speed_mps': [15.0], 'propulsion_power_w': [15e3],
                        'ambient_temperature_c': [-5.0]}, vehicle.defaults)
    car = ImperfectCar(vehicle, route, BatteryState(8.0, 0.8), Goal(TARGET_C), Imperfections(), 0)
    supervisor, switching, energy_wh, before = Supervisor(vehicle, Settings()), Switching(), 0.0, None
    for _, instant in instants(car, supervisor):
        if instant is None:
            continue
        assert isnan(instant.measured_c) or instant.measured_c == pytest.approx(instant.true_c, abs=0.3)
        switching.note(instant.time_s, instant.command_w)
        if before is not None:
            energy_wh += before.command_w * (instant.time_s - before.time_s) / 3600.0
        before = instant
    score = score_of(car.plant, TARGET_C, switching)
    assert score.switch_ons >= 1 and score.first_switch_on_s < 600.0 and not score.ran_empty
    # The command of an instant is in effect from then on.
    assert score.heating_energy_wh == pytest.approx(energy_wh, rel=0.02)
    assert score.arrival_error_k == car.plant.temperature_c - TARGET_C and abs(score.arrival_error_k) < 0.5
    assert 0.0 < score.heating_energy_wh < score.battery_energy_wh
