# SPDX-License-Identifier: Apache-2.0
"""Descriptions of trips: any drive keeps its limits; energy compared with closed forms, calibration, messages."""

from dataclasses import replace
from math import hypot

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from refusals import problems_in, problems_of
import yaml

from bev_preheat.route.legs import drive_along, lay_track, leg_starts_m, legs_file, load_legs, RoadLeg
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Defaults, Drivetrain, RoadLoad

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0, target_battery_temperature_c=21.0)
GRAVITY = 9.80665
# Dry air at sea level, International Standard Atmosphere.
DENSITY_AT_15_C = 1.225
CAR = {
    'mass_kg': 1900.0, 'frontal_area_m2': 2.4, 'drag_coefficient': 0.31,
    'rolling_resistance': 0.011, 'drivetrain_efficiency': 0.87, 'maximum_power_w': 400e3,
    'maximum_regeneration_power_w': 300e3}
DRIVING = {'acceleration_mps2': 1.25, 'deceleration_mps2': 1.6}
WEIGHT = CAR['mass_kg'] * GRAVITY
ROLLING_N = CAR['rolling_resistance'] * WEIGHT
# Newton per (m/s)^2.
DRAG = 0.5 * DENSITY_AT_15_C * CAR['drag_coefficient'] * CAR['frontal_area_m2']


def vehicle(**changes):
    car = {**CAR, **changes}
    return replace(
        load_vehicle('reference'), name='test car', defaults=DEFAULTS,
        drivetrain=Drivetrain(car['drivetrain_efficiency'], 0.7, car['maximum_power_w'],
                              car['maximum_regeneration_power_w']),
        road_load=RoadLoad(car['mass_kg'], car['frontal_area_m2'], car['drag_coefficient'],
                           car['rolling_resistance']))


def description(legs, **changes):
    """Return the description of a trip at 15 degC at sea level."""
    return {'name': 'trip', 'ambient_temperature_c': 15.0, 'cabin_heating_power_w': 1500.0,
            'auxiliary_power_w': 300.0, 'driving': DRIVING, 'legs': legs, **changes}


@pytest.fixture
def make(tmp_path):
    def make(legs, car=None, **changes):
        """Return the LegsRoute of legs, driven by the car with the changes `car`; None removes a key."""
        path = tmp_path / 'trip.yaml'
        path.write_text(yaml.safe_dump({key: value for key, value in description(legs, **changes).items()
                                        if value is not None}), encoding='utf-8')
        return load_legs(path, vehicle(**(car or {})))
    return make


@pytest.fixture
def problems_with(make, tmp_path):
    return lambda legs, **changes: problems_in(f'{tmp_path}/trip.yaml: ', make, legs, **changes)


def energies_wh(route):
    """Return the energy of the driving and of the regenerating segments, both positive."""
    energy_wh = route.propulsion_power_w * route.duration_s / 3600.0
    return float(energy_wh[energy_wh > 0.0].sum()), float(-energy_wh[energy_wh < 0.0].sum())


def test_stops_are_driven_to_waited_at_and_left(make):
    route = make([{'length_m': 4000.0, 'speed_limit_kmh': 72.0, 'stops': 3,
                   'stop_duration_s': 17.0}], segment_duration_s=1.0).route
    speed, up, down = 20.0, DRIVING['acceleration_mps2'], DRIVING['deceleration_mps2']
    assert route.total_duration_s == pytest.approx(
        4000.0 / speed + 4.0 * (speed / (2.0 * up) + speed / (2.0 * down)) + 3.0 * 17.0, abs=0.1)
    # Seconds at a complete standstill: 17 s contain 16 or 17, at 1, 2, 3 km.
    at_m = np.concatenate(([0.0], np.cumsum(route.speed_mps * route.duration_s)))[:-1]
    standing_m = at_m[route.speed_mps < 1e-9]
    for stop_m in (1000.0, 2000.0, 3000.0):
        assert np.sum(np.abs(standing_m - stop_m) < 1e-3) in (16, 17)
    assert len(standing_m) <= 3 * 17


def test_traffic_only_slows_and_depends_on_the_seed_alone(make):
    legs = [{'length_m': 20e3, 'speed_limit_kmh': 90.0, 'traffic_slowdown_percent': 40.0}]
    first, again, other = (make(legs, seed=seed, segment_duration_s=1.0).route for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.propulsion_power_w, again.propulsion_power_w)
    assert len(first) != len(other) or np.any(first.speed_mps != other.speed_mps)
    cruising = first.speed_mps[30:-30]
    assert cruising.max() <= 25.0 + 1e-9
    assert cruising.min() >= 25.0 * 0.6 - 1e-9
    # Uniform between 0 and 40 %: 20 % less on average, over distance rather than time.
    mean_slowness = first.total_duration_s / 20e3 * 25.0
    assert mean_slowness == pytest.approx(np.log(1.0 / 0.6) / 0.4, rel=0.06)


