# SPDX-License-Identifier: Apache-2.0
"""Route plans without powers: those of the road load, as of the same segments in a file."""

from dataclasses import replace

from builtin_interfaces.msg import Time
import numpy as np
import pytest
from refusals import problems_of

from bev_preheat.messages.route_plan import mission_from_message
from bev_preheat.route import route_for
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import RoutePlan

CAR = load_vehicle('small_car')
SEGMENTS = {'segment_duration': [120.0, 90.0, 300.0], 'speed': [11.0, 0.0, 23.0]}

MIDDLES_S = (60.0, 165.0, 360.0)


def message(**fields):
    """Return a RoutePlan without powers."""
    route = RoutePlan(**{'route_id': 'trip', **SEGMENTS, 'ambient_temperature': [-4.0], 'charging_planned': True,
                         **fields})
    route.header.stamp = Time(sec=1_700_000_000)
    return route


def read(vehicle=CAR, **fields):
    return mission_from_message(message(**fields), vehicle.defaults, 30.0, vehicle)


def powers(mission, name='propulsion_power_w'):
    """Return a power in the middle of each segment, from the planning steps."""
    route = mission.legs[0].route
    return getattr(route, name)[[route.segment_at(instant_s) for instant_s in MIDDLES_S]]


def test_powers_are_those_of_the_same_segments_in_a_file(tmp_path):
    slopes = [0.02, 0.0, -0.01]
    mission = read(slope=slopes)
    rows = zip(*SEGMENTS.values(), slopes)
    path = tmp_path / 'trip.csv'
    path.write_text('duration_s,speed_mps,slope,ambient_temperature_c\n' + ''.join(
        f'{duration},{speed},{slope},-4\n' for duration, speed, slope in rows))
    route = route_for(path, CAR).route
    for name in ('propulsion_power_w', 'propulsion_power_rms_w', 'propulsion_power_magnitude_w'):
        assert powers(mission, name) == pytest.approx(getattr(route, name), abs=1e-3)
    assert mission.power_source == (
        'computed from speeds and slopes and the road_load of vehicle small_car; accelerations within the '
        'segments are estimated')


def test_a_missing_slope_is_level_and_one_slope_is_for_all():
    level, one = powers(read()), powers(read(slope=[0.03]))
    assert (powers(read(slope=[0.0])) == level).all()
    assert 'no slope: level road' in read().power_source
    rise_m = 23.0 * 300.0 * 0.03 / np.hypot(1.0, 0.03)
    climb_w = CAR.road_load.mass_kg * 9.80665 * rise_m / 300.0 / CAR.drivetrain.efficiency
    assert one[2] - level[2] == pytest.approx(climb_w, rel=0.05)
    assert level[1] == 0.0


@pytest.mark.parametrize('fields, problem', [
    ({'slope': [0.5]}, 'slope[0]: 0.5 is not allowed; it must be -0.4 ... 0.4 (rise over run)'),
    ({'slope': [float('nan')]}, 'slope[0]: nan is not allowed; it must be -0.4 ... 0.4 (rise over run)'),
    ({'slope': [0.1, 0.1]}, 'slope: has 2 values; it must have 1 or 3, the length of the longest array, or none'),
    ({'propulsion_power_rms': [1.0]},
     'propulsion_power_rms: given without propulsion_power; give all three, or none'),
    ({'speed': [-1.0]}, 'speed[0]: -1 is not allowed; it must be 0 ... 100 m/s'),
    ({'ambient_temperature': []}, 'missing or empty: propulsion_power, ambient_temperature'),
    ({'speed': [90.0], 'segment_duration': [900.0], 'slope': [0.3]},
     'slope: the road rises by 23275 m in total; at most 6000 m are plausible; it must be rise over run')])
def test_mistakes_are_named(fields, problem):
    assert problem in problems_of(read, **fields)


def test_a_vehicle_without_road_load_is_told_what_to_add():
    found = problems_of(read, replace(CAR, road_load=None))
    assert found[0].startswith("propulsion_power: empty, and vehicle 'small_car' has no road_load")
    assert 'road_load: {mass_kg: 1900' in found[0]
