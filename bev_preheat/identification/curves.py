# SPDX-License-Identifier: Apache-2.0
"""Curves of the START vehicle with corrections that a fit can find, and the tables they become in a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.vehicle.curves import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic, Curve, CurveFunction
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Battery

# Temperatures [deg C] at which the correction of the resistance is free; it is linear between them.
KNOTS_C = (-20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0)
# Points of the tables in the file.
TABLE_STEP_C, TABLE_STEP_SOC = 2.5, 0.05
HALF = 0.5


@dataclass(frozen=True)
class CorrectedResistance:
    """A resistance curve times e^c(T); `log_factors` are c at KNOTS_C, numbers or symbols."""

    curve: Curve
    log_factors: Sequence[AnyNumber]

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)` [ohm], for the given kind of number."""
        value = self.curve.function(arithmetic)

        def resistance(soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
            clipped = arithmetic.minimum(arithmetic.maximum(temperature_c, KNOTS_C[0]), KNOTS_C[-1])
            correction = self.log_factors[0]
            for low_c, high_c, low, high in zip(KNOTS_C, KNOTS_C[1:], self.log_factors, self.log_factors[1:]):
                share = arithmetic.minimum(arithmetic.maximum(clipped - low_c, 0.0), high_c - low_c)
                correction = correction + share * (high - low) / (high_c - low_c)
            return value(soc, temperature_c) * arithmetic.exp(correction)

        return resistance


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
            centred = soc - HALF
            correction_v = self.offset_v + centred * (self.slope_v + centred * self.curvature_v)
            return value(soc, temperature_c) + correction_v

        return voltage


def knot_weights(temperature_c: FloatArray) -> FloatArray:
    """Return the weight of each of KNOTS_C in the correction at temperatures (N,), shape (N, knots)."""
    clipped = np.clip(temperature_c, KNOTS_C[0], KNOTS_C[-1])
    return np.stack([np.interp(clipped, KNOTS_C, row) for row in np.eye(len(KNOTS_C))], axis=-1)


def resistance_table(battery: Battery, log_factors: FloatArray) -> Table:
    """Return the corrected resistance of a battery as a Table over temperature, and charge if the curve has it."""
    low_c, high_c = battery.temperature_range_c
    own = [point for point in getattr(battery.resistance, 'temperature_c', ()) if low_c <= point <= high_c]
    even = np.arange(np.ceil(low_c / TABLE_STEP_C), np.floor(high_c / TABLE_STEP_C) + 1.0) * TABLE_STEP_C
    temperatures_c = sorted({low_c, high_c, *own, *even.tolist()})
    socs = getattr(battery.resistance, 'soc', ())
    return _tabulated(CorrectedResistance(battery.resistance, log_factors.tolist()),
                      socs if len(socs) > 1 else (0.0,), temperatures_c, 5)


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