def cruising_power_w(make, slope_percent=0.0, wind=0.0, **changes):
    """Return the power in the middle of a leg driven at 20 m/s."""
    route = make([{'length_m': 6000.0, 'speed_limit_kmh': 72.0, 'slope_percent': slope_percent}],
                 headwind_mps=wind, start_elevation_m=-30.0 * slope_percent, **changes).route
    middle = len(route) // 2
    assert route.propulsion_power_rms_w[middle] == pytest.approx(abs(route.propulsion_power_w[middle]), rel=1e-4)
    return route.propulsion_power_w[middle]


@pytest.mark.parametrize('wind', [0.0, 6.0, -4.0])
@pytest.mark.parametrize('slope_percent', [0.0, 5.0])
def test_constant_speed_of_a_loaded_car_in_wind(make, slope_percent, wind):
    """Payload adds rolling resistance and climbing, the roof box drag, snow rolling resistance."""
    weight = (CAR['mass_kg'] + 300.0) * GRAVITY
    along = hypot(1.0, slope_percent / 100.0)
    force = (weight * (slope_percent / 100.0 + 1.7 * CAR['rolling_resistance']) / along
             + (DRAG + 0.5 * DENSITY_AT_15_C * 0.25) * (20.0 + wind)**2)
    load = {'payload_kg': 300.0, 'additional_drag_area_m2': 0.25, 'rolling_resistance_factor': 1.7}
    # On the level to rounding; on a slope the air gets thinner.
    assert cruising_power_w(make, slope_percent=slope_percent, wind=wind, load=load) == pytest.approx(
        force * 20.0 / CAR['drivetrain_efficiency'], rel=1e-3 if slope_percent else 1e-5)


def test_a_car_that_is_too_weak_for_the_drive_is_refused(problems_with):
    # At 25 m/s, still accelerating: (m a + rolling + drag v^2) v / efficiency = 92.4 kW.
    force = CAR['mass_kg'] * DRIVING['acceleration_mps2'] + ROLLING_N + DRAG * 25.0**2
    most_kw = force * 25.0 / CAR['drivetrain_efficiency'] / 1e3
    (problem,) = problems_with([{'length_m': 3000.0, 'speed_limit_kmh': 90.0}], car={'maximum_power_w': 60e3})
    assert problem.startswith("legs: vehicle 'test car' would need ")
    assert problem.endswith(' kW at km 0.2; its drivetrain.maximum_power_w is 60000 W; lower '
                            'driving.acceleration_mps2 or the speed limit there')
    assert float(problem.split('would need ')[1].split()[0]) == pytest.approx(most_kw, rel=0.03)


def test_energy_of_a_trapezoid(make):
    """Kinetic energy is spent when pulling away and returns, minus losses, when braking."""
    speed, up, down = 25.0, DRIVING['acceleration_mps2'], DRIVING['deceleration_mps2']
    efficiency = CAR['drivetrain_efficiency']
    start, stop = speed**2 / (2.0 * up), speed**2 / (2.0 * down)
    # 60 s at full speed after 20 s of pulling away: no second contains both driving and braking, except
    # for the time in a cell that cuts a corner of the trapezoid.
    length = start + 60.0 * speed + stop
    kinetic = 0.5 * CAR['mass_kg'] * speed**2
    # v^3 dt = v^4 / (4 a) over an acceleration a.
    driving = (kinetic + ROLLING_N * (length - stop)
               + DRAG * (speed**4 / (4.0 * up) + speed**2 * (length - start - stop))) / efficiency
    braking = (kinetic - ROLLING_N * stop - DRAG * speed**4 / (4.0 * down)) * efficiency
    driven_wh, regenerated_wh = energies_wh(
        make([{'length_m': length, 'speed_limit_kmh': 90.0}], segment_duration_s=1.0).route)
    assert driven_wh == pytest.approx(driving / 3600.0, rel=3e-3)
    assert regenerated_wh == pytest.approx(braking / 3600.0, rel=3e-3)


