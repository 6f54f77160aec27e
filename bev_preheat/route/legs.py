# SPDX-License-Identifier: Apache-2.0
"""
Builds a Route from legs of road (legs_schema.yaml), driven by a given car: a fine drive, joined to segments.

The car's speed follows from speed limits, stops and comfortable accelerations. It is computed over distance,
because limits and stops have fixed places: the square of the speed may rise by 2 a ds and fall by 2 b ds over a
cell of length ds. Braking in time is then one pass from the end to the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from math import inf
from pathlib import Path

import numpy as np

from bev_preheat.errors import InvalidInput, located
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.input_files import find_configuration
from bev_preheat.numerics import first_true, FloatArray, JOULES_PER_WH
from bev_preheat.route.road_load import battery_power_w, loaded, RoadForces, wheel_power_w
from bev_preheat.route.segments import ELEVATION_RANGE_M, LONGEST_ROUTE_S, make_route, Route
from bev_preheat.vehicle.description import Vehicle

# Longest cell [m] over which the acceleration is constant.
CELL_M = 2.0


@dataclass(frozen=True)
class RoadLeg:
    """
    A stretch of road with one speed limit and one slope.

    `slope` is rise over run; `stops` are spread evenly between the ends of the leg. Traffic reduces the speed
    limit by a random share between 0 and `traffic_slowdown`, redrawn every
    `traffic_length_m` and interpolated linearly. The ambient temperature is linear from start to end.
    """

    length_m: float
    speed_limit_mps: float
    slope: float = 0.0
    stops: int = 0
    stop_duration_s: float = 0.0
    traffic_slowdown: float = 0.0
    traffic_length_m: float = 300.0
    ambient_at_start_c: float = 0.0
    ambient_at_end_c: float = 0.0


@dataclass(frozen=True)
class Track:
    """Allowed speeds at M points along the road; arrays of shape (M,)."""

    distance_m: FloatArray
    allowed_speed_mps: FloatArray
    standstill_s: FloatArray


@dataclass(frozen=True)
class RoadDrive:
    """Instants of a drive, with constant acceleration in between; arrays of shape (K,)."""

    time_s: FloatArray
    distance_m: FloatArray
    speed_mps: FloatArray

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (distance [m], speed [m/s]) at instants [s]; shapes follow the input."""
        cell = np.searchsorted(self.time_s, time_s, side='right') - 1
        cell = np.clip(cell, 0, len(self.time_s) - 2)
        since_s = time_s - self.time_s[cell]
        start_mps = self.speed_mps[cell]
        acceleration_mps2 = ((self.speed_mps[cell + 1] - start_mps) / (self.time_s[cell + 1] - self.time_s[cell]))
        speed_mps = start_mps + acceleration_mps2 * since_s
        return self.distance_m[cell] + 0.5 * (start_mps + speed_mps) * since_s, speed_mps


def lay_track(legs: Sequence[RoadLeg], seed: int) -> Track:
    """Return the Track of RoadLegs, standstill to standstill; `seed` is that of the traffic's random numbers."""
    random = np.random.default_rng(seed)
    # A point between two legs belongs to both, and the lower speed applies: each leg contributes both of its
    # ends, and duplicate points are merged below.
    pieces = [_points(leg, start_m, random) for leg, start_m in zip(legs, leg_starts_m(legs))]
    distance_m, allowed_mps, standstill_s = (np.concatenate(column) for column in zip(*pieces))
    first = np.flatnonzero(np.diff(distance_m, prepend=-1.0) > 0.0)
    allowed_mps = np.minimum.reduceat(allowed_mps, first)
    allowed_mps[[0, -1]] = 0.0
    return Track(distance_m[first], allowed_mps, np.maximum.reduceat(standstill_s, first))


def leg_starts_m(legs: Sequence[RoadLeg]) -> list[float]:
    """Return the start of each leg and the end of the last one [m], a list of L + 1."""
    return list(accumulate((leg.length_m for leg in legs), initial=0.0))


