# SPDX-License-Identifier: Apache-2.0
"""Broken files of routes: one line with file, place and remedy, never a traceback."""

from dataclasses import replace
import json
import random

from mistakes import changed, GONE, mutated, places
import pytest
import route_examples as examples

from bev_preheat.errors import InvalidInput
from bev_preheat.route import route_for
from bev_preheat.route.sources.journey import RouteOptions
from bev_preheat.vehicle import load_vehicle

CAR = load_vehicle('small_car')
COLD = RouteOptions(ambient_temperature_c=-5.0)
FREE = replace(COLD, free_speed_kmh=80.0)
CONSUMED = replace(COLD, with_auxiliaries=False)
# Text and options by format.
FORMATS = {
    'gpx': (examples.gpx(), COLD), 'gpx route': (examples.gpx(times=False, element='rtept'), FREE),
    'geojson': (examples.geojson(), COLD), 'line': (examples.geojson('LineString', times=False), FREE),
    'openrouteservice': (examples.openrouteservice(), COLD),
    'osrm': (examples.osrm(2), COLD), 'osrm steps': (examples.osrm(1, False, 'geojson'), COLD),
    'tomtom': (examples.tomtom(900.0, True), COLD), 'here': (examples.here(900.0), COLD),
    'here 7': (examples.here_7(), COLD), 'google': (examples.google(), COLD),
    'directions': (examples.google(legacy=True), COLD),
    'graphhopper': (examples.graphhopper(), COLD), 'routingpy': (examples.routingpy(), COLD),
    'valhalla': (examples.valhalla(), COLD), 'segments json': (examples.segments_json(), CONSUMED),
    'segments csv': (examples.segments_csv(), COLD), 'cycle': (examples.speed_table(), COLD),
    'fastsim': (examples.fastsim(), COLD), 'sumo': (examples.sumo(), CONSUMED)}
JSONS = [name for name in FORMATS if FORMATS[name][0].startswith('{')]
BROKEN_FILES = 20
VALUES = [None, [], {}, '', 'x', -1, 0, 1e308, -1e308, 10**400, True, [[]], [None], {'a': 1}, 1e-9, 'NaN', 50,
          *[GONE] * 4]


def load(folder, contents, options):
    """Load a route; a refusal has one line for each problem and names the file."""
    path = folder / 'broken'
    path.write_bytes(contents)
    try:
        return route_for(path, CAR, options=options)
    except InvalidInput as error:
        assert all(problem.startswith(str(path)) or 'more problem' in problem for problem in error.problems), error
        assert '\n' not in str(error)
        return error


