# SPDX-License-Identifier: Apache-2.0
"""Reads GPX 1.0 and 1.1: a track, or else a route, with or without times and elevations."""

from __future__ import annotations

from datetime import UTC
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require
from bev_preheat.route.sources.timeline import distances_m
from bev_preheat.route.sources.track import journey_of_points
from bev_preheat.route.sources.xml_text import check_xml

if TYPE_CHECKING:
    from bev_preheat.route.sources.journey import Journey, RouteOptions

# Largest share of points without the time that the others have, and of the way that is lost with them.
MOST_WITHOUT_TIME = 0.5
MOST_LOST = 0.02


def read_gpx(text: bytes, options: RouteOptions) -> Journey:
    """Return the Journey of a GPX file; raise InvalidInput naming line or point and what to do."""
    require('gpxpy')
    check_xml(text)
    import gpxpy
    try:
        # gpxpy follows the encoding that the file names.
        contents = gpxpy.parse(text)
    except (gpxpy.gpx.GPXException, ValueError, TypeError, AttributeError, LookupError, OverflowError) as error:
        cause = error.__cause__ or error
        raise InvalidInput(f'is not GPX: {" ".join(str(cause).split())}') from error
    remarks: list[str] = []
    kind, element, points = _points(contents, remarks)
    times = [point.time for point in points]
    without = sum(time is None for time in times)
    has_times = without <= MOST_WITHOUT_TIME * len(points)
    if has_times and without:
        kept = [at for at, time in enumerate(times) if time is not None]
        # Between points with times the way is at least bridged by a line.
        inner, timed = points[kept[0]:kept[-1] + 1], [points[at] for at in kept]
        lost_m = (_length_m(points[:kept[0]]) + _length_m(points[kept[-1] + 1:])
                  + _length_m(inner) - _length_m(timed))
        points, all_m = timed, _length_m(timed) + lost_m
        if lost_m > MOST_LOST * all_m:
            raise InvalidInput(f'{without} of {without + len(points)} {element}s have no time, from {element} '
                               f'{times.index(None) + 1} on, and with them {lost_m / 1e3:.1f} km of '
                               f'{all_m / 1e3:.1f} km would be lost; take out the part without times, or take out '
                               'all times and give --free-speed')
        remarks.append(f'{without} {element}s without a time are left out, {lost_m:.0f} m of {all_m / 1e3:.1f} km')
    if not has_times and without < len(points):
        remarks.append(f'only {len(points) - without} of {len(points)} points have a time: times are not used')
    try:
        time_s = None if not has_times else np.array([_seconds(point.time) for point in points])
    except (ValueError, OverflowError, OSError) as error:
        raise InvalidInput(f'a time is not valid: {error}') from error
    if time_s is not None and len(time_s) and time_s[0] == time_s[-1]:
        remarks.append('all points have the same time: times are not used')
        time_s = None
    return journey_of_points(
        kind, np.array([float(point.latitude) for point in points]),
        np.array([float(point.longitude) for point in points]),
        np.array([np.nan if point.elevation is None else float(point.elevation) for point in points]),
        time_s, options, remarks, element)


def _points(contents: Any, remarks: list[str]) -> tuple[str, str, list[Any]]:
    """Return the kind, the name of an element, and the points of the track, or of the route."""
    tracks = [[point for segment in track.segments for point in segment.points] for track in contents.tracks]
    routes = [route.points for route in contents.routes]
    for kind, element, lines in (('GPX track', 'trkpt', tracks), ('GPX route', 'rtept', routes)):
        lines = [points for points in lines if points]
        if lines:
            if len(lines) > 1:
                remarks.append(f'{len(lines)} {kind.removeprefix("GPX ")}s are joined in their order')
            return kind, element, [point for points in lines for point in points]
    more = f'; it has {len(contents.waypoints)} waypoints (wpt), which are no route' if contents.waypoints else ''
    raise InvalidInput(f'has no track (trk) and no route (rte) with points{more}')


def _length_m(points: list[Any]) -> float:
    latitude_deg, longitude_deg = (np.array([float(getattr(point, name)) for point in points])
                                   for name in ('latitude', 'longitude'))
    return float(distances_m(latitude_deg, longitude_deg).sum())


def _seconds(time: Any) -> float:
    return float((time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp())
