# SPDX-License-Identifier: Apache-2.0
"""Routes of navigation, loggers and simulators: the same road gives the same route in each format."""

from dataclasses import replace
import json
import re

import numpy as np
import pytest
from refusals import problems_in
import route_examples as examples

from bev_preheat.commands.situation import OFFERS
from bev_preheat.route import route_for
from bev_preheat.route.sources.journey import BESIDE_ROUTE, RouteOptions
from bev_preheat.route.sources.polyline import decode_flexible
from bev_preheat.vehicle import load_vehicle

CAR = load_vehicle('small_car')
COLD = RouteOptions(ambient_temperature_c=-5.0, offers=OFFERS)
TIMED = {
    'gpx': examples.gpx, 'table of positions': examples.positions_csv,
    'osrm': examples.osrm, 'osrm6': lambda: examples.osrm(geometry='polyline6'),
    'osrm geojson': lambda: examples.osrm(geometry='geojson'),
    'osrm steps': lambda: examples.osrm(annotations=False), 'two legs': lambda: examples.osrm(legs=2),
    'valhalla': examples.valhalla, 'miles': lambda: examples.valhalla('miles'),
    'feature': examples.geojson, 'collection': lambda: examples.geojson('FeatureCollection'),
    'openrouteservice': examples.openrouteservice, 'kilometres': lambda: examples.openrouteservice('km'),
    'tomtom': examples.tomtom, 'tomtom progress': lambda: examples.tomtom(progress=True),
    'here': examples.here, 'here 7': examples.here_7,
    'here with summary alone': lambda: examples.here(of_travel=False),
    'google': examples.google, 'google directions': lambda: examples.google(legacy=True),
    'graphhopper': examples.graphhopper, 'graphhopper plain': lambda: examples.graphhopper('plain'),
    'google without legs': lambda: without_legs(examples.google()),
    'graphhopper elevation': lambda: examples.graphhopper('elevation'), 'routingpy': examples.routingpy,
}


def without_legs(text):
    """Return an answer of Google to a request for length, duration and line alone."""
    contents = json.loads(text)
    del contents['routes'][0]['legs']
    return json.dumps(contents)


def loaded(folder, text, options=COLD, car=CAR):
    path = folder / 'file'
    path.write_bytes(text.encode())
    return route_for(path, car, options=options)


def refusal(folder, text, options=COLD):
    """Return the refusal of a text, without the path that begins each problem."""
    problems = problems_in(folder / 'file', loaded, folder, text, options)
    return '; '.join(problem.lstrip(':, ') for problem in problems)


@pytest.mark.parametrize('text', TIMED.values(), ids=TIMED)
def test_one_road_has_one_length_duration_and_line_in_every_format(tmp_path, text):
    found = loaded(tmp_path, text())
    assert found.route.distance_m == pytest.approx(examples.LENGTH_M, rel=2e-3)
    assert found.route.total_duration_s == pytest.approx(examples.LENGTH_M / examples.SPEED_MPS, rel=1e-6)
    assert (found.made_for, found.warning) == ('small_car', None)
    line = found.line
    assert line.distance_m[-1] == pytest.approx(examples.LENGTH_M, rel=2e-3)
    assert line.elapsed_s[-1] == pytest.approx(found.route.total_duration_s, rel=1e-6)
    assert (np.diff(line.distance_m) >= 0.0).all() and (np.diff(line.elapsed_s) >= 0.0).all()
    middle = int(np.searchsorted(line.distance_m, 0.5 * examples.LENGTH_M))
    at = np.searchsorted(examples.LATITUDE, line.latitude_deg[middle])
    assert line.longitude_deg[middle] == pytest.approx(examples.LONGITUDE[at], abs=1e-3)
    assert abs(at - examples.POINTS / 2) <= 2


@pytest.mark.parametrize('text, at_s, length_m', [
    (lambda: examples.tomtom(charging_s=900.0, progress=True), examples.HALF_M[0] / examples.SPEED_MPS,
     examples.LENGTH_M),
    (lambda: examples.tomtom(charging_s=900.0), examples.HALF_M[0] / examples.SPEED_MPS, examples.LENGTH_M),
    (lambda: examples.here(charging_s=900.0), examples.LENGTH_M / examples.SPEED_MPS, examples.LENGTH_M + 2000.0),
    (lambda: examples.here(charging_s=900.0, of_travel=False), examples.LENGTH_M / examples.SPEED_MPS,
     examples.LENGTH_M + 2000.0)])
