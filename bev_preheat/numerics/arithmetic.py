# SPDX-License-Identifier: Apache-2.0
"""
Functions that the model's equations need beyond + - * /, for each kind of number.

The equations in `model` and the formulas in `vehicle.curves` take one of these, so that one version
serves floats, arrays and (see `optimum.symbols`) CasADi expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any, Generic, Protocol, TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

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
