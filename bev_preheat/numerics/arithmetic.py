# SPDX-License-Identifier: Apache-2.0
"""
What the model's equations need beyond + - * /, for each kind of number they are written for.

The equations in `model` and the formulas in `vehicle.curves` take one of these, so that they stand
once and serve floats, arrays and (see `optimum.symbols`) CasADi expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any, Generic, Protocol, TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# A number of any kind, where its kind is known only when the program runs. CasADi has no types, so
# its expressions are of this type, too.
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
    Functions of one kind of number; `root` is the square root, 0 below zero where it can be.

    `share` holds a state of charge within 0 ... 1, where curves are described, for the kinds of number
    that may leave it within a step.
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

    The same numbers give the same bits wherever in memory they lie: of what is not contiguous,
    NumPy before 2 computes some elements another way, depending on their addresses, and the last
    digit differs between two processes.
    """
    return np.exp(np.asarray(value, dtype=float, order='C'))


def array_log(value: FloatArray | float) -> Any:
    """Return the natural logarithm; as `array_exp`."""
    return np.log(np.asarray(value, dtype=float, order='C'))


def _share(value: float) -> float:
    # Nearly all are within, and a comparison costs less than two calls.
    return value if 0.0 <= value <= 1.0 else min(max(value, 0.0), 1.0)


# The fast one: a negative discriminant raises ValueError, which costs nothing where it is not.
FLOATS: Arithmetic[float] = Arithmetic(math.sqrt, math.log, math.exp, max, min)
# The same for steps in which the battery cannot deliver the power: the current stays at U_oc/(2 R).
# An empty battery is driven on with it, too, until the step is cut where the charge runs out.
SATURATING_FLOATS: Arithmetic[float] = Arithmetic(
    _saturating_root, math.log, math.exp, max, min, share=_share)
ARRAYS: Arithmetic[FloatArray] = Arithmetic(
    lambda value: np.sqrt(np.maximum(value, 0.0)), array_log, array_exp, np.maximum, np.minimum,
    share=lambda value: np.minimum(np.maximum(value, 0.0), 1.0))
