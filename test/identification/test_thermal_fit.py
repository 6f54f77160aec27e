# SPDX-License-Identifier: Apache-2.0
"""Readings as intervals, the thermal model's courses and slopes, and the voltage's fit, against closed forms."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest
from recorded import night, recording

from bev_preheat.identification.check import predict
from bev_preheat.identification.curves import CorrectedResistance, KNOTS_C, resistance_table
from bev_preheat.identification.parameters import NAMES, parameters_of, Structure
from bev_preheat.identification.structures import chosen_structure, StructureResult, try_structures
from bev_preheat.identification.trips import trip_of
from bev_preheat.numerics import ARRAYS, FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage
from bev_preheat.vehicle.description import Leakage

pytestmark = [pytest.mark.needs('casadi', 'scipy')]
REFERENCE = load_vehicle('small_car')
VEHICLE = replace(REFERENCE, battery=replace(
    REFERENCE.battery, heat_capacity_j_per_k=2e5, leakage=Leakage(5.0, 0.5), capacity_ah=100.0,
    resistance=InverseTemperatureResistance(2.0, 15.0), open_circuit_voltage=PolynomialVoltage((380.0,))))


def arrival_c(trip, start_c, vehicle=VEHICLE, sensor='', **coordinates):
    """Return the last sensor temperature of the fit's model, with START's parameters but for these coordinates."""
    from bev_preheat.identification.electrical import fit_electrical
    from bev_preheat.identification.thermal import course_of, ThermalModel
    fixed = {name: parameter.fixed for name, parameter in parameters_of(vehicle).items()} | coordinates
    theta = np.array([fixed[name] for name in NAMES] + [0.0] * len(KNOTS_C))
    readings_c, _ = ThermalModel(vehicle, NAMES, Structure((), sensor)).course(
        course_of(trip, vehicle), theta, start_c, fit_electrical(vehicle, []))
    return readings_c[-1]


@pytest.mark.parametrize('resolution_k', [0.0, 0.5, 1.0])
def test_half_the_square_of_a_residual_is_the_likelihood_of_the_interval(resolution_k):
    from bev_preheat.identification.readings import NOISE_K, ReadingResiduals, Readings
    model_c = np.array([4.1, 4.8, 5.0, 5.4, 5.7])
    residuals = ReadingResiduals(Readings(np.full((5, 1), 5.0), np.ones((5, 1)), resolution_k))
    residual, slope = residuals(model_c)
    ahead, _ = residuals(model_c + 1e-6)
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


def test_readings_that_flicker_tell_where_between_two_values_the_temperature_is():
    from bev_preheat.identification.readings import ReadingResiduals, Readings
    # 7 of 10 readings of 4.4 + noise of 0.2 K are 4: 4.5 K is 0.524 standard deviations above.
    flickering = ReadingResiduals(Readings(np.array([[4.0, 5.0]]), np.array([[7.0, 3.0]]), 1.0), 0.2)
    at_c = 4.5 - 0.5244 * 0.2
    residual, slope = flickering(np.array([at_c]))
    assert residual[0] == pytest.approx(0.0, abs=2e-3)
    # Fisher information of the share: density^2 / (p (1 - p)) for each of ten readings.
    density = math.exp(-0.5 * 0.5244**2) / math.sqrt(2.0 * math.pi) / 0.2
    assert slope[0]**2 == pytest.approx(10.0 * density**2 / (0.7 * 0.3), rel=1e-2)
    # Half the square is the log-likelihood ratio of 7 and 3 of ten.
    share = 0.5 * math.erfc(0.5 / math.sqrt(2.0))
    residual, _ = flickering(np.array([4.6]))
    assert 0.5 * residual[0]**2 == pytest.approx(
        7.0 * math.log(0.7 / share) + 3.0 * math.log(0.3 / (1.0 - share)), rel=1e-3)


@pytest.mark.parametrize('resolution_k', [0.0, 1.0])
def test_the_noise_is_found_from_the_readings(resolution_k):
    from bev_preheat.identification.readings import likely_noise_k, Readings
    generator = np.random.default_rng(3)
    true_c = np.linspace(0.0, 8.0, 4000)
    read_c = true_c + generator.normal(0.0, 0.2, 4000)
    if resolution_k:
        read_c = np.round(read_c)
    readings = Readings(read_c[:, np.newaxis], np.ones((4000, 1)), resolution_k)
    assert likely_noise_k([readings], [true_c]) == pytest.approx(0.2, rel=0.05)


def test_the_fit_has_the_joule_heat_of_the_current_although_the_power_varies():
    without_leakage = replace(VEHICLE, battery=replace(
        VEHICLE.battery, leakage=Leakage(0.0, 0.0), resistance=InverseTemperatureResistance(0.1 * 1e6, 1e6)),
        drivetrain=replace(VEHICLE.drivetrain, heat_recovery_efficiency=0.0))
    trip = trip_of(recording(current_a=lambda a: 3.0 * a, voltage_v=lambda v: 3.0 * v - 2.0 * 380.0), VEHICLE)
    for known in (trip, replace(trip, current_a=None, voltage_v=None)):
        # The prior's centre of a leakage is at least 0.5 W/K: the smallest instead.
        found_c = arrival_c(known, 0.0, without_leakage, leakage=math.log(1e-9), leakage_with_speed=0.0)
        assert found_c == pytest.approx(0.1 * float(np.sum(trip.current_a**2)) / 2e5, rel=0.01)


def test_a_night_cools_as_the_exponential_does():
    time_constant_s = 2e5 / 5.0
    trip = trip_of(night(time_constant_s=time_constant_s), VEHICLE)
    predicted = predict(VEHICLE, trip)
    left = math.exp(-len(trip) / time_constant_s)
    assert predicted.reading_c[-1] == pytest.approx(-5.0 + 20.0 * left, abs=1e-3)


def test_slopes_are_those_of_finite_differences():
    from bev_preheat.identification.electrical import fit_electrical
    from bev_preheat.identification.thermal import course_of, ThermalModel
    trip = trip_of(recording(), VEHICLE)
    trip = replace(trip, heater_w=np.where(np.arange(len(trip)) < 600, 2000.0, 0.0),
                   power_w=trip.power_w - np.where(np.arange(len(trip)) < 600, 2000.0, 0.0))
    course, electrical = course_of(trip, VEHICLE), fit_electrical(VEHICLE, [])
    theta = np.array([parameters_of(VEHICLE)[name].prior for name in NAMES] + [0.05] * len(KNOTS_C))
    for structure, own in ((NAMES[:7], Structure()), (NAMES[:5] + NAMES[6:], Structure((), 'shell', True))):
        model = ThermalModel(VEHICLE, structure, own)
        readings_c, slopes = model.course(course, theta, 5.0, electrical)
        for at in range(len(theta)):
            moved = theta.copy()
            moved[at] += 1e-5
            ahead_c, _ = model.course(course, moved, 5.0, electrical)
            if at < len(NAMES) and NAMES[at] not in structure:
                assert not slopes[:, at].any() and np.array_equal(ahead_c, readings_c)
            assert (ahead_c - readings_c) / 1e-5 == pytest.approx(slopes[:, at], rel=2e-3, abs=2e-3)
        warmer_c, _ = model.course(course, theta, 5.0 + 1e-5, electrical)
        assert (warmer_c - readings_c) / 1e-5 == pytest.approx(slopes[:, -1], rel=1e-3, abs=1e-4)


def test_the_fits_model_agrees_with_plans_where_power_is_steady():
    trip = trip_of(recording(current_a=lambda a: np.full_like(a, 60.0),
                             voltage_v=lambda v: np.full_like(v, 374.0)), VEHICLE)
    assert arrival_c(trip, trip.start_c) == pytest.approx(predict(VEHICLE, trip).reading_c[-1], abs=0.02)


def test_resistance_and_capacity_come_from_voltage_and_current():
    from bev_preheat.identification.electrical import fit_electrical
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


@pytest.mark.costly
@pytest.mark.parametrize('new_ah, is_unusual', [(140.0, False), (200.0, True)])
def test_an_aged_battery_is_no_reason_for_distrust(new_ah, is_unusual):
    from bev_preheat.identification.identify import identify
    start = replace(VEHICLE, battery=replace(VEHICLE.battery, capacity_ah=new_ah))
    trips = [trip_of(recording(name, battery_temperature_c=lambda at_c, k=k: at_c + k), start)
             for k, name in enumerate('ABC')]
    capacity = next(each for each in identify(start, trips, 'old').estimates if each.name == 'capacity')
    assert capacity.estimate == pytest.approx(100.0, rel=0.05) and capacity.is_identified
    assert capacity.is_unusual == is_unusual


def test_resistance_over_charge_is_found_although_start_has_none():
    from bev_preheat.identification.electrical import fit_electrical

    def ohm(soc):
        return 0.1 + 0.08 * (0.9 - soc)

    trips = []
    for start_soc in (0.9, 0.6, 0.35):
        shift = 0.8 - start_soc
        soc = recording(seconds=2400).signals['soc'].value - shift
        current_a = recording(seconds=2400).signals['current_a'].value
        trips.append(trip_of(recording(
            f'{start_soc}', 2400, soc=lambda s, soc=soc: soc, battery_temperature_c=lambda c: np.full_like(c, 5.0),
            voltage_v=lambda v, soc=soc: 380.0 - ohm(soc) * current_a), VEHICLE))
    found = fit_electrical(VEHICLE, trips)
    # The resistance has a pole at -15 degC.
    battery = replace(VEHICLE.battery, temperature_range_c=(-10.0, 40.0))
    table = resistance_table(battery, found.log_factors, found.soc_factors)
    for soc in (0.2, 0.4, 0.6, 0.8):
        assert table.function(FLOATS)(soc, 5.0) == pytest.approx(ohm(soc), rel=0.02)


@pytest.mark.parametrize('misfits, chosen', [
    # Three parameters more must gain more than 6 …
    ((8.1, 8.1, 8.1, 0.0), False), ((7.9, 7.9, 7.9, 0.0), True),
    # … and more than the standard error of the sum: that of 9, -1, -1 is 10.
    ((1.0, 11.0, 11.0, 0.0), False), ((2.0, 9.5, 9.5, 90.0), True)])
def test_another_structure_must_explain_unseen_readings_better_by_more_than_chance(misfits, chosen):
    one = StructureResult('one mass', 0.0, (10.0, 10.0, 10.0, 50.0), ())
    two = StructureResult('two masses, sensor in the core', 0.0, misfits, ())
    # The only night decides nothing.
    found = chosen_structure([one, two], ['drive', 'drive', 'drive', 'night at stand'])
    assert found == (two if chosen else one).structure


@pytest.mark.parametrize('share, tried', [(0.3, 2), (0.02, 1), (0.8, 1)])
def test_a_shell_of_hardly_any_heat_capacity_or_nearly_all_is_not_chosen(share, tried):
    """Such a file heated 2 K, at most 5 K, too little: the planner kept the shell of 2 % below 60 degC."""
    costs = {'one mass': 99.0, 'two masses, sensor in the core': 1.0}
    fitter = SimpleNamespace(trips=(), parameters=parameters_of(VEHICLE), fit=lambda structure, _: SimpleNamespace(
        cost=costs[structure], theta=[share if name == 'shell_share' else 0.0 for name in NAMES]))
    results, _ = try_structures(fitter, costs, None, (), lambda stage: None)
    assert len(results) == tried


@pytest.mark.parametrize('sensor', ['shell', 'core', 'mean'])
def test_under_steady_heating_the_masses_differ_as_the_closed_form_says(sensor):
    trip = trip_of(night(hours=2.0, start_c=0.0, ambient_c=0.0), VEHICLE)
    trip = replace(trip, heater_w=np.full(len(trip), 1000.0), power_w=np.full(len(trip), -1000.0))
    found_c = arrival_c(
        trip, 0.0, sensor=sensor, heat_capacity=math.log(2e5), leakage=math.log(1e-9), leakage_with_speed=0.0,
        heater_efficiency=0.8, shell_share=0.3, shell_conductance=math.log(60.0), sensor_lag=math.log(0.01))
    # After ten time constants the shell is 0.7 x 800 W / 60 W/K warmer than the core.
    mean_c, excess_k = 800.0 * len(trip) / 2e5, 0.7 * 800.0 / 60.0
    expected_c = {'mean': mean_c, 'shell': mean_c + 0.7 * excess_k, 'core': mean_c - 0.3 * excess_k}[sensor]
    assert found_c == pytest.approx(expected_c, abs=0.05)


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
