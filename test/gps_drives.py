# SPDX-License-Identifier: Apache-2.0
"""
Drives over roads on the map, and the positions that a receiver would report: independent of the product.

Roads are drawn in a plane [m] and laid on the ellipsoid through earth-centred coordinates, not with radii of
curvature as the product does.
"""

from dataclasses import dataclass
from datetime import datetime, UTC
import math

import numpy as np

from bev_preheat.route.line import RouteLine

A_M, B_M = 6378137.0, 6356752.314245
NS = 1_000_000_000
START_NS = 1_700_000_000 * NS


def on_earth(east_m, north_m, origin=(48.1, 11.5)):
    """Return (latitude, longitude) [deg] of points in the plane that touches the ellipsoid at an origin."""
    latitude, longitude = map(math.radians, origin)
    e2 = 1.0 - (B_M / A_M)**2
    vertical_m = A_M / math.sqrt(1.0 - e2 * math.sin(latitude)**2)
    origin_xyz = np.array([vertical_m * math.cos(latitude) * math.cos(longitude),
                           vertical_m * math.cos(latitude) * math.sin(longitude),
                           vertical_m * (1.0 - e2) * math.sin(latitude)])
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    north = np.array([-math.sin(latitude) * math.cos(longitude), -math.sin(latitude) * math.sin(longitude),
                      math.cos(latitude)])
    x, y, z = origin_xyz[:, None] + np.outer(east, east_m) + np.outer(north, north_m)
    # Bowring (1976): exact to well below a millimetre near the ellipsoid.
    p = np.hypot(x, y)
    theta = np.arctan2(z * A_M, p * B_M)
    second_e2 = (A_M / B_M)**2 - 1.0
    found = np.arctan2(z + second_e2 * B_M * np.sin(theta)**3, p - e2 * A_M * np.cos(theta)**3)
    return np.degrees(found), np.degrees(np.arctan2(y, x))


@dataclass
class Road:
    """Points [m] of a road in the plane, 1 m apart or closer."""

    east_m: np.ndarray
    north_m: np.ndarray
    origin: tuple = (48.1, 11.5)

    @classmethod
    def through(cls, corners, origin=(48.1, 11.5)):
        corners = np.asarray(corners, float)
        pieces = [corners[:1]]
        for begin, end in zip(corners, corners[1:]):
            count = max(1, math.ceil(math.dist(begin, end)))
            pieces.append(begin + (end - begin) * np.arange(1, count + 1)[:, None] / count)
        points = np.concatenate(pieces)
        return cls(points[:, 0], points[:, 1], origin)

    @classmethod
    def winding(cls, length_m, seed):
        """Return a road with smooth random bends, like one over land."""
        random, along_m = np.random.default_rng(seed), np.arange(int(length_m))
        waves_m = (400.0, 1100.0, 2500.0, 6000.0)
        bends = [random.normal(0.0, 0.35) * np.sin(2.0 * math.pi * along_m / wave_m + random.uniform(0.0, 6.3))
                 for wave_m in waves_m]
        heading = np.sum(bends, axis=0)
        return cls(np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)))

    @property
    def along_m(self):
        return np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(self.east_m), np.diff(self.north_m)))))

    @property
    def length_m(self):
        return float(self.along_m[-1])

    def at(self, distance_m):
        along_m = self.along_m
        return np.interp(distance_m, along_m, self.east_m), np.interp(distance_m, along_m, self.north_m)

    def line(self, speed_mps=20.0, spacing_m=25.0):
        """Return the RouteLine that a navigation would have: a vertex every `spacing_m`."""
        at_m = np.linspace(0.0, self.length_m, max(2, round(self.length_m / spacing_m) + 1))
        latitude_deg, longitude_deg = on_earth(*self.at(at_m), self.origin)
        return RouteLine(latitude_deg, longitude_deg, at_m, at_m / speed_mps)


def gnss_errors(count, period_s, seed):
    """Return errors [m], shape (count, 2): a Gauss-Markov process (multipath, atmosphere) and white noise."""
    random = np.random.default_rng(seed)
    keeps = math.exp(-period_s / 60.0)
    errors = np.empty((count, 2))
    state = random.normal(0.0, 4.0, 2)
    for number in range(count):
        errors[number] = state
        state = keeps * state + math.sqrt(1.0 - keeps**2) * random.normal(0.0, 4.0, 2)
    return errors + random.normal(0.0, 1.5, (count, 2))


def gpx(road, speed_mps):
    """Return a GPX 1.1 track along a road, with a point every 50 m and times."""
    at_m = np.linspace(0.0, road.length_m, round(road.length_m / 50.0) + 1)
    points = []
    for latitude_deg, longitude_deg, second in zip(*on_earth(*road.at(at_m), road.origin), at_m / speed_mps):
        time = datetime.fromtimestamp(START_NS / NS + second, UTC).isoformat(timespec='milliseconds')
        points.append(f'<trkpt lat="{latitude_deg:.8f}" lon="{longitude_deg:.8f}"><ele>300</ele>'
                      f'<time>{time.replace("+00:00", "Z")}</time></trkpt>')
    return ('<?xml version="1.0"?><gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">'
            f'<trk><trkseg>{"".join(points)}</trkseg></trk></gpx>')
