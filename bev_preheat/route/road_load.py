# SPDX-License-Identifier: Apache-2.0
"""
Power for driving: forces on a car on the road, and the mean, rms and magnitude of its propulsion power.

A mean speed contains neither the stops nor the accelerations within its segment, so its power is too
low. The specific kinetic power v a (speed times acceleration, per kilogram of the car) is modelled as
a stationary random process (Ornstein-Uhlenbeck) with a standard deviation that depends on the mean speed and
with a correlation time. The theory of its averages (Vanmarcke, Random Fields, 1983, chapter 5) gives
the part that varies within a segment, and the part that is visible from segment to segment. The
visible part is measured: a drive whose segments change more than usual also accelerates more within them.

The constants are fitted to public drive cycles; docs/explanation/road_load.md has the comparison.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FloatArray, IntArray, JOULES_PER_WH
from bev_preheat.vehicle.description import RoadLoad, Vehicle

# Shorter segments are joined to blocks of at least this duration [s]: differences between the mean speeds
# of short segments are those of speed limits on a map, which no car follows at once.
SPEED_BLOCK_S = 20.0
# Standard deviation of v a [m^2/s^3]: proportional to the root of the speed, up to a highest value.
DEVIATION_PER_ROOT_SPEED = 2.0
MOST_DEVIATION = 7.5
CORRELATION_TIME_S = 5.0
# The standard deviation of the speed within a segment is at most this share of the mean speed, and at most
# this speed [m/s].
MOST_SPEED_SHARE = 1.0
MOST_SPEED_DEVIATION_MPS = 13.0
# Share of the variance of v a that is visible in the mean speeds of segments of duration T: a power law
# in T [s], fitted to the same cycles.
VISIBLE_AT_1_S = 4.3
VISIBLE_EXPONENT = -1.2
# Weight of the visible variance against the usual one, reached after several times WEIGHTY blocks, and
# the range of the result.
VISIBLE_WEIGHT = 0.5
WEIGHTY = 8.0
ACTIVITY_RANGE = (0.4, 2.5)
# Samples of the speed that are at most this far apart [s] contain all accelerations.
FULLY_SAMPLED_S = 2.0
LEAST_SPEED_MPS = 0.1


@dataclass(frozen=True)
class SpeedChanges:
    """
    Speeds at the boundaries of N segments, and the variances within them.

    `boundary_speed_mps` has shape (N + 1,); `kinetic_power_variance` (of v a, [m^4/s^6]) and
    `speed_variance_m2ps2` have shape (N,) and are 0 if the car stands or the speed is fully sampled.
    """

    boundary_speed_mps: FloatArray
    kinetic_power_variance: FloatArray
    speed_variance_m2ps2: FloatArray


def speed_changes(duration_s: FloatArray, speed_mps: FloatArray,
                  boundary_speed_mps: FloatArray | None = None) -> SpeedChanges:
    """
    Return the SpeedChanges of N segments with mean speeds, shapes (N,).

    `boundary_speed_mps`, shape (N + 1,), are known speeds at the boundaries, as in a table of samples; without
    them they follow from the mean speeds.
    """
    if boundary_speed_mps is not None:
        visible = 1.0 - _share_within(duration_s)
        kinetic = np.diff(boundary_speed_mps**2) / (2.0 * duration_s)
        within, speed = _variances(duration_s, speed_mps, kinetic, visible)
        hidden = duration_s > FULLY_SAMPLED_S
        return SpeedChanges(boundary_speed_mps, np.where(hidden, within, 0.0), np.where(hidden, speed, 0.0))
    first = _first_of_blocks(duration_s, speed_mps)
    block_s = np.add.reduceat(duration_s, first)
    block_mps = np.add.reduceat(duration_s * speed_mps, first) / block_s
    squared = _between(block_s, block_mps)**2
    kinetic = np.diff(squared) / (2.0 * block_s)
    visible = np.minimum(VISIBLE_AT_1_S * block_s**VISIBLE_EXPONENT, 1.0)
    within, speed = _variances(block_s, block_mps, kinetic, visible)
    # Constant kinetic power within a block: the square of the speed is linear in time.
    block_edges_s = np.concatenate(([0.0], np.cumsum(block_s)))
    edges_s = np.concatenate(([0.0], np.cumsum(duration_s)))
    block_of = np.repeat(np.arange(len(first)), np.diff(first, append=len(duration_s)))
    return SpeedChanges(np.sqrt(np.interp(edges_s, block_edges_s, squared)), within[block_of], speed[block_of])


def _first_of_blocks(duration_s: FloatArray, speed_mps: FloatArray) -> IntArray:
    """Return the index of the first segment of each block; standstills are blocks of their own."""
    if (duration_s >= SPEED_BLOCK_S).all():
        return np.arange(len(duration_s))
    first, length_s, moves = [0], 0.0, speed_mps[0] > 0.0
    for index, (duration, speed) in enumerate(zip(duration_s.tolist(), speed_mps.tolist())):
        if (speed > 0.0) != moves or (moves and length_s >= SPEED_BLOCK_S):
            first.append(index)
            length_s, moves = 0.0, speed > 0.0
        length_s += duration
    if moves and length_s < SPEED_BLOCK_S and len(first) > 1 and speed_mps[first[-1] - 1] > 0.0:
        # A short remainder at the end belongs to the block before it.
        first.pop()
    return np.array(first)


def _between(duration_s: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Return the speeds at the boundaries of blocks with mean speeds; 0 beside a standstill."""
    before, after = speed_mps[:-1], speed_mps[1:]
    total_s = duration_s[:-1] + duration_s[1:]
    inner = (before * duration_s[1:] + after * duration_s[:-1]) / total_s
    inner = np.where((before == 0.0) | (after == 0.0), 0.0, inner)
    # The ends of the route are open: it may be the rest of a drive under way.
    return np.concatenate((speed_mps[:1], inner, speed_mps[-1:]))


