# SPDX-License-Identifier: Apache-2.0
"""Builds a Route from legs of road (legs_schema.yaml), driven by a given car: a fine drive, joined to segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np

from bev_preheat.errors import InvalidInput, located
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.input_files import find_configuration
from bev_preheat.numerics import first_true, JOULES_PER_WH
from bev_preheat.route.kinematics import drive_along, lay_track, leg_starts_m, RoadDrive, RoadLeg
from bev_preheat.route.road_load import battery_power_w, loaded, RoadForces, wheel_power_w
from bev_preheat.route.segments import ELEVATION_RANGE_M, LONGEST_ROUTE_S, make_route, Route
from bev_preheat.vehicle.description import Vehicle

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