def drive_along(track: Track, acceleration_mps2: float, deceleration_mps2: float, pace: float = 1.0) -> RoadDrive:
    """Return the fastest RoadDrive within accelerations [m/s^2] and the speeds of a Track times `pace`."""
    at_m = track.distance_m
    squared = (pace * track.allowed_speed_mps)**2
    rise = 2.0 * acceleration_mps2 * at_m
    squared = np.minimum.accumulate(squared - rise) + rise
    fall = 2.0 * deceleration_mps2 * at_m
    squared = (np.minimum.accumulate((squared + fall)[::-1])[::-1]) - fall
    # Rounding leaves a small value of either sign at a stop.
    stops = track.allowed_speed_mps == 0.0
    speed_mps = np.sqrt(np.where(stops, 0.0, np.maximum(squared, 0.0)))

    moving_s = 2.0 * np.diff(at_m) / (speed_mps[:-1] + speed_mps[1:])
    waited_s = np.cumsum(track.standstill_s)
    arrival_s = np.concatenate(([0.0], np.cumsum(moving_s) + waited_s[:-1]))
    waits = track.standstill_s > 0.0
    departure_s = arrival_s[waits] + track.standstill_s[waits]
    copies = 1 + waits
    return RoadDrive(
        time_s=np.sort(np.concatenate((arrival_s, departure_s)), kind='stable'),
        distance_m=np.repeat(at_m, copies), speed_mps=np.repeat(speed_mps, copies))