def test_charging_stops_of_navigation_are_kept_and_no_part_of_the_drive(tmp_path, text, at_s, length_m):
    found = loaded(tmp_path, text())
    [stop] = found.stops
    assert found.route.duration_s[:stop.after_segment + 1].sum() == pytest.approx(at_s)
    assert found.route.distance_m == pytest.approx(length_m, rel=2e-3)
    waits_s = stop.duration_s
    assert waits_s == (900.0 if 'lengthInMeters' in text() else 1020.0)
    assert not any('waypoint' in remark for remark in found.remarks)


def graphhopper_with_waypoint():
    contents = json.loads(examples.graphhopper())
    contents['paths'][0]['instructions'][1]['sign'] = 5
    return json.dumps(contents)


@pytest.mark.parametrize('text, shares, told', [
    (lambda: examples.osrm(legs=3), [1.0 / 3.0, 2.0 / 3.0], '2 waypoints are passed without a stop'),
    # The first two of the instructions are 0.25 and 0.35 of the way.
    (graphhopper_with_waypoint, [0.6], '1 waypoint is passed without a stop')], ids=['osrm', 'graphhopper'])
def test_waypoints_are_passed_or_are_charging_stops(tmp_path, text, shares, told):
    passed = loaded(tmp_path, text())
    assert passed.stops == () and any(
        remark.startswith(told) and '--stop-duration' in remark for remark in passed.remarks)
    found = loaded(tmp_path, text(), replace(COLD, stop_duration_s=900.0))
    assert [stop.duration_s for stop in found.stops] == [900.0] * len(shares)
    assert [found.route.time_s[stop.after_segment + 1] for stop in found.stops] == pytest.approx(
        np.array(shares) * examples.LENGTH_M / examples.SPEED_MPS, rel=1e-3)
    assert found.line is not None


@pytest.mark.parametrize('text, points', [
    ('BFoz5xJ67i1B1B7PzIhaxL7Y', [(50.10228, 8.69821, np.nan), (50.10201, 8.69567, np.nan),
                                  (50.10063, 8.69150, np.nan), (50.09878, 8.68752, np.nan)]),
    ('BlBoz5xJ67i1BU1B7PUzIhaUxL7YU', [(50.10228, 8.69821, 10.0), (50.10201, 8.69567, 20.0),
                                       (50.10063, 8.69150, 30.0), (50.09878, 8.68752, 40.0)])])
def test_flexible_polylines_are_those_of_their_specification(text, points):
    assert decode_flexible(text) == pytest.approx(np.array(points), nan_ok=True, abs=1e-9)


def level_power_w(car, speed_mps, density):
    """Return the electrical power of constant speed on a level road, by hand."""
    load = car.road_load
    force_n = load.mass_kg * 9.80665 * load.rolling_resistance + 0.5 * density * (
        load.drag_coefficient * load.frontal_area_m2) * speed_mps**2
    return force_n * speed_mps / car.drivetrain.efficiency


def test_power_is_at_least_that_of_constant_speed_and_includes_the_hills(tmp_path):
    level = loaded(tmp_path, examples.osrm()).route
    hilly = loaded(tmp_path, examples.geojson()).route
    # Dry air at sea level and -5 degC.
    plain_w = level_power_w(CAR, examples.SPEED_MPS, 101325.0 / (287.05 * 268.15))
    mean_w = level.propulsion_power_w @ level.duration_s / level.total_duration_s
    assert plain_w < mean_w < 1.25 * plain_w
    assert (level.propulsion_power_rms_w > level.propulsion_power_magnitude_w).all()
    # Potential energy of the net rise, and the air at 600 m is thinner.
    rise_w = CAR.road_load.mass_kg * 9.80665 * (
        examples.ELEVATION[-1] - examples.ELEVATION[0]) / level.total_duration_s
    hilly_w = hilly.propulsion_power_w @ hilly.duration_s / hilly.total_duration_s
    assert hilly_w - mean_w == pytest.approx(rise_w, abs=0.1 * plain_w)


