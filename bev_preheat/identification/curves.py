# SPDX-License-Identifier: Apache-2.0
"""Curves of the START vehicle with corrections that a fit can find, and the tables they become in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bev_preheat.numerics import AnyNumber, Arithmetic, ARRAYS, Curve, CurveFunction, FloatArray
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Battery

# Temperatures [deg C] at which the correction of the resistance is free; it is linear between them.
KNOTS_C = (-20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0)
# States of charge at which it is free; cells have more resistance near empty.
KNOTS_SOC = (0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)
# If it varies by less over the charge, a file needs no axis of the state of charge.
LEAST_VARIATION = 1e-3
# Points of the tables in the file.
TABLE_STEP_C, TABLE_STEP_SOC = 2.5, 0.05


@dataclass(frozen=True)
class CorrectedResistance:
    """A resistance times e^(c(T) + d(s)), c at KNOTS_C and d at KNOTS_SOC; numbers or symbols."""

    curve: Curve
    log_factors: Sequence[AnyNumber]
    soc_factors: Sequence[AnyNumber] = (0.0,) * len(KNOTS_SOC)

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)` [ohm], for the given kind of number."""
        value = self.curve.function(arithmetic)

        def resistance(soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
            return value(soc, temperature_c) * arithmetic.exp(
                _linear(temperature_c, KNOTS_C, self.log_factors, arithmetic)
                + _linear(soc, KNOTS_SOC, self.soc_factors, arithmetic))

        return resistance


def _linear(value: AnyNumber, knots: Sequence[float], heights: Sequence[AnyNumber],
            arithmetic: Arithmetic[AnyNumber]) -> AnyNumber:
    """Return the value of a function that is linear between knots and constant beyond."""
    found = heights[0]
    for low, high, low_height, high_height in zip(knots, knots[1:], heights, heights[1:]):
        share = arithmetic.minimum(arithmetic.maximum(value - low, 0.0), high - low)
        found = found + share * (high_height - low_height) / (high - low)
    return found


@dataclass(frozen=True)
class CorrectedVoltage:
    """An open-circuit voltage plus a quadratic in state of charge minus 1/2: offset [V], slope, curvature."""

    curve: Curve
    offset_v: AnyNumber
    slope_v: AnyNumber
    curvature_v: AnyNumber

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)` [V], for the given kind of number."""
        value = self.curve.function(arithmetic)

        def voltage(soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
            centred = soc - 0.5
            correction_v = self.offset_v + centred * (self.slope_v + centred * self.curvature_v)
            return value(soc, temperature_c) + correction_v

        return voltage


def knot_weights(values: FloatArray, knots: Sequence[float]) -> FloatArray:
    """Return the weight of each knot in a correction at values (N,), shape (N, knots)."""
    return np.stack([np.interp(values, knots, row) for row in np.eye(len(knots))], axis=-1)


def resistance_table(battery: Battery, log_factors: FloatArray, soc_factors: FloatArray) -> Table:
    """Return the corrected resistance of a battery as a Table over temperature, and charge if it depends on it."""
    low_c, high_c = battery.temperature_range_c
    own = [point for point in getattr(battery.resistance, 'temperature_c', ()) if low_c <= point <= high_c]
    even = np.arange(np.ceil(low_c / TABLE_STEP_C), np.floor(high_c / TABLE_STEP_C) + 1.0) * TABLE_STEP_C
    temperatures_c = sorted({low_c, high_c, *own, *even.tolist()})
    socs = getattr(battery.resistance, 'soc', ())
    if np.ptp(soc_factors) > LEAST_VARIATION:
        socs = sorted({*socs, *KNOTS_SOC})
    return _tabulated(CorrectedResistance(battery.resistance, log_factors.tolist(), soc_factors.tolist()),
                      socs if len(socs) > 1 else (0.5,), temperatures_c, 5)


def voltage_table(curve: CorrectedVoltage, soc_range: tuple[float, float]) -> Table:
    """Return a corrected open-circuit voltage as a Table over state of charge, rising, 25 deg C."""
    own = [point for point in getattr(curve.curve, 'soc', ()) if 0.0 < point < 1.0]
    socs = sorted({*own, *soc_range, 0.02, *np.round(np.arange(0.0, 1.0 + 1e-9, TABLE_STEP_SOC), 6).tolist()})
    table = _tabulated(curve, socs, (25.0,), 3)
    rising = np.maximum.accumulate([row[0] for row in table.values]).tolist()
    return Table(table.soc, table.temperature_c, tuple((value,) for value in rising))


def _tabulated(curve: Curve, socs: Sequence[float], temperatures_c: Sequence[float], digits: int) -> Table:
    soc, temperature_c = np.meshgrid(socs, temperatures_c, indexing='ij')
    values = curve.function(ARRAYS)(soc, temperature_c) + np.zeros_like(soc)
    return Table(tuple(map(float, socs)), tuple(map(float, temperatures_c)),
                 tuple(tuple(round(value, digits) for value in row) for row in values.tolist()))
