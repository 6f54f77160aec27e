# SPDX-License-Identifier: Apache-2.0
"""
Probabilities of the vehicle's places on the route's line, from one position fix to the next.

This is the forward algorithm of a hidden Markov model whose states are the points of the line near the fix
(map matching as in Newson and Krumm, 2009, with the route as the only road). A transition is the distance that
the vehicle may have driven between two fixes; it does not drive backwards. A fix is normally distributed about
the true position.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bev_preheat.numerics import FloatArray, IntArray
from bev_preheat.route.line import MapLine, Nearby

# A fix further than this many deviations from a place speaks against it: exp(-3.5^2 / 2), 0.2 % of good fixes in
# the plane.
GATE_DEVIATIONS = 3.5
# The vehicle drives no faster [m/s], and a fix may run ahead of the last one by more [m], because errors jump.
FASTEST_MPS, JUMP_M = 60.0, 20.0
# Prior share of standing vehicles; in towns it is about a third of the time.
STANDING_SHARE = 0.3
# Errors of a receiver drift by this much in a second [m]; a walking pace backwards, as in parking, is followed.
DRIFT_M = 2.0
# The planned pace says nothing on a second and is the best prior on minutes: its weight is t / (t + PACE_AFTER_S).
PACE_AFTER_S = 30.0
# Relative deviation of driven from planned distance: traffic.
PACE_DEVIATION = 0.3
# Relative deviation of the odometer's from the line's metres: tyres (2 %) and digitised lines (2 %).
ODOMETER_DEVIATION = 0.03
# Errors of fixes are correlated over this time [s]: fixes within it choose once between parallel roads.
CORRELATED_S = 20.0
# Points further apart than this along the line [m] belong to different passes.
PASS_GAP_M = 30.0
# Smaller shares are dropped.
SMALLEST_SHARE = 1e-7
# Probability of a fix by the belief, in units of that of the best possible one, below which it contradicts the
# belief. A vehicle at any speed has 4e-3 or more, even after half a minute without a fix; one at 4.5 deviations
# from all places within reach has 4e-5.
LEAST_EVIDENCE = 1e-4


class PlaceBelief(NamedTuple):
    """Indices of points of a MapLine, and the probability that the vehicle is there; shape (K,), K >= 1."""

    at: IntArray
    share: FloatArray


class Place(NamedTuple):
    """
    The most probable pass of the vehicle: mean distance [m], its standard deviation [m], and probability.

    `other_m` is the mean distance of the second pass [m]; None without one.
    """

    distance_m: float
    deviation_m: float
    probability: float
    other_m: float | None


def carried_on(line: MapLine, belief: PlaceBelief, near: Nearby, seconds: float,
               odometer_m: float | None, fastest_mps: float = FASTEST_MPS) -> FloatArray:
    """
    Return the density [1/m] of places `seconds` after a belief at the points near a fix, shape (K,).

    `odometer_m` is the distance driven since then [m]; None: not known. The vehicle drives at most `fastest_mps`.
    """
    from_m = line.along_m[belief.at][:, None]
    gain_m = line.along_m[near.at][None, :] - from_m
    drift_m = math.sqrt(DRIFT_M**2 * seconds)
    if odometer_m is not None:
        density = _normal(gain_m - odometer_m, math.hypot(drift_m, ODOMETER_DEVIATION * odometer_m))
    else:
        planned_m = line.planned_m(from_m, seconds) - from_m
        reach_m = fastest_mps * seconds + JUMP_M
        ahead = (gain_m >= 0.0) & (gain_m <= reach_m)
        by_plan = seconds / (seconds + PACE_AFTER_S)
        moving = (1.0 - by_plan) * ahead / reach_m + by_plan * ahead * _normal(
            gain_m - planned_m, np.hypot(PACE_DEVIATION * planned_m, JUMP_M))
        density = STANDING_SHARE * _normal(gain_m, drift_m) + (1.0 - STANDING_SHARE) * moving
    return belief.share @ density


def updated(line: MapLine, belief: PlaceBelief, near: Nearby, fix_deviation_m: float, seconds: float,
            odometer_m: float | None, fastest_mps: float = FASTEST_MPS) -> PlaceBelief | None:
    """Return the belief after the next fix; None if it is not near any place that the vehicle can have reached."""
    carried = carried_on(line, belief, near, seconds, odometer_m, fastest_mps)
    evidence = float(carried @ _likelihood(near, fix_deviation_m)) * line.spacing_m
    if evidence < LEAST_EVIDENCE:
        return None
    return weighed(line, near, fix_deviation_m, carried, min(1.0, seconds / CORRELATED_S))


def place_of(line: MapLine, belief: PlaceBelief) -> Place:
    """Return the Place of a belief."""
    passes = _passes(line, belief.at)
    shares = np.bincount(passes, belief.share)
    order = np.argsort(shares)[::-1]
    means_m = np.bincount(passes, belief.share * line.along_m[belief.at]) / shares
    best = int(order[0])
    inside = passes == best
    variance_m2 = float(belief.share[inside] @ (line.along_m[belief.at[inside]] - means_m[best])**2 / shares[best])
    return Place(float(means_m[best]), math.sqrt(variance_m2), float(shares[best]),
                 float(means_m[order[1]]) if len(order) > 1 else None)


def weighed(line: MapLine, near: Nearby, fix_deviation_m: float, prior: FloatArray,
            trust: float = 1.0) -> PlaceBelief | None:
    """
    Return the belief after a fix [deviation: m] with a prior density [1/m] at the points near it, shape (K,).

    That is prior times likelihood within each pass, and prior times likelihood^trust between them; None if it is 0
    everywhere. The errors of consecutive fixes are almost equal. Within a pass that does no harm, because the
    vehicle moves; between parallel passes, the same error would count as new evidence each time.
    """
    passes = _passes(line, near.at)
    joint = prior * _likelihood(near, fix_deviation_m)
    before, after = np.bincount(passes, prior), np.bincount(passes, joint)
    known = (before > 0.0) & (after > 0.0)
    factor = np.zeros_like(before)
    factor[known] = (after[known] / before[known])**(trust - 1.0)
    share = joint * factor[passes]
    total = float(share.sum())
    if not total > 0.0:
        return None
    share /= total
    kept = share > SMALLEST_SHARE
    return PlaceBelief(near.at[kept], share[kept] / share[kept].sum())


def _likelihood(near: Nearby, fix_deviation_m: float) -> FloatArray:
    """Return the likelihood of a fix at the points near it, in units of that at the fix itself; shape (K,)."""
    return np.exp(-0.5 * (near.distance_m / fix_deviation_m)**2)


def _passes(line: MapLine, at: IntArray) -> IntArray:
    """Return the number of the pass of each point, whose indices ascend; shape (K,)."""
    apart = np.diff(at, prepend=at[:1]) * line.spacing_m > PASS_GAP_M
    return np.cumsum(apart)


def _normal(value: FloatArray, deviation: float | FloatArray) -> FloatArray:
    return np.exp(-0.5 * (value / deviation)**2) / (math.sqrt(2.0 * math.pi) * deviation)
