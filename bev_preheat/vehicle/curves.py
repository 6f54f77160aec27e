# SPDX-License-Identifier: Apache-2.0
"""
Curves over state of charge and battery temperature: formulas and tables.

Each curve has `function(arithmetic)`, which returns `f(soc, temperature_c)` for floats, arrays or symbols. State
of charge is 0 ... 1, temperature in degrees Celsius; the result has the unit of the curve (V, ohm, W).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bev_preheat.numerics import (
    AnyNumber,
    Arithmetic,
    ARRAYS,
    Curve,
    CurveFunction,
    FloatArray,
    FLOATS,
    Number,
    SATURATING_FLOATS,
)

# ln(soc) diverges for an empty battery; below this state of charge the voltage is constant.
LOWEST_SOC_IN_LOGARITHM = 1e-3


@dataclass(frozen=True)
class PolynomialVoltage:
    """Open-circuit voltage [V]: c0 + c1 s + c2 s^2 + c3 s^3 + log_soc ln(s), s = state of charge."""

    polynomial_v: tuple[float, ...]
    log_soc_v: float = 0.0

    def function(self, arithmetic: Arithmetic[Number]) -> CurveFunction[Number]:
        """`f(soc, temperature_c)` [V] for the given kind of number."""
        c0, c1, c2, c3 = (tuple(self.polynomial_v) + (0.0,) * 3)[:4]
        log_soc_v, log, maximum = self.log_soc_v, arithmetic.log, arithmetic.maximum
        share = arithmetic.share

        def polynomial(soc: Number, temperature_c: Number) -> Number:
            soc = share(soc)
            return c0 + soc * (c1 + soc * (c2 + soc * c3))

        def polynomial_and_logarithm(soc: Number, temperature_c: Number) -> Number:
            soc = share(soc)
            return (c0 + soc * (c1 + soc * (c2 + soc * c3))
                    + log_soc_v * log(maximum(soc, LOWEST_SOC_IN_LOGARITHM)))

        return polynomial_and_logarithm if log_soc_v else polynomial


@dataclass(frozen=True)
class InverseTemperatureResistance:
    """Internal resistance [ohm]: k / (T + reference_temperature) + connection, T in degrees Celsius."""

    k_ohm_k: float
    reference_temperature_c: float
    connection_ohm: float = 0.0

    def function(self, arithmetic: Arithmetic[Number]) -> CurveFunction[Number]:
        """`f(soc, temperature_c)` [ohm], for temperature_c > -reference_temperature_c."""
        k_ohm_k, reference_temperature_c = self.k_ohm_k, self.reference_temperature_c
        connection_ohm = self.connection_ohm

        def resistance(soc: Number, temperature_c: Number) -> Number:
            return k_ohm_k / (temperature_c + reference_temperature_c) + connection_ohm

        return resistance


@dataclass(frozen=True)
class Table:
    """
    A table, interpolated linearly and constant beyond its ends.

    `soc` and `temperature_c` are the rising axes; an axis with one point means that the value does
    not depend on it. `values[i][j]` belongs to soc[i] and temperature_c[j].
    """

    soc: tuple[float, ...]
    temperature_c: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]

    @classmethod
    def constant(cls, value: float) -> Table:
        """Return the table of one value."""
        return cls((0.0,), (0.0,), ((value,),))

    def changed(self, change: Callable[[float], float]) -> Table:
        """Return the table with each value changed by a function."""
        return replace(self, values=tuple(tuple(map(change, row)) for row in self.values))

    def function(self, arithmetic: Arithmetic[Number]) -> CurveFunction[Number]:
        """`f(soc, temperature_c)`, bilinear, for the given kind of number."""
        if arithmetic is FLOATS or arithmetic is SATURATING_FLOATS:
            return self._function_of_floats()
        if arithmetic is ARRAYS:
            return self._function_of_arrays()
        return self._function_of_ramps(arithmetic)

    def _function_of_ramps(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """For symbols: no branches, and few operations in the first and second derivatives."""
        coefficients = (_bends(self.soc) @ np.array(self.values) @ _bends(self.temperature_c).T).tolist()

        def lookup(soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
            soc_ramps = _ramps(self.soc, soc, arithmetic)
            temperature_ramps = _ramps(self.temperature_c, temperature_c, arithmetic)
            total: AnyNumber = 0.0
            for row, soc_ramp in zip(coefficients, soc_ramps):
                along_row: AnyNumber = 0.0
                for coefficient, ramp in zip(row, temperature_ramps):
                    along_row = along_row + coefficient * ramp
                total = total + soc_ramp * along_row
            return total

        return lookup

    def _function_of_arrays(self) -> CurveFunction[AnyNumber]:
        soc_axis, temperature_axis = np.array(self.soc), np.array(self.temperature_c)
        soc_cells, temperature_cells = (np.arange(len(axis), dtype=float) for axis in (soc_axis, temperature_axis))
        values, columns = np.array(self.values).ravel(), len(self.temperature_c)

        def lookup(soc: FloatArray, temperature_c: FloatArray) -> FloatArray:
            i, next_i, a = _cell(soc_axis, soc_cells, soc)
            j, next_j, b = _cell(temperature_axis, temperature_cells, temperature_c)
            low, high = columns * i, columns * next_i
            at_low = values.take(low + j)
            at_low = at_low + b * (values.take(low + next_j) - at_low)
            at_high = values.take(high + j)
            at_high = at_high + b * (values.take(high + next_j) - at_high)
            value: FloatArray = at_low + a * (at_high - at_low)
            return value

        return lookup

    def _function_of_floats(self) -> CurveFunction[AnyNumber]:
        soc_axis, temperature_axis, values = self.soc, self.temperature_c, self.values
        if len(soc_axis) == 1 and len(temperature_axis) == 1:
            constant = values[0][0]
            return lambda soc, temperature_c: constant
        if len(temperature_axis) == 1:
            over_soc = _line(soc_axis, [row[0] for row in values])
            return lambda soc, temperature_c: over_soc(soc)
        if len(soc_axis) == 1:
            over_temperature = _line(temperature_axis, values[0])
            return lambda soc, temperature_c: over_temperature(temperature_c)

        soc_low, soc_high = soc_axis[0], soc_axis[-1]
        temperature_low, temperature_high = temperature_axis[0], temperature_axis[-1]
        last_row, last_column = len(soc_axis) - 2, len(temperature_axis) - 2

        def lookup(soc: float, temperature_c: float) -> float:
            soc = soc_low if soc < soc_low else soc_high if soc > soc_high else soc
            temperature_c = (temperature_low if temperature_c < temperature_low else
                             temperature_high if temperature_c > temperature_high else
                             temperature_c)
            i = min(bisect_right(soc_axis, soc) - 1, last_row)
            j = min(bisect_right(temperature_axis, temperature_c) - 1, last_column)
            a = (soc - soc_axis[i]) / (soc_axis[i + 1] - soc_axis[i])
            b = ((temperature_c - temperature_axis[j]) / (temperature_axis[j + 1] - temperature_axis[j]))
            low, high = values[i], values[i + 1]
            at_low = low[j] + b * (low[j + 1] - low[j])
            return at_low + a * (high[j] + b * (high[j + 1] - high[j]) - at_low)

        return lookup


def with_connections(resistance: Curve, connection_ohm: float) -> Curve:
    """Return the resistance of a pack: a formula or Table of its cells, and of its connections [ohm]."""
    if connection_ohm == 0.0:
        return resistance
    if isinstance(resistance, InverseTemperatureResistance):
        return replace(resistance, connection_ohm=resistance.connection_ohm + connection_ohm)
    assert isinstance(resistance, Table)
    return resistance.changed(lambda value: value + connection_ohm)


def _line(axis: Sequence[float], values: Sequence[float]) -> Callable[[float], float]:
    """Return a piecewise linear function of one float, constant beyond its ends."""
    slopes = [(v1 - v0) / (x1 - x0) for x0, x1, v0, v1 in zip(axis, axis[1:], values, values[1:])]
    low, high, first, last = axis[0], axis[-1], values[0], values[-1]

    def line(x: float) -> float:
        if x <= low:
            return first
        if x >= high:
            return last
        i = bisect_right(axis, x) - 1
        return values[i] + slopes[i] * (x - axis[i])

    return line


def _cell(axis: FloatArray, cells: FloatArray, x: FloatArray) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
    """Return the indices of the axis points below and above each x, and the position of x between them."""
    if len(axis) == 1:
        return 0, 0, 0.0
    # Position along the axis in units of its cells; clipped at the ends.
    position = np.interp(x, axis, cells)
    below = np.minimum(position.astype(int), len(axis) - 2)
    return below, below + 1, position - below


def _ramps(axis: Sequence[float], x: AnyNumber, arithmetic: Arithmetic[AnyNumber]) -> list[AnyNumber]:
    """Return 1 and, for each axis point but the last, how far x lies above it, 0 below; clipped at the ends."""
    if len(axis) == 1:
        return [1.0]
    maximum, minimum = arithmetic.maximum, arithmetic.minimum
    x = minimum(maximum(x, axis[0]), axis[-1])
    return [1.0, x - axis[0], *(maximum(x - point, 0.0) for point in axis[1:-1])]


def _bends(axis: Sequence[float]) -> FloatArray:
    """Return the matrix that turns values at n axis points into factors of their `_ramps`, shape (n, n)."""
    points = len(axis)
    slopes = np.diff(np.eye(points), axis=0) / np.diff(axis)[:, np.newaxis]
    return np.concatenate((np.eye(1, points), np.diff(slopes, axis=0, prepend=np.zeros((1, points)))[:points - 1]))
