# SPDX-License-Identifier: Apache-2.0
"""One winding road of 20 km with hills, in each format that navigation and loggers give."""

from datetime import datetime, timedelta, UTC
import json
import math

import numpy as np

from bev_preheat.numerics import EARTH_RADIUS_M

POINTS, STEP_M, SPEED_MPS = 400, 50.0, 20.0
LENGTH_M = (POINTS - 1) * STEP_M
START = datetime(2026, 1, 10, 7, tzinfo=UTC)


def road():
    """Return latitudes, longitudes [deg] and elevations [m] of points STEP_M apart, shapes (POINTS,)."""
    heading = 0.6 + 0.5 * np.sin(np.arange(POINTS - 1) / 40.0)
    latitude = 47.0 + np.degrees(np.concatenate(([0.0], np.cumsum(STEP_M * np.cos(heading)))) / EARTH_RADIUS_M)
    east = STEP_M * np.sin(heading) / np.cos(np.radians(latitude[:-1]))
    longitude = 11.0 + np.degrees(np.concatenate(([0.0], np.cumsum(east))) / EARTH_RADIUS_M)
    return latitude, longitude, 600.0 + 100.0 * np.sin(np.arange(POINTS) / 60.0)


LATITUDE, LONGITUDE, ELEVATION = road()


def gpx(times=True, element='trkpt', stop_s=0.0):
    """Return a GPX file; after half of the way the car stands for `stop_s`."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             '<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">']
    lines.append('<trk><trkseg>' if element == 'trkpt' else '<rte>')
    for at in range(POINTS):
        middle = POINTS // 2
        for waited_s in (0.0, stop_s) if stop_s and at == middle else (stop_s,) if at > middle else (0.0,):
            moment = START + timedelta(seconds=STEP_M / SPEED_MPS * at + waited_s)
            time = f'<time>{moment.strftime("%Y-%m-%dT%H:%M:%S.%fZ")}</time>' if times else ''
            lines.append(f'<{element} lat="{LATITUDE[at]:.7f}" lon="{LONGITUDE[at]:.7f}">'
                         f'<ele>{ELEVATION[at]:.2f}</ele>{time}</{element}>')
    lines.append('</trkseg></trk></gpx>' if element == 'trkpt' else '</rte></gpx>')
    return '\n'.join(lines)


def positions_csv(times=True):
    """Return a table of positions, as loggers write them."""
    moments = [(START + timedelta(seconds=STEP_M / SPEED_MPS * at)).isoformat() for at in range(POINTS)]
    return '\n'.join([f'{"timestamp," * times}lat,Longitude [deg],altitude_m,satellites', *(
        f'{f"{moment}," * times}{latitude:.7f},{longitude:.7f},{elevation:.2f},9'
        for moment, latitude, longitude, elevation in zip(moments, LATITUDE, LONGITUDE, ELEVATION))])


def polyline(places, with_elevation=False):
    """Return the road as an encoded polyline; GraphHopper's elevations have two places."""
    points = zip(LATITUDE, LONGITUDE, *([ELEVATION] if with_elevation else []))
    return ''.join(chr(code + 63) for value in zigzags(points, (places, places, 2)) for code in groups(value))


def flexible_polyline():
    """Return the road in HERE's format: five places, elevations in metres as the third dimension."""
    signs = 'ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_'
    values = [1, 5 | 3 << 4, *zigzags(zip(LATITUDE, LONGITUDE, ELEVATION), (5, 5, 0))]
    return ''.join(signs[code] for value in values for code in groups(value))


def zigzags(points, places):
    """Yield the differences of points as unsigned numbers whose lowest bit is the sign."""
    before = (0, 0, 0)
    for point in points:
        now = tuple(round(value * 10**digits) for value, digits in zip(point, places))
        for new, old in zip(now, before):
            value = (new - old) << 1
            yield ~value if new < old else value
        before = now


def groups(value):
    """Yield the groups of five bits of a number, the lowest first; 32 is added to all but the last."""
    while value >= 0x20:
        yield 0x20 | (value & 0x1f)
        value >>= 5
    yield value


GEOMETRIES = {
    'polyline': lambda: polyline(5), 'polyline6': lambda: polyline(6),
    'geojson': lambda: {'type': 'LineString', 'coordinates': [*map(list, zip(LONGITUDE, LATITUDE))]}}


def osrm(legs=1, annotations=True, geometry='polyline'):
    """Return an answer of OSRM; the legs' durations exceed those of the edges by a tenth."""
    contents = []
    for edges in np.array_split(np.full(POINTS - 1, STEP_M), legs):
        durations = edges / SPEED_MPS / 1.1
        leg = {'distance': float(edges.sum()), 'duration': float(edges.sum() / SPEED_MPS), 'summary': '',
               'steps': [{'distance': float(part.sum()), 'duration': float(part.sum() / SPEED_MPS)}
                         for part in np.array_split(edges, 3)]}
        if annotations:
            leg['annotation'] = {'distance': edges.tolist(), 'duration': durations.tolist()}
        contents.append(leg)
    route = {'legs': contents, 'distance': LENGTH_M, 'duration': LENGTH_M / SPEED_MPS,
             'geometry': GEOMETRIES[geometry]()}
    return json.dumps({'code': 'Ok', 'routes': [route], 'waypoints': []})


