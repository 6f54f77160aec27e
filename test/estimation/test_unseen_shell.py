# SPDX-License-Identifier: Apache-2.0
"""The estimator of a car with a shell that its file omits: the core, with the sensor, follows slowly."""

from math import sqrt

from driven_car import (
    AMBIENT_C,
    AUXILIARY_W,
    CABIN_W,
    Commands,
    observed,
    PROPULSION_W,
    SPEED_MPS,
    START_NS,
    VEHICLE,
)
import numpy as np
import pytest

from bev_preheat.control.inputs import Measurement
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.numerics import FLOATS, NS_PER_S
from bev_preheat.planning.situation import BatteryState

pytestmark = pytest.mark.costly

SHARE = 0.25
HEATED = Commands(((300, 2100),))


def two_masses(conductance_w_per_k, seconds, seed, effect=0.94):
    """
    Yield (Measurement, mean temperature [deg C]) each second: heater, drivetrain and air are at the shell.

    `effect` is the true efficiency of the heater over the file's.
    """
    battery, drawn = VEHICLE.battery, np.random.default_rng(seed)
    voltage_v, resistance_ohm = (curve.function(FLOATS) for curve in (
        battery.open_circuit_voltage, battery.resistance))
    leakage_w_per_k = battery.leakage.coefficient_w_per_k(SPEED_MPS)
    heat_capacity_j_per_k = battery.heat_capacity_j_per_k
    core_c = shell_c = -6.0
    soc, traffic_w = 0.8, 0.0
    for second in range(seconds):
        heater_w = HEATED.at_w(second)
        traffic_w += -traffic_w / 30.0 + 2000.0 * sqrt(2 / 30.0) * drawn.standard_normal()
        power_w = PROPULSION_W + traffic_w + CABIN_W + AUXILIARY_W + heater_w
        open_v, resistance = voltage_v(soc, core_c), resistance_ohm(soc, core_c)
        current_a = (open_v - sqrt(open_v**2 - 4.0 * resistance * power_w)) / (2.0 * resistance)
        passed_w = conductance_w_per_k * (shell_c - core_c)
        outer_w = (effect * VEHICLE.hvch.efficiency * heater_w + leakage_w_per_k * (AMBIENT_C - shell_c)
                   + VEHICLE.drivetrain.heat_to_battery_w(abs(PROPULSION_W + traffic_w)))
        shell_c += (outer_w - passed_w) / (SHARE * heat_capacity_j_per_k)
        core_c += (passed_w + resistance * current_a**2) / ((1.0 - SHARE) * heat_capacity_j_per_k)
        soc -= current_a / (3600.0 * battery.capacity_ah)
        reading_c = 0.5 * round((core_c + 0.2 * drawn.standard_normal()) / 0.5)
        yield Measurement(
            BatteryState(reading_c, float(round(soc, 3))), START_NS + (second + 1) * NS_PER_S, current_a,
            open_v - resistance * current_a), SHARE * shell_c + (1.0 - SHARE) * core_c


@pytest.mark.parametrize('conductance_w_per_k', [55.0, 130.0, 250.0])
@pytest.mark.parametrize('seed', range(2))
def test_heat_that_a_slow_core_misses_accuses_no_heater_and_is_not_believed_to_come(conductance_w_per_k, seed):
    estimator, errors_k = Estimator.of(VEHICLE), []
    for second, (measurement, mean_c) in enumerate(two_masses(conductance_w_per_k, 2100, seed)):
        estimator = observed(estimator, measurement, HEATED)
        estimate = estimator.estimate
        assert estimate.heater.heater is Heater.ANSWERS, second
        if second > 1500:
            errors_k.append(estimate.temperature_c + estimate.under_way_k - mean_c)
    assert np.sqrt(np.mean(np.square(errors_k))) < 0.7