@pytest.mark.parametrize('name', FORMATS)
def test_files_that_are_cut_off_are_refused(tmp_path, name):
    text, options = FORMATS[name]
    contents = text.encode().rstrip()
    for part in range(BROKEN_FILES):
        found = load(tmp_path, contents[:len(contents) * part // BROKEN_FILES], options)
        # A table has no end; rows that are left are a shorter drive.
        assert isinstance(found, InvalidInput) or name in ('segments csv', 'cycle', 'fastsim')


@pytest.mark.parametrize('name', FORMATS)
def test_changed_bytes_give_a_route_or_a_refusal(tmp_path, name):
    text, options = FORMATS[name]
    for seed in range(BROKEN_FILES):
        load(tmp_path, mutated(text.encode(), random.Random(f'{name} {seed}')), options)


@pytest.mark.parametrize('name', JSONS)
def test_changed_values_give_a_route_or_a_refusal(tmp_path, name):
    text, options = FORMATS[name]
    choose, contents = random.Random(name), json.loads(text)
    paths = list(places(contents))
    for _ in range(2 * BROKEN_FILES):
        broken = changed(contents, choose.choice(paths), choose.choice(VALUES))
        load(tmp_path, json.dumps(broken).encode(), options)


@pytest.mark.parametrize('contents, problem', [
    ('', 'is empty'),
    ('{', 'line 1: is not JSON: '), ('[]', 'its list of segments is empty'),
    ('[1]', 'segment 1: must be an object'),
    ('{"a": [1], "b": [1, 2]}', 'its lists have different lengths: 1, 2'),
    ('{"a": 1}', 'is not a route: it has no routes (OSRM, TomTom, HERE, Google), no paths (GraphHopper), no trip '
     '(Valhalla), no type (GeoJSON) and no segments; its keys are: a'),
    ('[{"a": []}]', 'segment 1: has no figures; its keys are: a'),
    ('{"message": "Point 0 is out of bounds", "hints": []}',
     "the service found no route: 'Point 0 is out of bounds'"),
    ('{"error": {"code": 403, "message": "no key"}}', "the service found no route: 'no key'"),
    ('{"routes": [{"legs": [{"distanceMeters": 5000, "duration": "soon"}]}]}',
     "routes[0].legs[0].duration: must be a number, not 'soon'"),
    ('{"routes": [{"sections": [{"summary": {"length": 9, "duration": 9}, "polyline": "BF*"}]}]}',
     "routes[0].sections[0].polyline: character 3, '*', does not belong to an encoded polyline"),
    ('{"response": {"route": [{"leg": [{"length": 9, "travelTime": 9}], "shape": ["48.1,11.5.8"]}]}}',
     'response.route[0].shape[0]: must be [longitude, latitude], or an object'),
    ('{"distance": 9, "duration": 9, "geometry": "_"}', 'route.geometry: the encoded polyline is cut off'),
    ('{"paths": [{"distance": 5000, "time": 300000, "points": {"coordinates": [[11, 48]]}}]}',
     'paths[0].points.coordinates: has 1 points; at least 2 are needed'),
    ('{"distance": 24.9, "duration": 1200, "geometry": [[11.0, 48.0], [11.3, 48.0]]}',
     'the lengths of the routingpy route add up to 0.0249 km, its line on the map to 22.3 km; ask the service for '
     'lengths in metres'),
    ('{"code": "NoRoute", "message": "Impossible"}', "the service found no route: 'Impossible'"),
    ('{"routes": [{"legs": [{"steps": []}]}]}',
     'routes[0]: has no length and duration of its legs; ask the service'),
    ('{"notices": [{"code": "noRouteFound"}], "routes": []}', 'routes: is empty; the service found no route'),
    ('{"code": "Ok", "routes": []}', 'routes: is empty; the service found no route'),
    ('{"trip": {"status": 442, "status_message": "No path"}}', "the service found no route: 'No path'"),
    ('{"error_code": 171, "error": "No suitable edges"}', "the service found no route: 'No suitable edges'"),
    ('{"type": "Point", "coordinates": [1, 2]}', "has no LineString; its type is 'Point'"),
    ('<?xml version="1.0"?><kml><Document/></kml>', 'the element <kml> is no route that can be read'),
    ('<?xml version="1.0"?>', 'is not XML: it has no element'),
    ('<!DOCTYPE gpx [<!ENTITY a "b">]><battery-export>&a;</battery-export>', 'line 1: has a document type'),
    ('<battery-export/>', 'battery-export: has no vehicle with a battery'),
    ('<battery-export><timestep time="x"><vehicle id="a" speed="1" energyConsumed="1"/></timestep>'
     '</battery-export>',
     "timestep 1: time_s: 'x' is not a number"),
    ('<battery-export><timestep time="0"><vehicle id="a" speed="1"/></timestep></battery-export>',
     'line 1: vehicle: missing energyConsumed'),
    ('<battery-export>' + '<a>' * 60, 'line 1: elements are nested more than 50 deep'),
    ('a\0b', 'is a binary file'),
    ('time_s,speed_kmh\n0,0\n0,0\n', 'line 3: time_s: 0 s is not after 0 s of the previous row'),
    ('time_s,speed_kmh\n0,0\n1,500\n', 'line 3: speed_kmh: 500 is not allowed; it must be 0 ... 360'),
    ('time_s,speed_kmh\n0,0\n1,90\n', 'line 3: speed_kmh: changes by 25 m/s^2; at most 12 m/s^2 are plausible'),
    ('time_s,speed_kmh\n0,0\n600,50\n', 'line 3: time_s: 600 s without a sample; at most 60 s are allowed'),
    ('time_s,speed_kmh\n0,0\n', 'has 1 sample; at least 2 are needed'),
    ('time_s,speed_kmh,slope\n0,0,3\n1,1,3\n', 'line 2: slope: 3 is not allowed; it must be -0.4 ... 0.4; '
     'is it in percent? then name it slope_percent'),
    ('duration_s,speed_kmh\n0,50\n', 'line 2: duration_s: 0 is not allowed; it must be 0.001 ... 86400'),
    ('s_km,v_kmh\n2,30\n5,60\n8,80\n9,70\n', 'line 2: s_km: rises from row to row, as a distance from the start '
     'of the trip does, which is not accepted; if it is the length of each segment, name it length_m or '
     'length_km'),
    ('time_s,speed_kmh,t_env\n0,0,3\n', 'has 1 sample; at least 2 are needed'),
    ('speed_kmh,t_env_c\n0,0\n', 'line 1: a route needs time_s and speed_kmh (a drive cycle), or two of'),
    ('length_km,speed_kmh\n1,0\n', 'line 2: speed_kmh: a segment in which the car stands has no length'),
    ('duration_min,length_km,speed_kmh\n10,12,20\n', 'line 2: speed_kmh times duration_min is 3333.33 m, but '
     'length_km is 12000 m; check the units')])
def test_mistakes_are_named(tmp_path, contents, problem):
    found = load(tmp_path, contents if isinstance(contents, bytes) else contents.encode(), COLD)
    assert isinstance(found, InvalidInput)
    assert found.problems[0].removeprefix(str(tmp_path / 'broken')).lstrip(':, ').startswith(problem)


@pytest.mark.parametrize('change, problem', [
    (('lat="47.0000000"', 'lat="97"'), 'trkpt 1: latitude: 97 is not allowed; it must be -90 ... 90 degrees'),
    (('lat="47.0000000"', 'lat="x"'), "trkpt 1: lat: 'x' is not a number"),
    (('lat="47.0000000"', ''), "trkpt 1: lat: '' is not a number"),
    (('<time>', '<time>x'), "trkpt 1: time: 'x2026-"),
    # From the south to the last 107 points no car drives in a few seconds.
    (('lat="47.0', 'lat="4.0'),
     '107 of 400 trkpts would need more than 299 km/h from the previous one; check times and coordinates'),
    # A drive that was recorded before, and a track without times.
    (('</trk>', '</trk>' + examples.gpx().partition('<gpx')[2].partition('>')[2].partition('</gpx>')[0].replace(
        'T07:', 'T06:')), 'trkpt 401: time: is 4597.5 s before that of the previous trkpt, and 400 of 800 do not '
     'fit the others'),
    (('<trk>', examples.gpx(times=False).partition('<gpx')[2].partition('>')[2].partition('</gpx>')[0] + '<trk>'),
     '400 of 800 trkpts have no time, from trkpt 1 on, and with them 19.9 km of 39.9 km would be lost'),
    (('<ele>600.00</ele>', '<ele>60000</ele>'),
     'point 1: elevation: 60000 m is not allowed; it must be -500 ... 9000 m'),
    (('</trkseg>', ''), 'line 404: is not XML: mismatched tag; is the file complete?'),
    (('<trk>', '<wpt lat="1" lon="2"/><metadata/><trk>'), None)])
def test_mistakes_in_gpx_are_named(tmp_path, change, problem):
    found = load(tmp_path, examples.gpx().replace(*change).encode(), COLD)
    if problem is None:
        assert found.route.distance_m == pytest.approx(examples.LENGTH_M, rel=2e-3)
        return
    assert found.problems[0].removeprefix(f'{tmp_path / "broken"}: ').startswith(problem)


def test_a_huge_file_is_not_read(tmp_path):
    path = tmp_path / 'huge.csv'
    with open(path, 'wb') as file:
        file.truncate(10**9)
    with pytest.raises(InvalidInput, match='has 1000 MB; at most 64 MB are read'):
        route_for(path, CAR, options=COLD)
