# SPDX-License-Identifier: Apache-2.0
"""
Smooths measured elevations along a road.

Elevations of satellite receivers and of terrain models have errors of metres from point to point, which
would be slopes of 30 % on points a few metres apart. A Gaussian filter over distance removes them. Its length
follows from the noise, estimated from the data: the remaining error of the slope is about 0.5 %.
"""

from __future__ import annotations

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.numerics import first_true, FloatArray
from bev_preheat.route.segments import ELEVATION_RANGE_M

# Grid of the filter [m], coarser on long routes, and the range of its standard deviation [m].
GRID_M = 20.0
MOST_PROFILE_POINTS = 100_000
SMOOTHING_RANGE_M = (40.0, 600.0)
# Standard deviation of the slope that may remain.
SLOPE_ERROR = 0.005
# An elevation this many standard deviations from its neighbours' median is an outlier.
OUTLIER_DEVIATIONS = 6.0
OUTLIER_NEIGHBOURS = 5
# Standard deviation of a normal distribution over its median absolute deviation.
NORMAL_OVER_MAD = 1.4826
# Values that change at fewer than this share of the points are held; held ones count this far [m] from a change.
HELD_SHARE = 0.5
HELD_M = 100.0
# Points farther apart [m] differ by hills, not by errors.
HILLS_BEYOND_M = 500.0
# Gaussian kernels are cut off here.
KERNEL_REACH = 4.0


def smooth_elevation(distance_m: FloatArray, elevation_m: FloatArray) -> tuple[FloatArray, str | None]:
    """
    Return the smoothed elevations [m] at M points at rising distances [m], and a remark if they were noisy.

    Shapes (M,). NaN elevations are interpolated; raises InvalidInput if an elevation is implausible.
    """
    known = np.isfinite(elevation_m)
    low_m, high_m = ELEVATION_RANGE_M
    if (at := first_true(known & ~((elevation_m >= low_m) & (elevation_m <= high_m)))) is not None:
        raise InvalidInput(f'point {at + 1}: elevation: {figure(float(elevation_m[at]))} m is not allowed; it '
                           f'must be {low_m:g} ... {high_m:g} m')
    at_m, first = np.unique(distance_m[known], return_index=True)
    if len(at_m) < 2:
        return np.full(len(distance_m), float(elevation_m[known][0]) if known.any() else 0.0), None
    values_m = elevation_m[known][first]
    values_m, outliers = _without_outliers(values_m)
    at_m, values_m = _without_steps(at_m, values_m)
    step_m = max(GRID_M, (at_m[-1] - at_m[0]) / MOST_PROFILE_POINTS)
    grid_m = np.arange(at_m[0], at_m[-1] + step_m, step_m)
    noise_m = _noise_m(at_m, values_m)
    # Noise of independent points, averaged over a Gaussian of deviation L: the slope has the variance
    # noise^2 spacing / (4 sqrt(pi) L^3).
    spacing_m = max(float(np.median(np.diff(at_m))), 1.0)
    length_m = (noise_m**2 * spacing_m / (4.0 * np.sqrt(np.pi) * SLOPE_ERROR**2)) ** (1.0 / 3.0)
    length_m = float(np.clip(length_m, *SMOOTHING_RANGE_M))
    raw_m = _means(grid_m, step_m, at_m, values_m)
    smooth_m = gaussian(raw_m, length_m / step_m)
    remark = None
    if noise_m > 0.3 or outliers:
        raw_climb, climb = (float(np.maximum(np.diff(column), 0.0).sum()) for column in (values_m, smooth_m))
        remark = (f'elevation smoothed over {length_m:.0f} m, because it has an error of about {noise_m:.1f} m: '
                  f'the climbs add up to {climb:.0f} m instead of {raw_climb:.0f} m')
    return np.interp(distance_m, grid_m, smooth_m), remark