def test_a_stop_stays_a_stop(tmp_path):
    route = loaded(tmp_path, examples.gpx(stop_s=240.0)).route
    stands = route.speed_mps == 0.0
    assert route.duration_s[stands].sum() == pytest.approx(240.0, abs=1.0)
    assert (route.propulsion_power_w[stands] == 0.0).all()
    assert route.total_duration_s == pytest.approx(examples.LENGTH_M / examples.SPEED_MPS + 240.0)


TIME = examples.gpx().split('<time>')[200].split('</time>')[0]


@pytest.mark.parametrize('old, new, remark', [
    *((f'<time>{TIME}<', f'<time>{wild}<',
       '1 trkpts dropped, from trkpt 200 on: the time does not fit those of the others')
      for wild in ('2026-01-10T06:00:02Z', '1970-01-01T00:00:00Z', '2106-02-07T06:28:15Z')),
    # A point that no car reaches, and one without a time.
    (f'lat="{examples.LATITUDE[199]:.7f}"', 'lat="46"',
     '1 trkpts dropped, from trkpt 200 on: at the same time as the one before, or too far from it'),
    (f'<time>{TIME}</time>', '', '1 trkpts without a time are left out, 0 m of 19.9 km')])
def test_a_wrong_point_is_left_out_and_counted(tmp_path, old, new, remark):
    found = loaded(tmp_path, examples.gpx().replace(old, new))
    assert remark in found.remarks
    assert found.route.distance_m == pytest.approx(examples.LENGTH_M, rel=2e-3)
    assert found.route.total_duration_s == pytest.approx(examples.LENGTH_M / examples.SPEED_MPS)


@pytest.mark.parametrize('text', [examples.gpx, examples.positions_csv])
@pytest.mark.parametrize('times', [True, False])
@pytest.mark.parametrize('missing', [range(0, 3), range(100, 102), range(399, 400)])
def test_positions_of_a_receiver_without_a_fix_are_left_out_and_counted(tmp_path, text, times, missing):
    changed = whole = text(times)
    for at in missing:
        for degrees in (examples.LATITUDE[at], examples.LONGITUDE[at]):
            changed = changed.replace(f'{degrees:.7f}', '0.0000000')
    options = COLD if times else replace(COLD, free_speed_kmh=60.0)
    found, expected = (loaded(tmp_path, each, options) for each in (changed, whole))
    assert [remark for remark in found.remarks if remark.startswith(f'{len(missing)} ')
            and f' {missing[0] + 1} on: latitude 0 and longitude 0 mean' in remark]
    assert found.route.distance_m == pytest.approx(expected.route.distance_m, rel=0.01)
    assert found.route.total_duration_s == pytest.approx(expected.route.total_duration_s, rel=0.02)


def test_an_hour_without_points_is_named(tmp_path):
    head, *points = examples.gpx().split('<trkpt')
    late = [point.replace('T07:', 'T08:') for point in points[200:]]
    found = loaded(tmp_path, '<trkpt'.join([head, *points[:160], *late]))
    # The points are 50 m apart, which take 2.5 s.
    assert ('gaps of more than 60 s without a trkpt: 1, the longest 3702 s; driven at constant speed'
            in found.remarks)
    assert not any('gaps' in remark for remark in loaded(tmp_path, examples.gpx()).remarks)


EPA_ROWS = '0\t0\n1\t0.2\n2\t4\n3\t9\n4\t12\n5\t16\n'


@pytest.mark.parametrize('text', [
    f'US06COL.TXT\tUS06 or Supplemental FTP\nTest Time, secs\tTarget Speed, mph\n{EPA_ROWS}',
    f'UDDSCOL.TXT\tLA4 or FTP-72, First 1372 seconds of FTP\nTest Time, secs\tTarget Speed, mph\n{EPA_ROWS}',
    f'Test Time, secs\tTarget Speed, mph\n{EPA_ROWS}', f'A schedule\n\ntime,speed\n[s],[mph]\n{EPA_ROWS}'.replace(
        '\t', ','),
    'Time (s)   Speed (mph)\n' + EPA_ROWS.replace('\t', '   '),
    'Zeit, s;Speed, mph\n' + EPA_ROWS.replace('\t', ';').replace('.', ','),
    'Speed trace of a drive, with a title\n"Time, s","Speed, mph"\n' + EPA_ROWS.replace('\t', ',')])
