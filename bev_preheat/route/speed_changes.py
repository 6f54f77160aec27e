# SPDX-License-Identifier: Apache-2.0
"""
Estimates the accelerations and the speed variance that the mean speed of a segment hides.

A mean speed contains neither the stops nor the accelerations within its segment, so its power is too
low. The specific kinetic power v a (speed times acceleration, per kilogram of the car) is modelled as
a stationary random process (Ornstein-Uhlenbeck) with a standard deviation that depends on the mean speed and
with a correlation time. The theory of its averages (Vanmarcke, Random Fields, 1983, chapter 5) gives
the part that varies within a segment, and the part that is visible from segment to segment. The
visible part is measured: a drive whose segments change more than usual also accelerates more within them.

The constants are fitted to public drive cycles; docs/explanation/road_load.md has the comparison.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bev_preheat.numerics import FloatArray, IntArray

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