def valhalla(units='kilometers'):
    metres = {'kilometers': 1000.0, 'miles': 1609.344}[units]
    maneuvers = [{'length': share * LENGTH_M / metres, 'time': share * LENGTH_M / SPEED_MPS, 'type': 1}
                 for share in (0.25, 0.35, 0.4, 0.0)]
    return json.dumps({'trip': {'status': 0, 'units': units, 'legs': [
        {'maneuvers': maneuvers, 'shape': polyline(6), 'summary': {
            'length': LENGTH_M / metres, 'time': LENGTH_M / SPEED_MPS}}]}})


def halves():
    """Return the points of the first and of the second half of the road, as (latitude, longitude)."""
    points = list(zip(LATITUDE.tolist(), LONGITUDE.tolist()))
    return points[:POINTS // 2 + 1], points[POINTS // 2:]


HALF_M = (POINTS // 2 * STEP_M, LENGTH_M - POINTS // 2 * STEP_M)


def tomtom(charging_s=None, progress=False):
    """Return an answer of TomTom with two legs, between them a charging stop of `charging_s`."""
    legs = [{'summary': {'lengthInMeters': length_m, 'travelTimeInSeconds': length_m / SPEED_MPS},
             'points': [{'latitude': latitude, 'longitude': longitude} for latitude, longitude in points]}
            for length_m, points in zip(HALF_M, halves())]
    if charging_s is not None:
        legs[0]['summary']['chargingInformationAtEndOfLeg'] = {'chargingTimeInSeconds': charging_s}
    route = {'summary': {'lengthInMeters': LENGTH_M}, 'legs': legs}
    if progress:
        # The first quarter of the way is driven more than twice as fast as the second.
        route['progress'] = [
            {'distanceInMeters': share_m * LENGTH_M, 'travelTimeInSeconds': share_s * LENGTH_M / SPEED_MPS}
            for share_m, share_s in ((0.0, 0.0), (0.25, 0.15), (0.5, 0.5), (1.0, 1.0))]
        for each in route['progress']:
            each['travelTimeInSeconds'] += (charging_s or 0.0) * (each['distanceInMeters'] > HALF_M[0])
    return json.dumps({'formatVersion': '0.0.12', 'routes': [route]})


def here(charging_s=None, of_travel=True):
    """Return an answer of HERE; its `summary` includes charging and 120 s of preparing to charge."""
    section = {'type': 'vehicle', 'polyline': flexible_polyline()}
    drive_s = LENGTH_M / SPEED_MPS
    if of_travel:
        section['travelSummary'] = {'length': LENGTH_M, 'duration': drive_s}
    waits = [] if charging_s is None else [{'action': 'chargingSetup', 'duration': 120},
                                           {'action': 'charging', 'duration': charging_s}]
    section['summary'] = {'length': LENGTH_M, 'duration': drive_s + sum(wait['duration'] for wait in waits)}
    section['postActions'] = waits
    after = {'type': 'vehicle', 'summary': {'length': 2000.0, 'duration': 200.0}}
    return json.dumps({'routes': [{'id': 'a', 'sections': [section] if charging_s is None else [section, after]}]})


def here_7():
    """Return an answer of HERE's version 7, with a line of texts."""
    maneuvers = [{'length': share * LENGTH_M, 'travelTime': share * LENGTH_M / SPEED_MPS}
                 for share in (0.25, 0.75)]
    return json.dumps({'response': {'metaInfo': {}, 'route': [{
        'shape': [f'{latitude},{longitude}' for latitude, longitude in zip(LATITUDE, LONGITUDE)],
        'leg': [{'length': LENGTH_M, 'travelTime': LENGTH_M / SPEED_MPS, 'maneuver': maneuvers}]}]}})


def google(legacy=False):
    """Return an answer of Google's Routes or, `legacy`, Directions; with traffic 1.25 times the steps' times."""
    shares, drive_s = (0.25, 0.35, 0.4), LENGTH_M / SPEED_MPS
    if legacy:
        steps = [{'distance': {'text': '', 'value': share * LENGTH_M}, 'duration': {
            'text': '', 'value': share * drive_s / 1.25}} for share in shares]
        return json.dumps({'status': 'OK', 'geocoded_waypoints': [], 'routes': [{
            'overview_polyline': {'points': polyline(5)}, 'legs': [{
                'distance': {'value': LENGTH_M}, 'duration': {'value': drive_s / 1.25},
                'duration_in_traffic': {'value': drive_s}, 'steps': steps}]}]})
    steps = [{'distanceMeters': share * LENGTH_M, 'staticDuration': f'{share * drive_s / 1.25}s'}
             for share in shares]
    return json.dumps({'routes': [{'distanceMeters': LENGTH_M, 'duration': f'{drive_s}s', 'polyline': {
        'encodedPolyline': polyline(5)}, 'legs': [
            {'distanceMeters': LENGTH_M, 'duration': f'{drive_s}s', 'steps': steps}]}]})


def graphhopper(points='encoded'):
    """Return an answer of GraphHopper; times in milliseconds."""
    forms = {'encoded': lambda: polyline(5), 'elevation': lambda: polyline(5, True),
             'plain': lambda: json.loads(geojson('LineString', times=False))}
    milliseconds = 1e3 * LENGTH_M / SPEED_MPS
    return json.dumps({'info': {}, 'paths': [{
        'distance': LENGTH_M, 'time': milliseconds, 'points_encoded': points != 'plain', 'points': forms[points](),
        'instructions': [{'distance': share * LENGTH_M, 'time': share * milliseconds, 'interval': [0, 1]}
                         for share in (0.25, 0.35, 0.4, 0.0)]}]})


def routingpy():
    """Return a route as the Python package of this name holds it."""
    return json.dumps({'distance': LENGTH_M, 'duration': LENGTH_M / SPEED_MPS,
                       'geometry': [[longitude, latitude] for half in halves() for latitude, longitude in half]})


def geojson(kind='Feature', times=True):
    """Return a GeoJSON object with the elevation as third coordinate."""
    coordinates = [[longitude, latitude, elevation] for longitude, latitude, elevation in zip(
        LONGITUDE.tolist(), LATITUDE.tolist(), ELEVATION.tolist())]
    properties = {'coordTimes': [(START + timedelta(seconds=STEP_M / SPEED_MPS * at)).isoformat()
                                 for at in range(POINTS)]} if times else {}
    line = {'type': 'LineString', 'coordinates': coordinates}
    feature = {'type': 'Feature', 'properties': properties, 'geometry': line}
    return json.dumps({'LineString': line, 'Feature': feature,
                       'FeatureCollection': {'type': 'FeatureCollection', 'features': [feature]}}[kind])


def openrouteservice(units='m'):
    """Return GeoJSON with the durations of openrouteservice."""
    contents = json.loads(geojson(times=False))
    length = LENGTH_M / {'m': 1.0, 'km': 1000.0, 'mi': 1609.344}[units]
    step = {'distance': length / 2, 'duration': LENGTH_M / SPEED_MPS / 2, 'way_points': [0, 1]}
    contents['properties'] = {'segments': [{'distance': length, 'duration': LENGTH_M / SPEED_MPS,
                                            'steps': [step, step]}]}
    return json.dumps(contents | {'metadata': {'query': {'units': units}}})


def sumo(vehicles=('ev',)):
    """Return the battery output of SUMO: each vehicle accelerates to SPEED_MPS and draws 5 kW."""
    steps = []
    for second in range(200):
        inside = ''.join(f'<vehicle id="{name}" energyConsumed="{5000.0 / 3600.0:.6f}" speed="'
                         f'{min(float(second), SPEED_MPS)}" chargingStationId="NULL"/>' for name in vehicles)
        steps.append(f'<timestep time="{second}.00">{inside}</timestep>')
    return '<?xml version="1.0"?>\n<!-- <made> by a test -->\n<battery-export>\n' + '\n'.join(steps) + \
        '\n</battery-export>\n'


def fastsim():
    """Return a cycle of FASTSim: up to SPEED_MPS, half a minute at this speed, and down again."""
    speeds = [*range(0, 21), *[SPEED_MPS] * 30, *range(20, -1, -1)]
    return 'cycSecs,cycMps,cycGrade,cycRoadType\n' + ''.join(
        f'{second},{speed},0.01,0\n' for second, speed in enumerate(speeds))


def speed_table():
    """Return a table of a drive cycle, with the header of a WLTC table."""
    return 'time_s,speed_kmh\n' + ''.join(
        f'{second},{36.0 * (1.0 - math.cos(second / 15.0)):.2f}\n' for second in range(300))


def segments_json():
    """Return a list of segments of a route planner, with consumption."""
    return json.dumps({'segments': [
        {'distance_km': 12.0, 'duration_min': 10.0, 'elevation_m': 500.0, 'energy_kwh': 2.5, 'name': 'motorway'},
        {'distance_km': 30.0, 'duration_min': 18.0, 'elevation_m': 400.0, 'energy_kwh': 5.1, 'name': None}]})


def segments_csv():
    """Return a list of segments as a spreadsheet with decimal commas writes it."""
    return 'Distance [km];Duration [min];Average speed [km/h];Elevation [m]\r\n' \
        '12;10;72;500\r\n30,5;18;101,7;400\r\n'