def test_titles_and_separators_within_names_do_not_hide_the_header(tmp_path, text):
    route = loaded(tmp_path, text).route
    # The trapezoidal rule by hand, in mph s.
    assert route.distance_m == pytest.approx(0.44704 * (0.1 + 2.1 + 6.5 + 10.5 + 14.0), rel=1e-6)
    assert route.total_duration_s == 5.0


@pytest.mark.parametrize('name', ['t_env_c', 'T_amb_C', 'Tamb [°C]', 'OAT[DegC]', 'Outside Air Temperature (degC)',
                                  'temp_out_c', 'Umgebungstemperatur in °C'])
def test_temperatures_of_the_air_are_known_by_their_names(tmp_path, name):
    route = loaded(tmp_path, f'time_s,speed_kmh,{name}\n0,30,-8\n10,30,-9\n20,30,-9\n', RouteOptions()).route
    assert route.ambient_temperature_c @ route.duration_s / 20.0 == pytest.approx(-8.75)


def test_a_jitter_of_positions_is_not_driven(tmp_path):
    """A fix each second with independent errors of 3 m: the zigzag would add 12 % to the length at 8 m/s."""
    random = np.random.default_rng(5)
    points = []
    for second in range(900):
        north_m = 8.0 * second + random.normal(0.0, 3.0)
        east_m = random.normal(0.0, 3.0)
        points.append(f'<trkpt lat="{47.0 + np.degrees(north_m / 6371008.8):.8f}" '
                      f'lon="{np.degrees(east_m / 6371008.8):.8f}"><time>2026-01-10T07:{second // 60:02d}:'
                      f'{second % 60:02d}Z</time></trkpt>')
    text = f'<gpx version="1.0"><trk><trkseg>{"".join(points)}</trkseg></trk></gpx>'
    assert loaded(tmp_path, text).route.distance_m == pytest.approx(8.0 * 899, rel=0.02)


@pytest.mark.parametrize('text', [
    lambda: examples.gpx(times=False), lambda: examples.positions_csv(times=False),
    lambda: examples.gpx(times=False, element='rtept'),
    lambda: examples.geojson('LineString', times=False)])
def test_a_line_without_times_is_driven_at_the_free_speed(tmp_path, text):
    refused = refusal(tmp_path, text())
    assert 'no usable times; give the speed on free road [km/h], such as: --free-speed 90' in refused
    route = loaded(tmp_path, text(), replace(COLD, free_speed_kmh=72.0)).route
    assert route.distance_m == pytest.approx(examples.LENGTH_M, rel=2e-3)
    # 20 m/s, and 1 m/s^2 at both ends.
    assert route.total_duration_s == pytest.approx(examples.LENGTH_M / 20.0 + 20.0, rel=0.01)
    assert route.speed_mps.max() <= 20.0 + 1e-6


@pytest.mark.parametrize('kept, reason', [
    (lambda at: at % 5 < 2, 'only 160 of 400 points have a time: times are not used'),
    (lambda at: at == 0, 'only 1 of 400 points have a time: times are not used')])
def test_a_refused_line_says_why_the_times_of_some_points_are_not_used(tmp_path, kept, reason):
    head, *points = examples.gpx().split('<trkpt')
    text = '<trkpt'.join([head, *(point if kept(at) else re.sub('<time>.*</time>', '', point)
                                  for at, point in enumerate(points))])
    assert refusal(tmp_path, text).endswith(f'--free-speed 90; {reason}')
    assert reason in loaded(tmp_path, text, replace(COLD, free_speed_kmh=60.0)).remarks


