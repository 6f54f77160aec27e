# SPDX-License-Identifier: Apache-2.0
"""A program in C that plans with the core alone, as a control unit would: core.h, the library, no Python."""

from pathlib import Path
import shutil
import subprocess

import numpy as np
import pytest

from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.core_library import core_in_words
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, Table
from bev_preheat.vehicle.description import Battery, Defaults, Drivetrain, Hvch, Leakage, Vehicle

INCLUDE = Path(__file__).parents[2] / 'core' / 'include'
STEPS = 48
PROGRAM = r"""
#include <stdio.h>
#include "bev_preheat_core/core.h"

#define STEPS 48

int main(void) {
  static const double any[1] = {0.0}, least_w[1] = {-90e3}, most_w[1] = {120e3};
  const bev_curve voltage = {BEV_POLYNOMIAL, 0, 0, 0, {355.0, 72.0, -11.0, 6.0}, {0.0}, 0, 0, 0};
  const bev_curve resistance = {BEV_INVERSE_TEMPERATURE, 0, 0, 0, {3.4, 38.0}, {0.0}, 0, 0, 0};
  const bev_curve charge = {BEV_TABLE, 0, 1, 1, {0.0}, {0.0}, any, any, least_w};
  const bev_curve discharge = {BEV_TABLE, 0, 1, 1, {0.0}, {0.0}, any, any, most_w};
  const bev_vehicle vehicle = {150.0, 310e3, -30.0, 45.0, 65.0, 0.9, 0.16, 0.0, 0.0, 0.0, 0.0,
                               voltage, resistance, charge, discharge};
  double time_s[STEPS + 1], duration_s[STEPS], power_w[STEPS], variance_w2[STEPS], heat_w[STEPS];
  double leakage[STEPS], limit_w[STEPS], propulsion_w[STEPS], drivetrain_w[STEPS], ambient_c[STEPS];
  double memory[BEV_SWITCH_MEMORY(STEPS)], soc[STEPS + 1], temperature_c[STEPS + 1], heater_w[STEPS];
  bev_switch_plan plan;
  time_s[0] = 0.0;
  for (int k = 0; k < STEPS; k++) {
    duration_s[k] = 60.0;
    time_s[k + 1] = time_s[k] + 60.0;
    propulsion_w[k] = 9e3 + 500.0 * (k % 5);
    variance_w2[k] = 0.0;
    power_w[k] = propulsion_w[k] + 1200.0 + 400.0;
    leakage[k] = 21.0 + 1.5 * 20.0;
    ambient_c[k] = -8.0;
    drivetrain_w[k] = 0.16 * propulsion_w[k];
    heat_w[k] = leakage[k] * ambient_c[k] + drivetrain_w[k];
    limit_w[k] = 6000.0 - 1200.0;
  }
  const bev_trip trip = {STEPS, time_s, duration_s, power_w, variance_w2, heat_w, leakage, limit_w,
                         propulsion_w, drivetrain_w, ambient_c, NULL};
  const bev_status checked = bev_check_vehicle(&vehicle);
  const bev_status status = bev_plan_switch(&vehicle, &trip, 0.83, -5.0, 16.0, 1, memory,
                                            soc, temperature_c, heater_w, &plan);
  printf("%d %d %.17g %.17g %.17g %.17g %.17g\n", (int)checked, (int)status,
         plan.switching_instant_s, temperature_c[STEPS], soc[STEPS], plan.energy_wh.hvch_electric,
         plan.energy_wh.battery_total);
  return 0;
}
"""


def same_plan_in_python():
    vehicle = Vehicle(
        'alone', Battery(
            150.0, 310e3, PolynomialVoltage((355.0, 72.0, -11.0, 6.0)), InverseTemperatureResistance(3.4, 38.0),
            Table((0.0,), (0.0,), ((120e3,),)), Table((0.0,), (0.0,), ((-90e3,),)),
            Leakage(21.0, 1.5), (0.0, 1.0), (-30.0, 45.0)),
        Drivetrain(0.8, 0.8, 150e3), Hvch(6000.0, 0.9), Defaults(1200.0, 400.0, 16.0))
    route = make_route({
        'duration_s': [60.0], 'speed_mps': [20.0], 'propulsion_power_w': 9e3 + 500.0 * (np.arange(STEPS) % 5),
        'ambient_temperature_c': [-8.0]}, vehicle.defaults)
    return plan_preheating(vehicle, route, BatteryState(-5.0, 0.83), Goal(16.0))


def test_a_program_in_c_plans_what_the_planner_does(tmp_path):
    source, program = tmp_path / 'alone.c', tmp_path / 'alone'
    source.write_text(PROGRAM, encoding='utf-8')
    compiler = shutil.which('cc') or shutil.which('gcc') or shutil.which('clang')
    assert compiler, 'the core was built, so there is a compiler'
    subprocess.run([compiler, '-std=c99', '-Wall', '-Wextra', '-Wpedantic', '-Werror', f'-I{INCLUDE}', str(source),
                    core_in_words().removeprefix('used: '), '-o', str(program)], check=True)
    checked, status, *figures = subprocess.run(
        [str(program)], check=True, capture_output=True, text=True).stdout.split()
    plan = same_plan_in_python()
    assert (checked, status) == ('0', '0')
    assert 0.0 < plan.heating_start_s < plan.arrival_time_s
    # The share of the losses that heats the battery, 0.8 times 0.2, is rounded in Python.
    assert [float(each) for each in figures] == pytest.approx([
        plan.heating_start_s, plan.arrival_temperature_c, plan.arrival_soc, plan.energy_wh.hvch_electric,
        plan.energy_wh.battery_total], rel=1e-9)