def test_energy_of_a_whole_trip_balances(make):
    """Without drivetrain losses, from rest to rest: potential, rolling and air resistance only."""
    legs = [{'length_m': 1500.0, 'speed_limit_kmh': 50.0, 'slope_percent': 3.0, 'stops': 4,
             'stop_duration_s': 9.0},
            {'length_m': 2500.0, 'speed_limit_kmh': 80.0, 'slope_percent': -5.0,
             'traffic_slowdown_percent': 30.0},
            {'length_m': 1200.0, 'speed_limit_kmh': 30.0, 'slope_percent': 1.0}]
    route = make(legs, car={'drivetrain_efficiency': 1.0, 'drag_coefficient': 0.05,
                            'frontal_area_m2': 0.2}, segment_duration_s=1.0).route
    potential = WEIGHT * sum(leg['length_m'] * leg['slope_percent'] / 100.0
                             / hypot(1.0, leg['slope_percent'] / 100.0) for leg in legs)
    rolling = ROLLING_N * sum(leg['length_m'] / hypot(1.0, leg['slope_percent'] / 100.0) for leg in legs)
    # This car has almost no air resistance; the rest, second by second.
    air = 0.5 * DENSITY_AT_15_C * 0.05 * 0.2 * route.speed_mps**3 @ route.duration_s
    assert route.propulsion_power_w @ route.duration_s == pytest.approx(potential + rolling + air, rel=2e-4)


TRIP = [{'length_m': 4000.0, 'speed_limit_kmh': 50.0, 'stops': 3, 'stop_duration_s': 20.0},
        {'length_m': 6000.0, 'speed_limit_kmh': 90.0}]


def test_distance_and_duration_are_met(make):
    made = make(TRIP, distance_m=11000.0, duration_s=810.0)
    assert made.route.distance_m == pytest.approx(11000.0, abs=1e-6)
    assert made.route.total_duration_s == pytest.approx(810.0, abs=1e-9)
    assert len(made.route) == 27
    assert made.remarks[0] == 'the legs, 10000 m, are scaled by 1.1000 to 11000 m'
    assert made.remarks[1].startswith('speeds are scaled by 0.')
    # The stops keep their duration.
    assert np.sum(make(TRIP, duration_s=810.0, segment_duration_s=1.0).route.speed_mps < 1e-9) in range(57, 62)


def test_duration_out_of_reach_is_refused(problems_with):
    slowest, fastest = 10000.0 / 0.7, 10000.0 / 1.4
    (problem,) = problems_with(TRIP, duration_s=120.0)
    assert problem.startswith('duration_s: 120 cannot be reached; with speeds scaled by 1.4 ... 0.7 '
                              'the trip lasts ')
    reach = [float(word) for word in problem.split() if word.isdigit()][-2:]
    assert fastest / 25.0 < reach[0] < reach[1] < slowest / 10.0


@pytest.mark.parametrize('variation', [True, False])
def test_energies_are_met(make, variation):
    before = make(TRIP, within_segment_variation=variation).route
    driven, regenerated = energies_wh(before)
    assert regenerated > 10.0
    made = make(TRIP, within_segment_variation=variation, propulsion_energy_wh={
        'vehicle': 'test car', 'total_magnitude': 1.2 * driven + 0.8 * regenerated,
        'net': 1.2 * driven - 0.8 * regenerated})
    assert energies_wh(made.route) == pytest.approx((1.2 * driven, 0.8 * regenerated))
    scales = np.where(before.propulsion_power_w > 0.0, 1.2, 0.8)
    np.testing.assert_allclose(made.route.propulsion_power_rms_w, before.propulsion_power_rms_w * scales)
    assert 'are scaled by 1.2000 to' in made.remarks[0]
    assert 'are scaled by 0.8000 to' in made.remarks[1]


def test_energies_that_are_far_off_are_refused(make, problems_with):
    driven, regenerated = energies_wh(make(TRIP).route)
    assert problems_with(TRIP, propulsion_energy_wh={
        'vehicle': 'test car', 'total_magnitude': 5000, 'net': 4000}) == [
        f'propulsion_energy_wh: 4500 Wh driving cannot be reached; the segments have {driven:.1f} Wh, '
        'which may be scaled by 0.5 ... 2']
    assert problems_with(TRIP, propulsion_energy_wh={
        'vehicle': 'test car', 'total_magnitude': float(driven), 'net': float(driven)}) == [
        f'propulsion_energy_wh: 0 Wh regenerating cannot be reached; the segments have {regenerated:.1f} Wh, '
        'which may be scaled by 0.5 ... 2']
    assert problems_with(TRIP, propulsion_energy_wh={
        'vehicle': 'test car', 'total_magnitude': 900, 'net': -1000}) == [
        'propulsion_energy_wh.net: -1000 is not allowed; its magnitude must be at most total_magnitude, 900']


LEG = {'length_m': 900.0, 'speed_limit_kmh': 50.0}