def test_a_curve_is_driven_at_its_speed(tmp_path):
    """Half a circle with a radius of 100 m between straights: sqrt(2 m/s^2 times 100 m) = 14.1 m/s."""
    angle = np.linspace(0.0, np.pi, 40)
    x = np.concatenate((np.linspace(-3000.0, 0.0, 100), 100.0 * np.sin(angle), np.linspace(0.0, -3000.0, 100)))
    y = np.concatenate((np.zeros(100), 100.0 * (1.0 - np.cos(angle)), np.full(100, 200.0)))
    degrees = np.degrees(1.0 / 6371008.8)
    line = {'type': 'LineString', 'coordinates': np.column_stack((x * degrees, y * degrees)).tolist()}
    found = loaded(tmp_path, json.dumps(line), replace(COLD, free_speed_kmh=108.0))
    line = found.line
    inside = (line.distance_m > 3080.0) & (line.distance_m < 3240.0)
    speeds = np.diff(line.distance_m[inside]) / np.diff(line.elapsed_s[inside])
    assert speeds == pytest.approx(np.sqrt(200.0), rel=0.1)
    assert found.route.speed_mps.max() > 25.0


def test_edges_with_speeds_in_place_of_durations_and_elevations_of_valhalla_are_used(tmp_path):
    contents = json.loads(examples.osrm())
    for leg in contents['routes'][0]['legs']:
        lengths = np.array(leg['annotation'].pop('distance'))
        # The first half of the edges is driven at half the speed of the others.
        leg['annotation'] = {'distance': lengths.tolist(), 'speed': np.where(
            np.arange(len(lengths)) < len(lengths) / 2, 10.0, 20.0).tolist()}
    found = loaded(tmp_path, json.dumps(contents)).route
    assert found.speed_mps[-2] / found.speed_mps[1] == pytest.approx(2.0, rel=1e-3)
    # Beside miles, elevations and their interval are in feet.
    for units, unit_m in (('kilometers', 1.0), ('miles', 0.3048)):
        contents = json.loads(examples.valhalla(units))
        level = loaded(tmp_path, json.dumps(contents)).route
        contents['trip']['legs'][0] |= {'elevation': (np.linspace(100.0, 300.0, 201) / unit_m).tolist(),
                                        'elevation_interval': examples.LENGTH_M / 200.0 / unit_m}
        hilly = loaded(tmp_path, json.dumps(contents)).route
        gained_j = (hilly.propulsion_power_w - level.propulsion_power_w) @ level.duration_s
        assert gained_j == pytest.approx(
            CAR.road_load.mass_kg * 9.80665 * 200.0 / CAR.drivetrain.efficiency, rel=0.1)


@pytest.mark.parametrize('name, values', [
    ('consumption_wh', (750, 8400)), ('Verbrauch [kWh/100km]', (15, 21)), ('consumption_wh_per_km', (150, 210)),
    ('energy (kWh/km)', (0.15, 0.21)), ('consumption_kwh_per_100km', (15, 21)),
    ('Energy [Wh/mi]', (241.4016, 337.96224))])
def test_a_consumption_by_length_is_that_of_its_segment(tmp_path, name, values):
    text = f'length_km,speed_kmh,{name}\n5,50,{values[0]}\n40,100,{values[1]}\n'
    route = loaded(tmp_path, text, replace(COLD, with_auxiliaries=False)).route
    energy_wh = np.add.reduceat(route.propulsion_power_w * route.duration_s, [
        0, np.searchsorted(route.time_s, 360.0)]) / 3600.0
    assert energy_wh == pytest.approx([750.0, 8400.0], rel=1e-6)


def test_consumption_wins_over_the_road_load(tmp_path):
    assert 'say which: --consumption total or --consumption drivetrain' in refusal(
        tmp_path, examples.segments_json())
    drive, total = (loaded(tmp_path, examples.segments_json(), replace(COLD, with_auxiliaries=given)).route
                    for given in (False, True))
    assert drive.propulsion_power_w == pytest.approx([2500.0 * 6.0, 5100.0 * 60.0 / 18.0], abs=1e-2)
    others_w = CAR.defaults.cabin_heating_power_w + CAR.defaults.auxiliary_power_w
    assert drive.propulsion_power_w - total.propulsion_power_w == pytest.approx(others_w, abs=1e-2)
    # Without a road load there is no variation.
    bare = loaded(tmp_path, examples.segments_json(), replace(COLD, with_auxiliaries=False),
                  replace(CAR, road_load=None)).route
    assert (bare.propulsion_power_rms_w == bare.propulsion_power_w).all()
    assert (drive.propulsion_power_rms_w > drive.propulsion_power_w).all()


