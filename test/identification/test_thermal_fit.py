# SPDX-License-Identifier: Apache-2.0
"""Readings as intervals, the thermal model's courses and slopes, and the voltage's fit, against closed forms."""

from dataclasses import replace
import math

import numpy as np
import pytest
from recorded import night, recording

from bev_preheat.identification.prediction import predict
from bev_preheat.identification.trips import trip_of
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage
from bev_preheat.vehicle.description import Leakage

pytestmark = [pytest.mark.needs('casadi'), pytest.mark.needs('scipy')]
REFERENCE = load_vehicle('small_car')
VEHICLE = replace(REFERENCE, battery=replace(
    REFERENCE.battery, heat_capacity_j_per_k=2e5, leakage=Leakage(5.0, 0.5), capacity_ah=100.0,
    resistance=InverseTemperatureResistance(2.0, 15.0), open_circuit_voltage=PolynomialVoltage((380.0,))))


@pytest.mark.parametrize('resolution_k', [0.0, 0.5, 1.0])
def test_half_the_square_of_a_residual_is_the_likelihood_of_the_interval(resolution_k):
    from bev_preheat.identification.readings import interval_residuals, NOISE_K
    model_c = np.array([4.1, 4.8, 5.0, 5.4, 5.7])
    residual, slope = interval_residuals(model_c, np.full(5, 5.0), resolution_k)
    ahead, _ = interval_residuals(model_c + 1e-6, np.full(5, 5.0), resolution_k)
    if resolution_k:
        def share(off_k):
            # Midpoint rule.
            points = resolution_k * ((np.arange(4000) + 0.5) / 4000.0 - 0.5)
            return np.mean(np.exp(-0.5 * ((points - off_k) / NOISE_K)**2))
        expected = [math.copysign(math.sqrt(2.0 * math.log(share(0.0) / share(off))), off) if off else 0.0
                    for off in (model_c - 5.0).tolist()]
    else:
        expected = (model_c - 5.0) / NOISE_K
    kept = np.abs(expected) < 2.4
    assert residual[kept] == pytest.approx(np.array(expected)[kept], abs=2e-5)
    assert slope == pytest.approx((ahead - residual) / 1e-6, rel=1e-3, abs=1e-3)


def test_a_spike_pulls_linearly_and_stays_finite():
    from bev_preheat.identification.readings import interval_residuals
    residual, slope = interval_residuals(np.array([-1e4, 60.0, 1e4]), np.full(3, 5.0), 1.0)
    assert np.isfinite(residual).all() and np.isfinite(slope).all()
    assert residual[0] < 0.0 < residual[1] <= residual[2]


def test_a_night_cools_as_the_exponential_does():
    time_constant_s = 2e5 / 5.0
    trip = trip_of(night(time_constant_s=time_constant_s), VEHICLE)
    predicted = predict(VEHICLE, trip)
    left = math.exp(-len(trip) / time_constant_s)
    assert predicted.reading_c[-1] == pytest.approx(-5.0 + 20.0 * left, abs=1e-3)


def test_slopes_are_those_of_finite_differences():
    from bev_preheat.identification.curves import KNOTS_C
    from bev_preheat.identification.electrical import fit_electrical
    from bev_preheat.identification.parameters import NAMES, parameters_of
    from bev_preheat.identification.thermal import course_of, ThermalModel
    trip = trip_of(recording(), VEHICLE)
    trip = replace(trip, heater_w=np.where(np.arange(len(trip)) < 600, 2000.0, 0.0),
                   power_w=trip.power_w - np.where(np.arange(len(trip)) < 600, 2000.0, 0.0))
    course, electrical = course_of(trip, VEHICLE), fit_electrical(VEHICLE, [])
    theta = np.array([parameters_of(VEHICLE)[name].prior for name in NAMES] + [0.05] * len(KNOTS_C))
    for has_shell in (False, True):
        model = ThermalModel(VEHICLE, has_shell)
        readings_c, slopes = model.course(course, theta, 5.0, electrical)
        for at in range(len(theta)):
            moved = theta.copy()
            moved[at] += 1e-5
            ahead_c, _ = model.course(course, moved, 5.0, electrical)
            assert (ahead_c - readings_c) / 1e-5 == pytest.approx(slopes[:, at], rel=2e-3, abs=2e-3)
        warmer_c, _ = model.course(course, theta, 5.0 + 1e-5, electrical)
        assert (warmer_c - readings_c) / 1e-5 == pytest.approx(slopes[:, -1], rel=1e-3, abs=1e-4)


def test_the_fits_model_agrees_with_plans_where_power_is_steady():
    from bev_preheat.identification.curves import KNOTS_C
    from bev_preheat.identification.electrical import fit_electrical
    from bev_preheat.identification.parameters import NAMES, parameters_of
    from bev_preheat.identification.thermal import course_of, ThermalModel
    trip = trip_of(recording(current_a=lambda a: np.full_like(a, 60.0), voltage_v=lambda v: np.full_like(v,
                                                                                                         374.0)),
                   VEHICLE)
    parameters = parameters_of(VEHICLE)
    theta = np.array([parameters[name].fixed for name in NAMES] + [0.0] * len(KNOTS_C))
    readings_c, _ = ThermalModel(VEHICLE).course(
        course_of(trip, VEHICLE), theta, trip.start_c, fit_electrical(VEHICLE, []))
    assert readings_c[-1] == pytest.approx(predict(VEHICLE, trip).reading_c[-1], abs=0.02)


def test_resistance_and_capacity_come_from_voltage_and_current():
    from bev_preheat.identification.curves import CorrectedResistance
    from bev_preheat.identification.electrical import fit_electrical
    from bev_preheat.numerics.arithmetic import ARRAYS
    # 0.1 ohm where START has 2/(7.5 + 15); 100 Ah where START has 90; a lasting error of 3 V.
    start = replace(VEHICLE, battery=replace(VEHICLE.battery, capacity_ah=90.0))
    trips = [trip_of(recording(str(number), 1200 + number, voltage_v=lambda v: v - 3.0),
                     start) for number in range(4)]
    found = fit_electrical(start, trips)
    ohm = CorrectedResistance(start.battery.resistance, found.log_factors).function(ARRAYS)(
        np.array([0.7]), np.array([7.5]))
    assert ohm[0] == pytest.approx(0.1, rel=0.01)
    assert found.capacity_ah == pytest.approx(100.0, rel=0.01)
    assert found.used == ('0', '1', '2', '3')


def test_polarisation_is_part_of_the_heat_but_not_of_the_ohmic_resistance():
    from bev_preheat.identification.electrical import fit_electrical
    follows, current_a = [], recording(seconds=2400).signals['current_a'].value
    state = 0.0
    for amps in current_a.tolist():
        state += (amps - state) * (1.0 - math.exp(-0.1))
        follows.append(state)
    trips = [trip_of(recording(
        'A', 2400, voltage_v=lambda v: 380.0 - 0.1 * current_a - 0.06 * np.array(follows)), VEHICLE)]
    found = fit_electrical(VEHICLE, trips)
    expected = 1.0 + 0.6 * float(np.mean(np.square(follows)) / np.mean(current_a**2))
    assert found.polarisation_s == 10.0
    assert found.heat_factor == pytest.approx(expected, rel=0.03)