def _without_steps(at_m: FloatArray, values_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return distances and values without the steps of values that are held, as loggers hold whole metres.

    A short run of equal values becomes its middle, a long one two inner points.
    """
    starts = np.flatnonzero(np.concatenate(([True], np.diff(values_m) != 0.0)))
    if len(starts) > HELD_SHARE * len(values_m) or len(starts) < 2:
        return at_m, values_m
    ends = np.append(starts[1:] - 1, len(values_m) - 1)
    first_m, last_m = at_m[starts], at_m[ends]
    inset_m = np.minimum(0.5 * (last_m - first_m), HELD_M)
    places_m = np.stack((first_m + inset_m, last_m - inset_m), axis=1)
    # The ends of the road keep their elevations.
    places_m[0, 0], places_m[-1, 1] = at_m[0], at_m[-1]
    kept_m, first = np.unique(places_m.ravel(), return_index=True)
    return kept_m, np.repeat(values_m[starts], 2)[first]


def _without_outliers(values_m: FloatArray) -> tuple[FloatArray, int]:
    """Return values with outliers replaced by the median of their neighbours, and their number."""
    if len(values_m) < OUTLIER_NEIGHBOURS:
        return values_m, 0
    half = OUTLIER_NEIGHBOURS // 2
    padded = np.pad(values_m, half, mode='edge')
    medians = np.median(np.lib.stride_tricks.sliding_window_view(padded, OUTLIER_NEIGHBOURS), axis=1)
    off = np.abs(values_m - medians)
    limit = OUTLIER_DEVIATIONS * max(NORMAL_OVER_MAD * float(np.median(off)), 5.0)
    bad = off > limit
    return np.where(bad, medians, values_m), int(bad.sum())


def _noise_m(at_m: FloatArray, values_m: FloatArray) -> float:
    """Return the standard deviation of independent errors, from each point against its neighbours' line."""
    if len(values_m) < 5 or np.median(np.diff(at_m)) > HILLS_BEYOND_M:
        return 0.0
    before, after = np.diff(at_m)[:-1], np.diff(at_m)[1:]
    share = before / (before + after)
    expected = (1.0 - share) * values_m[:-2] + share * values_m[2:]
    gain = np.sqrt(1.0 + (1.0 - share)**2 + share**2)
    return float(NORMAL_OVER_MAD * np.median(np.abs(values_m[1:-1] - expected) / gain))


def _means(grid_m: FloatArray, step_m: float, at_m: FloatArray, values_m: FloatArray) -> FloatArray:
    """Return the means of a piecewise linear curve around each point of the grid, shape of `grid_m`."""
    areas = np.concatenate(([0.0], np.cumsum(0.5 * (values_m[1:] + values_m[:-1]) * np.diff(at_m))))
    fine_m = np.clip(np.concatenate((grid_m - 0.5 * step_m, grid_m[-1:] + 0.5 * step_m)), at_m[0], at_m[-1])
    # Between its points the integral of a line is a parabola.
    cell = np.clip(np.searchsorted(at_m, fine_m, side='right') - 1, 0, len(at_m) - 2)
    into_m = fine_m - at_m[cell]
    slope = (values_m[cell + 1] - values_m[cell]) / (at_m[cell + 1] - at_m[cell])
    area = areas[cell] + values_m[cell] * into_m + 0.5 * slope * into_m**2
    widths = np.diff(fine_m)
    return np.where(widths > 1e-9, np.diff(area) / np.maximum(widths, 1e-9), np.interp(grid_m, at_m, values_m))


def gaussian(values: FloatArray, deviation: float) -> FloatArray:
    """Return values filtered by a Gaussian of a deviation in points; the ends are continued by reflection."""
    reach = max(1, int(KERNEL_REACH * deviation))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation)**2)
    kernel /= kernel.sum()
    # Odd reflection keeps the slope at the ends.
    reach = min(reach, len(values) - 1)
    kernel = kernel[len(kernel) // 2 - reach:len(kernel) // 2 + reach + 1]
    kernel = kernel / kernel.sum()
    before = 2.0 * values[0] - values[reach:0:-1]
    after = 2.0 * values[-1] - values[-2:-reach - 2:-1]
    return np.convolve(np.concatenate((before, values, after)), kernel, mode='valid')