def test_a_spreadsheet_of_legs_has_its_energy_and_names_what_is_not_used(tmp_path):
    found = loaded(tmp_path, 'From,Distance (km),Duration (min),Energy (kWh),Toll\nA,30,20,5,0\nB,45,30,9,2\n',
                   replace(COLD, with_auxiliaries=False))
    assert found.route.propulsion_power_w == pytest.approx([15e3, 18e3], abs=1e-2)
    assert 'not used: From, Toll' in found.remarks


def test_a_known_column_that_is_not_used_is_named_with_its_remedy(tmp_path):
    found = loaded(tmp_path, 'length_km,duration_min,slope_percent,elevation_m,charging_time\n5,5,1,90,0\n'
                   '5,5,1,90,20\n5,5,1,90,0\n')
    assert ("not used: slope_percent, charging_time; column 'charging_time' has no unit: rename it to "
            'charging_time_s or charging_time_min') in found.remarks
    cycle = loaded(tmp_path, 'time_s,speed_kmh,odometer_km,energy_wh,charging_time_s\n0,50,0,9,0\n9,50,.1,9,60\n')
    assert 'not used: odometer_km, energy_wh, charging_time_s' in cycle.remarks


def test_a_charging_time_at_the_destination_is_no_stop_of_the_route(tmp_path):
    found = loaded(tmp_path, 'length_km,duration_min,charging_time_min\n5,5,0\n5,5,12\n5,5,20\n')
    assert [(stop.after_segment, stop.duration_s) for stop in found.stops] == [(1, 720.0)]


@pytest.mark.parametrize('encoding', ['utf-16', 'utf-8-sig'])
@pytest.mark.parametrize('text', [examples.gpx, examples.geojson, examples.osrm, examples.segments_csv])
def test_a_file_of_windows_is_the_same_route(tmp_path, text, encoding):
    wanted = loaded(tmp_path, text())
    (tmp_path / 'windows').write_bytes(text().replace('UTF-8', encoding.partition('-sig')[0]).encode(encoding))
    found = route_for(tmp_path / 'windows', CAR, options=COLD)
    assert (found.route.propulsion_power_w == wanted.route.propulsion_power_w).all()


def test_points_at_the_same_second_are_left_out(tmp_path):
    """A receiver of 5 Hz writes whole seconds: four of five points repeat a time."""
    points = ''.join(
        f'<trkpt lat="{47.0 + np.degrees(20.0 * tick / 5.0 / 6371008.8):.8f}" lon="11"><ele>500</ele>'
        f'<time>2026-01-10T07:{tick // 300:02d}:{tick // 5 % 60:02d}Z</time></trkpt>' for tick in range(1501))
    found = loaded(tmp_path, f'<gpx version="1.1"><trk><trkseg>{points}</trkseg></trk></gpx>')
    assert found.route.distance_m == pytest.approx(20.0 * 300.0, rel=2e-3)
    assert found.route.total_duration_s == 300.0
    assert ('1200 trkpts dropped, from trkpt 2 on: at the same time as the one before, or too far from it'
            in found.remarks)


@pytest.mark.parametrize('text', [
    'length_km,speed_kmh,elevation_m\n1,60,100\n1,60,1000\n1,60,1000\n',
    'time_s,speed_kmh,elevation_m\n' + ''.join(f'{t},72,{500 if t > 100 else 0}\n' for t in range(0, 601, 10))])
def test_elevations_that_no_road_has_are_named(tmp_path, text):
    """A receiver without a fix writes an elevation of 0, and a terrain model the mountain above a tunnel."""
    assert any(remark.startswith('the elevation changes by ') and 'at most 40 %' in remark
               for remark in loaded(tmp_path, text).remarks)
    assert not any('elevation changes' in remark for remark in loaded(tmp_path, examples.gpx()).remarks)