def _variances(duration_s: FloatArray, speed_mps: FloatArray, kinetic: FloatArray,
               visible: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return the variances of v a and of the speed within segments, shapes (N,).

    `kinetic` is the mean of v a in each segment, `visible` the expected share of its variance therein.
    """
    usual = np.minimum(DEVIATION_PER_ROOT_SPEED**2 * speed_mps, MOST_DEVIATION**2)
    expected = float((usual * visible) @ duration_s)
    weight = VISIBLE_WEIGHT * len(duration_s) / (len(duration_s) + WEIGHTY)
    activity = 1.0
    if expected > 0.0:
        activity = float(np.clip(
            1.0 - weight + weight * float(kinetic**2 @ duration_s) / expected, *ACTIVITY_RANGE))
    share = _share_within(duration_s)
    within = activity * usual * share
    # The acceleration has the same correlation time; the speed is its integral, a random walk bounded by the
    # mean speed and by speed limits.
    acceleration_variance = activity * usual / np.maximum(speed_mps, LEAST_SPEED_MPS)**2
    walk = acceleration_variance * CORRELATION_TIME_S * duration_s * share / 3.0
    bound = np.maximum(MOST_SPEED_SHARE * speed_mps, 1e-6)**2
    speed = 1.0 / (1.0 / np.maximum(walk, 1e-12) + 1.0 / bound + 1.0 / MOST_SPEED_DEVIATION_MPS**2)
    moves = speed_mps > 0.0
    return np.where(moves, within, 0.0), np.where(moves, speed, 0.0)


def _share_within(duration_s: FloatArray) -> FloatArray:
    """
    Return the share of the variance of an Ornstein-Uhlenbeck process within segments, shape (N,).

    1 minus the variance function 2/x - 2/x^2 (1 - exp(-x)), with x the duration over the correlation time.
    """
    x = duration_s / CORRELATION_TIME_S
    # The series avoids the cancellation of small x.
    safe = np.maximum(x, 1e-2)
    exact = 1.0 - 2.0 / safe + 2.0 / safe**2 * -np.expm1(-safe)
    return np.where(x < 1e-2, x / 3.0, exact)


GRAVITY_MPS2 = 9.80665
# International standard atmosphere (ISO 2533): pressure over elevation in the troposphere.
SEA_LEVEL_PRESSURE_PA = 101325.0
PRESSURE_PER_M = 2.25577e-5
PRESSURE_EXPONENT = 5.25588
GAS_CONSTANT_OF_AIR = 287.05
KELVIN_AT_0_C = 273.15


@dataclass(frozen=True)
class RoadForces:
    """Additional road load of a trip: payload, a roof box, snow on the road."""

    payload_kg: float = 0.0
    additional_drag_area_m2: float = 0.0
    rolling_resistance_factor: float = 1.0


def road_load_of(vehicle: Vehicle) -> RoadLoad:
    """Return the RoadLoad of a Vehicle; raise InvalidInput if its file has none."""
    if vehicle.road_load is None:
        raise InvalidInput(f'vehicle {vehicle.name!r} has no road_load, so its power on a road is '
                           'unknown; add it to the vehicle file, with the figures of the car, such as '
                           'road_load: {mass_kg: 1900, frontal_area_m2: 2.4, drag_coefficient: 0.27, '
                           'rolling_resistance: 0.010}')
    return vehicle.road_load


def loaded(vehicle: Vehicle, load: RoadForces, maximum_regeneration_power_w: float = inf) -> Vehicle:
    """Return a Vehicle with a load; the lower regeneration [W], trip's or car's, counts."""
    road_load, drivetrain = road_load_of(vehicle), vehicle.drivetrain
    return replace(
        vehicle, road_load=replace(
            road_load, mass_kg=road_load.mass_kg + load.payload_kg,
            additional_drag_area_m2=load.additional_drag_area_m2,
            rolling_resistance=road_load.rolling_resistance * load.rolling_resistance_factor),
        drivetrain=replace(drivetrain, maximum_regeneration_power_w=min(
            drivetrain.maximum_regeneration_power_w, maximum_regeneration_power_w)))


def air_density_kg_per_m3(ambient_temperature_c: FloatArray, elevation_m: FloatArray) -> FloatArray:
    """Return the density of dry air [kg/m^3] at a temperature [deg C] and an elevation [m]."""
    pressure_pa = SEA_LEVEL_PRESSURE_PA * (1.0 - PRESSURE_PER_M * elevation_m)**PRESSURE_EXPONENT
    return pressure_pa / (GAS_CONSTANT_OF_AIR * (ambient_temperature_c + KELVIN_AT_0_C))


def wheel_power_w(vehicle: Vehicle, duration_s: FloatArray, distance_m: FloatArray,
                  speed_mps: FloatArray, elevation_m: FloatArray, slope: FloatArray,
                  ambient_temperature_c: FloatArray, headwind_mps: float = 0.0) -> FloatArray:
    """
    Return the mean power at the wheels [W] in each of N steps, shape (N,); negative when braking.

    `duration_s`, `slope` (rise over run) and `ambient_temperature_c` have shape (N,); `distance_m`, `speed_mps`
    and `elevation_m` (above sea level) have shape (N + 1,): the instants between the steps. Kinetic, potential and
    rolling energy are exact; the air resistance is that of the step's mean speed.
    """
    road_load, driven_m = road_load_of(vehicle), np.diff(distance_m)
    mean_mps = driven_m / duration_s
    kinetic_j = 0.5 * road_load.mass_kg * np.diff(speed_mps**2)
    weight_n = road_load.mass_kg * GRAVITY_MPS2
    potential_j = weight_n * np.diff(elevation_m)
    rolling_j = road_load.rolling_resistance * weight_n / np.hypot(1.0, slope) * driven_m
    density = air_density_kg_per_m3(ambient_temperature_c, 0.5 * (elevation_m[:-1] + elevation_m[1:]))
    air_mps = mean_mps + headwind_mps
    air_n = 0.5 * density * road_load.drag_area_m2 * air_mps * np.abs(air_mps)
    return (kinetic_j + potential_j + rolling_j + air_n * driven_m) / duration_s


def battery_power_w(vehicle: Vehicle, power_at_wheels_w: FloatArray) -> FloatArray:
    """Return the electrical power of the drivetrain [W]; negative = regeneration; shape follows the input."""
    efficiency = vehicle.drivetrain.efficiency
    return np.where(
        power_at_wheels_w > 0.0,
        power_at_wheels_w / efficiency,
        np.maximum(power_at_wheels_w * efficiency, -vehicle.drivetrain.maximum_regeneration_power_w))


# The wheel power within a segment has a Laplace distribution: the mean magnitude of v a is 0.65 ... 0.73 standard
# deviations in public drive cycles, 0.71 in theory (0.80 for a normal distribution). Its quantiles at the middles
# of equal probabilities, with variance 1.
QUANTILES = 32
_PROBABILITY = (np.arange(QUANTILES) + 0.5) / QUANTILES
_LAPLACE = np.sign(_PROBABILITY - 0.5) * -np.log(1.0 - 2.0 * np.abs(_PROBABILITY - 0.5))
DEVIATIONS = _LAPLACE / np.sqrt(np.mean(_LAPLACE**2))
# Largest difference in elevation on a route [m].
MOST_RISE_M = 6000.0
# Segments computed at once, so that a long route needs no more memory.
AT_ONCE = 10_000


@dataclass(frozen=True)
class Motion:
    """
    Motion of any car along N segments: durations and mean speeds, shapes (N,).

    `elevation_m` above sea level at the boundaries has shape (N + 1,). `boundary_speed_mps`, shape (N + 1,), are
    the speeds there if they are known.
    """

    duration_s: FloatArray
    speed_mps: FloatArray
    elevation_m: FloatArray
    boundary_speed_mps: FloatArray | None = None

    @property
    def distance_m(self) -> FloatArray:
        """Distance from the start at the boundaries [m], shape (N + 1,)."""
        return np.concatenate(([0.0], np.cumsum(self.duration_s * self.speed_mps)))


def elevation_of_slope(duration_s: FloatArray, speed_mps: FloatArray, slope: FloatArray) -> FloatArray:
    """Return elevations [m] at the boundaries (N + 1,) of sloping segments, from 0 on; refuse too high ones."""
    rise_m = duration_s * speed_mps * slope / np.hypot(1.0, slope)
    elevation_m = np.concatenate(([0.0], np.cumsum(rise_m)))
    elevation_m -= elevation_m.min()
    if elevation_m.max() > MOST_RISE_M:
        raise InvalidInput(f'slope: the road rises by {elevation_m.max():.0f} m in total; at most '
                           f'{MOST_RISE_M:g} m are plausible; it must be rise over run')
    return elevation_m


def propulsion_columns(vehicle: Vehicle, motion: Motion,
                       ambient_temperature_c: FloatArray) -> dict[str, FloatArray]:
    """Return propulsion_power_w, _rms_w and _magnitude_w [W] of a Motion in air of [deg C], shapes (N,)."""
    road_load = road_load_of(vehicle)
    duration_s, speed_mps, distance_m = motion.duration_s, motion.speed_mps, motion.distance_m
    changes = speed_changes(duration_s, speed_mps, motion.boundary_speed_mps)
    driven_m = np.diff(distance_m)
    rise_m = np.where(driven_m > 0.0, np.diff(motion.elevation_m), 0.0)
    sine = np.clip(rise_m / np.maximum(driven_m, 1e-9), -0.99, 0.99)
    slope = sine / np.sqrt(1.0 - sine**2)
    at_wheels_w = wheel_power_w(vehicle, duration_s, distance_m, changes.boundary_speed_mps, motion.elevation_m,
                                slope, ambient_temperature_c)
    density = air_density_kg_per_m3(ambient_temperature_c, motion.elevation_m[:-1])
    drag = 0.5 * density * road_load.drag_area_m2
    # The mean of v^3 exceeds the cube of the mean speed by 3 v var(v).
    at_wheels_w += 3.0 * drag * speed_mps * changes.speed_variance_m2ps2
    force_n = road_load.mass_kg * GRAVITY_MPS2 * (road_load.rolling_resistance + sine) + 3.0 * drag * speed_mps**2
    deviation_w = np.sqrt(road_load.mass_kg**2 * changes.kinetic_power_variance
                          + force_n**2 * changes.speed_variance_m2ps2)
    mean_w, rms_w, magnitude_w = np.empty((3, len(duration_s)))
    for start in range(0, len(duration_s), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        power_w = battery_power_w(
            vehicle, at_wheels_w[part, np.newaxis] + deviation_w[part, np.newaxis] * DEVIATIONS)
        mean_w[part] = power_w.mean(axis=1)
        rms_w[part] = np.sqrt(np.mean(power_w**2, axis=1))
        magnitude_w[part] = np.abs(power_w).mean(axis=1)
    return {'propulsion_power_w': mean_w, 'propulsion_power_rms_w': rms_w,
            'propulsion_power_magnitude_w': magnitude_w}


@dataclass(frozen=True)
class Comparison:
    """Energy [Wh], mean magnitude [W] and root mean square [W] of the propulsion power of a whole drive."""

    energy_wh: float
    magnitude_w: float
    rms_w: float

    @classmethod
    def of(cls, duration_s: FloatArray, columns: dict[str, FloatArray]) -> Comparison:
        """Return the figures of columns of propulsion power over segments, shapes (N,)."""
        total_s = float(duration_s.sum())
        return cls(float(columns['propulsion_power_w'] @ duration_s) / JOULES_PER_WH,
                   float(columns['propulsion_power_magnitude_w'] @ duration_s) / total_s,
                   float(np.sqrt(columns['propulsion_power_rms_w']**2 @ duration_s / total_s)))


def compare_averages(motion: Motion, vehicle: Vehicle, ambient_temperature_c: FloatArray,
                     step_s: float) -> tuple[Comparison, Comparison, Comparison]:
    """
    Return the figures of a Motion of samples, of the estimate from mean speeds over `step_s`, and without it.

    The last are those of the mean speeds alone, without accelerations. Raises InvalidInput if the samples are
    too far apart.
    """
    if motion.boundary_speed_mps is None or motion.duration_s.max() > FULLY_SAMPLED_S:
        raise InvalidInput(f'--averages: needs a drive cycle with a sample every {FULLY_SAMPLED_S:g} s or more '
                           'often')
    if not FULLY_SAMPLED_S < step_s <= 3600.0:
        raise InvalidInput(f'--averages: {step_s:g} s is not allowed; it must be above {FULLY_SAMPLED_S:g}, at '
                           'most 3600 s')
    exact = Comparison.of(motion.duration_s, propulsion_columns(vehicle, motion, ambient_temperature_c))
    time_s = np.concatenate(([0.0], np.cumsum(motion.duration_s)))
    edges_s = np.append(np.arange(0.0, time_s[-1] - FULLY_SAMPLED_S, step_s), time_s[-1])
    duration_s = np.diff(edges_s)
    speed_mps = np.diff(np.interp(edges_s, time_s, motion.distance_m)) / duration_s
    elevation_m = np.interp(edges_s, time_s, motion.elevation_m)
    ambient_c = np.interp(edges_s[:-1], time_s[:-1], ambient_temperature_c)
    means = Motion(duration_s, speed_mps, elevation_m)
    estimated = Comparison.of(duration_s, propulsion_columns(vehicle, means, ambient_c))
    distance_m = means.distance_m
    power_w = battery_power_w(vehicle, wheel_power_w(
        vehicle, duration_s, distance_m, np.zeros(len(edges_s)), elevation_m, np.zeros(len(duration_s)),
        ambient_c))
    plain = Comparison.of(duration_s, {
        'propulsion_power_w': power_w, 'propulsion_power_rms_w': np.abs(power_w),
        'propulsion_power_magnitude_w': np.abs(power_w)})
    return exact, estimated, plain