def _points(leg: RoadLeg, start_m: float,
            random: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance, allowed speed and standstill at the points of a leg, including its ends."""
    # Stops must be points, with at least one moving point in between.
    between_m = leg.length_m / (leg.stops + 1)
    cells = max(2, int(np.ceil(between_m / CELL_M)))
    along_m = np.linspace(0.0, leg.length_m, cells * (leg.stops + 1) + 1)
    knots = int(np.ceil(leg.length_m / leg.traffic_length_m)) + 1
    # Uniform random numbers: the streams of other distributions may change between NumPy releases.
    share = np.interp(along_m, leg.traffic_length_m * np.arange(knots), random.random(knots))
    allowed_mps = leg.speed_limit_mps * (1.0 - leg.traffic_slowdown * share)
    standstill_s = np.zeros_like(along_m)
    at_stops = np.arange(1, leg.stops + 1) * cells
    allowed_mps[at_stops] = 0.0
    standstill_s[at_stops] = leg.stop_duration_s
    return start_m + along_m, allowed_mps, standstill_s


SCHEMA = Path(__file__).with_name('legs_schema.yaml')

# Longest step [s] of the simulation.
SPEED_STEP_S = 0.5
# A remainder of up to this share of a step is merged into the previous step.
SLIVER = 0.05
# Range in which calibration may scale speeds and powers: beyond it, the description does not fit the totals.
PACE_RANGE = (0.7, 1.4)
POWER_SCALE_RANGE = (0.5, 2.0)
# Comfortable accelerations [m/s^2], used if the description gives none.
DEFAULT_ACCELERATION_MPS2 = 1.0


@dataclass(frozen=True)
class LegsRoute:
    """The Route of a description, its name, and remarks on its calibration."""

    route: Route
    name: str
    remarks: tuple[str, ...]


def legs_file(name_or_file: str | Path) -> Path:
    """Return the path of a description of legs; raise InvalidInput if it does not exist."""
    return find_configuration('routes/legs', name_or_file, '.yaml')


def load_legs(name_or_file: str | Path, vehicle: Vehicle) -> LegsRoute:
    """Return the LegsRoute of a name in config/routes/legs or a YAML file for a vehicle; refuse wrong keys."""
    path = legs_file(name_or_file)
    description = load_checked_yaml(path, SCHEMA)
    remarks: list[str] = []
    with located(path):
        load = RoadForces(**{key: float(value) for key, value in description.get('load', {}).items()})
        car = loaded(vehicle, load, float(description.get('maximum_regeneration_power_w', inf)))
        legs = _legs(description, remarks)
        drive = _drive(description, legs, remarks)
        segment_s = float(description.get('segment_duration_s', 30.0))
        route = _simulate(description, car, legs, drive, segment_s).resampled(segment_s)
        if not description.get('within_segment_variation', True):
            route = route.without_variation()
        if 'propulsion_energy_wh' in description:
            route = _with_energy(route, vehicle, description['propulsion_energy_wh'], remarks)
    return LegsRoute(route, description['name'], tuple(remarks))


def _legs(description: dict[str, FileData], remarks: list[str]) -> list[RoadLeg]:
    """Return the legs of the description, in SI units, scaled to `distance_m`."""
    nodes = description['legs']
    scale = 1.0
    if 'distance_m' in description:
        described_m = sum(node['length_m'] for node in nodes)
        scale = description['distance_m'] / described_m
        if scale != 1.0:
            remarks.append(f'the legs, {described_m:g} m, are scaled by {scale:.4f} to '
                           f'{description["distance_m"]:g} m')
    problems, legs = [], []
    for index, node in enumerate(nodes):
        ambient_c = node.get('ambient_temperature_c', description.get('ambient_temperature_c'))
        if ambient_c is None:
            problems.append(f'legs[{index}]: missing ambient_temperature_c; give it here '
                            'or at the top, for all legs')
            continue
        if node.get('stops', 0) and 'stop_duration_s' not in node:
            problems.append(f'legs[{index}]: missing stop_duration_s, with {node["stops"]} stops')
            continue
        start_c, end_c = ambient_c if isinstance(ambient_c, list) else (ambient_c, ambient_c)
        legs.append(RoadLeg(
            length_m=scale * node['length_m'],
            speed_limit_mps=node['speed_limit_kmh'] / 3.6,
            slope=node.get('slope_percent', 0.0) / 100.0,
            stops=node.get('stops', 0),
            stop_duration_s=float(node.get('stop_duration_s', 0.0)),
            traffic_slowdown=node.get('traffic_slowdown_percent', 0.0) / 100.0,
            traffic_length_m=float(description.get('traffic_length_m', 300.0)),
            ambient_at_start_c=float(start_c),
            ambient_at_end_c=float(end_c)))
    if problems:
        raise InvalidInput(problems)
    least_s = sum(leg.length_m / leg.speed_limit_mps + leg.stops * leg.stop_duration_s for leg in legs)
    # Simulating a trip that is far too long would take minutes.
    if least_s > LONGEST_ROUTE_S:
        raise InvalidInput(f'legs: the trip lasts at least {least_s:.0f} s; at most '
                           f'{LONGEST_ROUTE_S:g} s are planned')
    return legs


def _drive(description: dict[str, FileData], legs: Sequence[RoadLeg], remarks: list[str]) -> RoadDrive:
    """Return the drive along the legs, scaled to `duration_s`; the same for every car."""
    track = lay_track(legs, description.get('seed', 0))
    style = description.get('driving', {})
    acceleration_mps2, deceleration_mps2 = (
        float(style.get(key, DEFAULT_ACCELERATION_MPS2))
        for key in ('acceleration_mps2', 'deceleration_mps2'))

    def at_pace(pace: float) -> RoadDrive:
        return drive_along(track, acceleration_mps2, deceleration_mps2, pace)

    if 'duration_s' not in description:
        return at_pace(1.0)
    wanted_s = float(description['duration_s'])
    slow, fast = PACE_RANGE
    slowest_s, fastest_s = (at_pace(pace).time_s[-1] for pace in PACE_RANGE)
    if not fastest_s <= wanted_s <= slowest_s:
        raise InvalidInput(
            f'duration_s: {wanted_s:g} cannot be reached; with speeds scaled by {fast:g} ... '
            f'{slow:g} the trip lasts {fastest_s:.0f} ... {slowest_s:.0f} s')
    # Bisection: the duration falls with the pace, with kinks at the acceleration limits.
    while fast - slow > 1e-12:
        pace = 0.5 * (slow + fast)
        slow, fast = (pace, fast) if at_pace(pace).time_s[-1] > wanted_s else (slow, pace)
    remarks.append(f'speeds are scaled by {fast:.4f} for a duration of {wanted_s:g} s')
    drive = at_pace(fast)
    # Bisection leaves a rounding error.
    return replace(drive, time_s=drive.time_s * (wanted_s / drive.time_s[-1]))


def _simulate(description: dict[str, FileData], car: Vehicle, legs: Sequence[RoadLeg],
              drive: RoadDrive, segment_s: float) -> Route:
    """
    Return the Route of a loaded car in steps of about SPEED_STEP_S, a whole number per segment.

    Refuses a power above the drivetrain's, because the car would be slower than described.
    """
    step_s = segment_s / np.ceil(segment_s / SPEED_STEP_S)
    end_s = drive.time_s[-1]
    steps = max(1, int(np.ceil(end_s / step_s - SLIVER)))
    time_s = step_s * np.arange(steps + 1)
    time_s[-1] = end_s
    duration_s = np.diff(time_s)
    distance_m, speed_mps = drive.at(time_s)

    starts_m = np.array(leg_starts_m(legs))
    rise = np.array([leg.slope / np.hypot(1.0, leg.slope) for leg in legs])
    elevations_m = description.get('start_elevation_m', 0.0) + np.concatenate(
        ([0.0], np.cumsum(rise * np.diff(starts_m))))
    low_m, high_m = ELEVATION_RANGE_M
    if (at := first_true((elevations_m < low_m) | (elevations_m > high_m))) is not None:
        raise InvalidInput(f'legs[{at - 1}]: ends {elevations_m[at]:.0f} m above sea level; '
                           f'it must be {low_m:g} ... {high_m:g}')
    middle_m = 0.5 * (distance_m[:-1] + distance_m[1:])
    leg_of = np.clip(np.searchsorted(starts_m, middle_m, side='right') - 1, 0, len(legs) - 1)
    along = (middle_m - starts_m[leg_of]) / np.diff(starts_m)[leg_of]
    from_c = np.array([leg.ambient_at_start_c for leg in legs])[leg_of]
    to_c = np.array([leg.ambient_at_end_c for leg in legs])[leg_of]
    ambient_c = from_c + along * (to_c - from_c)

    at_wheels_w = wheel_power_w(
        car, duration_s, distance_m, speed_mps,
        elevation_m=np.interp(distance_m, starts_m, elevations_m),
        slope=np.array([leg.slope for leg in legs])[leg_of],
        ambient_temperature_c=ambient_c,
        headwind_mps=description.get('headwind_mps', 0.0))
    power_w = battery_power_w(car, at_wheels_w)
    most_w, at = car.drivetrain.maximum_power_w, int(np.argmax(power_w))
    if power_w[at] > most_w:
        raise InvalidInput(
            f'legs: vehicle {car.name!r} would need {power_w[at] / 1e3:.0f} kW at km '
            f'{middle_m[at] / 1e3:.1f}; its drivetrain.maximum_power_w is {most_w:g} W; lower '
            'driving.acceleration_mps2 or the speed limit there')
    columns = {
        'duration_s': duration_s,
        'speed_mps': np.diff(distance_m) / duration_s,
        'propulsion_power_w': power_w,
        'ambient_temperature_c': ambient_c,
    }
    for key in ('cabin_heating_power_w', 'auxiliary_power_w'):
        if key in description:
            columns[key] = [description[key]]
    return make_route(columns, car.defaults)


def _with_energy(route: Route, vehicle: Vehicle, energy: dict[str, FileData], remarks: list[str]) -> Route:
    """Return the Route with driving and regenerated powers scaled to energies [Wh], if they are this car's."""
    if vehicle.name != energy['vehicle']:
        remarks.append(f'propulsion_energy_wh belongs to vehicle {energy["vehicle"]}, not to '
                       f'{vehicle.name}: its powers are not scaled')
        return route
    # The integrals of |P| and of P.
    total_magnitude, net = energy['total_magnitude'], energy['net']
    if abs(net) > total_magnitude:
        raise InvalidInput(f'propulsion_energy_wh.net: {net:g} is not allowed; its magnitude must '
                           f'be at most total_magnitude, {total_magnitude:g}')
    power_w = route.propulsion_power_w
    scales = np.ones(len(route))
    for what, chosen, wanted_wh in (
            ('driving', power_w > 0.0, 0.5 * (total_magnitude + net)),
            ('regenerating', power_w < 0.0, 0.5 * (total_magnitude - net))):
        energy_wh = float(np.abs(power_w[chosen]) @ route.duration_s[chosen]) / JOULES_PER_WH
        if energy_wh == wanted_wh == 0.0:
            continue
        low, high = POWER_SCALE_RANGE
        if not low * energy_wh <= wanted_wh <= high * energy_wh:
            raise InvalidInput(
                f'propulsion_energy_wh: {wanted_wh:g} Wh {what} cannot be reached; the segments have '
                f'{energy_wh:.1f} Wh, which may be scaled by {low:g} ... {high:g}')
        scales[chosen] = wanted_wh / energy_wh
        remarks.append(f'powers of {what} segments, {energy_wh:.1f} Wh, are scaled by '
                       f'{wanted_wh / energy_wh:.4f} to {wanted_wh:g} Wh')
    return route.with_propulsion(scales)