def test_sumo_has_the_energy_of_its_output(tmp_path):
    route = loaded(tmp_path, examples.sumo(), replace(COLD, with_auxiliaries=False)).route
    assert route.propulsion_power_w @ route.duration_s == pytest.approx(5000.0 * 199.0, rel=1e-4)
    assert route.distance_m == pytest.approx(200.0 + 20.0 * 179.0, rel=1e-4)
    both = examples.sumo(('a', 'b'))
    assert 'choose one, such as: --vehicle-id a' in refusal(tmp_path, both)
    assert len(loaded(tmp_path, both, replace(COLD, with_auxiliaries=False, vehicle_id='b')).route)


@pytest.mark.parametrize('options, problem', [
    (replace(COLD, free_speed_kmh=90.0), '--free-speed: is only for a line on the map without times'),
    (replace(COLD, stop_duration_s=90.0), '--stop-duration: is only for an answer of navigation with waypoints'),
    (replace(COLD, vehicle_id='x'), '--vehicle-id: is only for the battery output of SUMO'),
    (replace(COLD, with_auxiliaries=True), 'has no consumption; leave out --consumption'),
    (RouteOptions(offers=OFFERS), 'this drive cycle has no ambient temperature; give it [degC], such as: '
     '--ambient -5'),
    (RouteOptions(offers=BESIDE_ROUTE), 'give it [degC], such as: ambient_temperature_c: -5 beside route'),
    (RouteOptions(), 'has no ambient temperature; make a route file with preheat route --from')])
def test_options_that_do_not_fit(tmp_path, options, problem):
    assert refusal(tmp_path, examples.speed_table(), options).endswith(problem)


@pytest.mark.parametrize('header', [
    'time_s,speed_kmh', 'Time [s],v [km/h]', 'Total elapsed time (s),Speed (km/h)', 't_s,v_kmh',
    'Zeit [s],Geschwindigkeit [km/h]', 'Time,WLTC speed [kph]', 'time_s,wltc_class_3b_kmh',
    'Elapsed time / s,Speed / km/h',
    'time,speed\n[s],[km/h]'])
def test_columns_are_spelt_in_many_ways(tmp_path, header):
    usual = examples.speed_table()
    wanted = loaded(tmp_path, usual).route
    found = loaded(tmp_path, usual.replace('time_s,speed_kmh', header)).route
    assert (found.propulsion_power_w == wanted.propulsion_power_w).all()


@pytest.mark.parametrize('moment', [
    lambda second: f'2026-01-31T08:{second // 60:02d}:{second % 60:02d}Z',
    lambda second: 1_769_846_400 + second, lambda second: 1000 * (1_769_846_400 + second),
    lambda second: f'08{second // 60:02d}{second % 60:02d}', lambda second: f'{46053 + second / 86400:.9f}',
    lambda second: f'08:{second // 60:02d}:{second % 60:02d}'])
def test_times_are_seconds_dates_or_times_of_day(tmp_path, moment):
    rows = examples.speed_table().splitlines()
    text = '\n'.join(['time,speed_kmh', *(
        f'{moment(second)},{row.split(",")[1]}' for second, row in enumerate(rows[1:]))])
    assert loaded(tmp_path, text).route.distance_m == pytest.approx(
        loaded(tmp_path, examples.speed_table()).route.distance_m)


@pytest.mark.parametrize('name, assumed', [
    ('time', True), ('t', True), ('time_s', False), ('Time [s]', False), ('time_min', False)])
def test_seconds_of_a_cycle_that_names_no_unit_are_named_as_assumed(tmp_path, name, assumed):
    rows = ''.join(f'{at},{50 + at}\n' for at in range(9))
    remarks = loaded(tmp_path, f'{name},speed_kmh\n{rows}').remarks
    assert (f'{name}: has no unit; its times are taken as seconds' in remarks) is assumed


def test_a_drive_that_never_moves_is_refused(tmp_path):
    assert 'check column and unit of the speed' in refusal(tmp_path, 'time_s,speed_kmh\n0,0\n60,0\n')