@pytest.mark.parametrize('leg, problem', [
    ({'length_m': 900.0}, 'legs[1]: missing speed_limit_kmh'),
    ({**LEG, 'stops': 2}, 'legs[1]: missing stop_duration_s, with 2 stops'),
    ({**LEG, 'speed_limit_mps': 9}, "legs[1]: unknown key 'speed_limit_mps'; did you mean "
                                    "'speed_limit_kmh'? known keys: name, length_m, "
                                    'speed_limit_kmh, slope_percent, stops, stop_duration_s, '
                                    'traffic_slowdown_percent, ambient_temperature_c'),
    ({**LEG, 'ambient_temperature_c': [1]}, 'legs[1].ambient_temperature_c: has 1 values; it must '
                                            'have at least 2'),
    ({**LEG, 'length_m': 50e3, 'slope_percent': 30},
     'legs[1]: ends 14367 m above sea level; it must be -500 ... 9000'),
    ({'length_m': 2.2e6, 'speed_limit_kmh': 40}, 'legs: the trip lasts at least 198065 s; at most 86400 s are '
     'planned')])
def test_bad_legs_are_named(problems_with, leg, problem):
    assert problems_with([LEG, leg]) == [problem]


def test_a_car_without_a_road_load_says_what_to_add():
    assert problems_of(load_legs, 'reference', replace(vehicle(), road_load=None)) == [
        f"{legs_file('reference')}: vehicle 'test car' has no road_load, so its power on a road is "
        'unknown; add it to the vehicle file, with the figures of the car, such as road_load: '
        '{mass_kg: 1900, frontal_area_m2: 2.4, drag_coefficient: 0.27, rolling_resistance: 0.010}']


def test_missing_ambient_temperature_is_named(problems_with):
    assert problems_with([{**LEG, 'ambient_temperature_c': 3.0}, LEG], ambient_temperature_c=None) == [
        'legs[1]: missing ambient_temperature_c; give it here or at the top, for all legs']


# Kinematics of any road

LEGS = st.lists(st.builds(
    RoadLeg, length_m=st.floats(5.0, 900.0), speed_limit_mps=st.floats(1.5, 60.0),
    stops=st.integers(0, 6), stop_duration_s=st.sampled_from([0.0, 3.5, 40.0]),
    traffic_slowdown=st.floats(0.0, 0.9), traffic_length_m=st.floats(20.0, 500.0)),
    min_size=1, max_size=6)
ACCELERATIONS_MPS2 = st.floats(0.1, 8.0)


@given(LEGS, ACCELERATIONS_MPS2, ACCELERATIONS_MPS2, st.floats(0.7, 1.4), st.integers(0, 9))
def test_a_drive_keeps_every_limit(legs, up_mps2, down_mps2, pace, seed):
    drive = drive_along(lay_track(legs, seed), up_mps2, down_mps2, pace)
    starts_m = leg_starts_m(legs)
    assert drive.time_s[0] == drive.distance_m[0] == 0.0
    assert drive.speed_mps[0] == drive.speed_mps[-1] == 0.0
    assert drive.distance_m[-1] == pytest.approx(sum(leg.length_m for leg in legs))
    time_s, speed_mps = np.diff(drive.time_s), drive.speed_mps
    assert np.all(time_s > 0.0)
    # Speed and time match the distance.
    np.testing.assert_allclose(0.5 * (speed_mps[1:] + speed_mps[:-1]) * time_s,
                               np.diff(drive.distance_m), atol=1e-6)
    # Squares of speeds, because near a standstill an acceleration is a quotient of rounding errors.
    change = np.diff(speed_mps**2)
    driven_m = np.diff(drive.distance_m)
    assert np.all(change <= 2.0 * up_mps2 * driven_m + 1e-6)
    assert np.all(change >= -2.0 * down_mps2 * driven_m - 1e-6)
    for leg, start_m, end_m in zip(legs, starts_m, starts_m[1:]):
        # Both ends belong to a leg.
        inside = (drive.distance_m >= start_m) & (drive.distance_m <= end_m)
        assert speed_mps[inside].max() <= pace * leg.speed_limit_mps * (1.0 + 1e-9) + 1e-6
    standing_s = time_s[(speed_mps[:-1] == 0.0) & (speed_mps[1:] == 0.0)].sum()
    assert standing_s == pytest.approx(sum(leg.stops * leg.stop_duration_s for leg in legs))


@given(LEGS, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_distance_is_the_integral_of_speed(legs, one, other):
    drive = drive_along(lay_track(legs, 1), 1.1, 1.7)
    start_s, end_s = sorted((one * drive.time_s[-1], other * drive.time_s[-1]))
    # The trapezoidal rule is exact if no instant of the drive is missing.
    between_s = drive.time_s[(drive.time_s > start_s) & (drive.time_s < end_s)]
    instants_s = np.concatenate(([start_s], between_s, [end_s]))
    distance_m, speed_mps = drive.at(instants_s)
    integral_m = 0.5 * (speed_mps[1:] + speed_mps[:-1]) @ np.diff(instants_s)
    assert distance_m[-1] - distance_m[0] == pytest.approx(integral_m, abs=1e-6)
