# SPDX-License-Identifier: Apache-2.0
"""
Kinds of number that the equations take: floats, arrays, symbols; factors between units; normal distributions.

The equations in `vehicle.model` and the formulas in `vehicle.curves` take the functions of one kind of number, so
that one version serves floats, arrays and (see `nonlinear_program.symbols`) CasADi expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from math import erf, erfc, exp, expm1, log, pi, sqrt
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from bev_preheat.tunables import MISSING_CELL_C, TAIL, WIDEST_CELL_SPREAD_K

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int_]


def frozen(array: FloatArray) -> FloatArray:
    """Return an array, which can no longer be written."""
    array.setflags(write=False)
    return array


def first_true(which: BoolArray) -> int | None:
    """Return the index of the first true element of an array of shape (N,), None without one."""
    at = int(np.argmax(which)) if len(which) else 0
    return at if len(which) and which[at] else None


def no_position(latitude_deg: FloatArray, longitude_deg: FloatArray) -> BoolArray:
    """Return which positions receivers write without a fix: latitude 0 and longitude 0, in the Gulf of Guinea."""
    missing: BoolArray = (latitude_deg == 0.0) & (longitude_deg == 0.0)
    return missing


def present_cells(cells_c: FloatArray, battery_c: float = math.nan) -> FloatArray:
    """Return temperatures (N,) [deg C] with NaN for modules that are not there: a code far from all others."""
    is_code = np.isin(np.round(cells_c, 3), MISSING_CELL_C)
    others_c = np.append(cells_c[~is_code], battery_c)
    others_c = others_c[np.isfinite(others_c)]
    if len(others_c) == 0 or not is_code.any():
        return cells_c
    nearest_k = np.abs(cells_c[:, None] - others_c).min(axis=1)
    return np.where(is_code & (nearest_k > WIDEST_CELL_SPREAD_K), np.nan, cells_c)


# A number of any kind, if the kind is known only at run time. CasADi has no types, so its expressions are of this
# type, too.
AnyNumber = Any
Number = TypeVar('Number', float, 'FloatArray')
# `f(soc, temperature_c)`.
CurveFunction = Callable[[Number, Number], Number]


class Curve(Protocol):
    """A quantity over state of charge and battery temperature; see `vehicle.curves`."""

    def function(self, arithmetic: Arithmetic[Number]) -> CurveFunction[Number]:
        """`f(soc, temperature_c)`, for the given kind of number."""


@dataclass(frozen=True)
class Arithmetic(Generic[Number]):
    """
    Functions of one kind of number; `root` is the square root, 0 below zero where possible.

    `share` clips a state of charge to 0 ... 1, the range of the curves, for kinds of number that may leave it
    within a step.
    """

    root: Callable[[Number], Number]
    log: Callable[[Number], Number]
    exp: Callable[[Number], Number]
    maximum: Callable[[Number, Number | float], Number]
    minimum: Callable[[Number, Number | float], Number]
    share: Callable[[Number], Number] = lambda value: value


def _saturating_root(value: float) -> float:
    return math.sqrt(value) if value > 0.0 else 0.0


def array_exp(value: FloatArray | float) -> Any:
    """
    Return e^value, of the type and shape that `numpy.exp` gives.

    Equal numbers give equal bits regardless of memory layout: before version 2, NumPy computes some elements of
    non-contiguous arrays another way, depending on their addresses, and the last digit differs between two
    processes.
    """
    return np.exp(np.asarray(value, dtype=float, order='C'))


def array_log(value: FloatArray | float) -> Any:
    """Return the natural logarithm; as `array_exp`."""
    return np.log(np.asarray(value, dtype=float, order='C'))


def _share(value: float) -> float:
    # Nearly all values are within, and a comparison costs less than two calls.
    return value if 0.0 <= value <= 1.0 else min(max(value, 0.0), 1.0)


# The fast one: a negative discriminant raises ValueError, which is free when it does not happen.
FLOATS: Arithmetic[float] = Arithmetic(math.sqrt, math.log, math.exp, max, min)
# For steps in which the battery cannot deliver the power: the current stays at U_oc/(2 R). Also used to drive on
# with an empty battery, until the step is cut at the instant at which the charge runs out.
SATURATING_FLOATS: Arithmetic[float] = Arithmetic(
    _saturating_root, math.log, math.exp, max, min, share=_share)
ARRAYS: Arithmetic[FloatArray] = Arithmetic(
    lambda value: np.sqrt(np.maximum(value, 0.0)), array_log, array_exp, np.maximum, np.minimum,
    share=lambda value: np.minimum(np.maximum(value, 0.0), 1.0))


NS_PER_S = 10**9
S_PER_MIN = 60.0
S_PER_H = 3600.0
NS_PER_DAY = 86400 * NS_PER_S
W_PER_KW = 1000.0
WH_PER_KWH = 1000.0
JOULES_PER_WH = 3600.0
# Mean radius of the earth [m], WGS 84.
EARTH_RADIUS_M = 6_371_008.8


_erf = np.vectorize(math.erf, otypes=[float])
# A mean this many standard deviations from 0 changes its sign too rarely to matter.
CERTAIN_DEVIATIONS = 9.0
ROOT_2_OVER_PI = math.sqrt(2.0 / math.pi)


def mean_magnitude(mean: FloatArray | float, variance: FloatArray | float) -> FloatArray:
    """
    Return the mean of |x|, with x normally distributed with a mean and a variance; broadcast shape.

    That is the mean of the folded normal distribution (Leone, Nelson, Nottingham, Technometrics
    3(4), 1961): between |mean| and the root of mean^2 + variance; |mean| without variance.
    """
    magnitude = np.abs(mean)
    varies = np.asarray(variance > np.square(magnitude / CERTAIN_DEVIATIONS))
    if not varies.any():
        return np.broadcast_to(magnitude, varies.shape)
    deviation = np.sqrt(np.where(varies, variance, 1.0))
    standard = np.minimum(magnitude / (math.sqrt(2.0) * deviation), CERTAIN_DEVIATIONS)
    return np.where(
        varies, ROOT_2_OVER_PI * deviation * array_exp(-np.square(standard))
        + magnitude * _erf(standard), magnitude)


ROOT_2 = sqrt(2.0)
LOG_ROOT_2_PI = 0.5 * log(2.0 * pi)


def truncated_moments(mean: float, variance: float, low: float,
                      high: float) -> tuple[float, float, float]:
    """
    Return (mean, variance, log of the probability) of a normal variable restricted to [low, high].

    If the interval is a point (low == high), the probability is the density there.
    """
    deviation = sqrt(variance)
    a, b = (low - mean) / deviation, (high - mean) / deviation
    if b - a < 1e-9:
        return 0.5 * (low + high), 0.0, -0.5 * a * a - LOG_ROOT_2_PI - log(deviation)
    if a > TAIL:
        offset, spread, log_probability = _tail(a, b - a)
        return low + deviation * offset, variance * spread, log_probability
    if b < -TAIL:
        offset, spread, log_probability = _tail(-b, b - a)
        return high - deviation * offset, variance * spread, log_probability
    if a > 0.0:
        probability = 0.5 * (erfc(a / ROOT_2) - erfc(b / ROOT_2))
    elif b < 0.0:
        probability = 0.5 * (erfc(-b / ROOT_2) - erfc(-a / ROOT_2))
    else:
        probability = 0.5 * (erf(b / ROOT_2) - erf(a / ROOT_2))
    density_a = exp(-0.5 * a * a - LOG_ROOT_2_PI)
    density_b = exp(-0.5 * b * b - LOG_ROOT_2_PI)
    shift = (density_a - density_b) / probability
    spread = 1.0 + (a * density_a - b * density_b) / probability - shift * shift
    return (mean + deviation * shift, variance * max(spread, 0.0), log(probability))


def _tail(distance: float, width: float) -> tuple[float, float, float]:
    """
    Return (mean beyond `distance`, variance, log of the probability) in the standard normal's tail.

    There the density decays exponentially, at rate `distance`, over the interval's `width`.
    """
    x = distance * width
    log_density = -0.5 * distance * distance - LOG_ROOT_2_PI
    if x < 1e-4:
        return 0.5 * width, width * width / 12.0, log_density + log(width)
    # Beyond this the far end is irrelevant, and exp would overflow.
    x = min(x, 700.0)
    grown = expm1(x)
    return (1.0 / distance - width / grown,
            max(0.0, 1.0 / distance**2 - width * width * (grown + 1.0) / (grown * grown)),
            log_density + log(-expm1(-x) / distance))
