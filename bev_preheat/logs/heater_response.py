# SPDX-License-Identifier: Apache-2.0
"""Whether the battery's temperature answers to a heater that is not known to serve the battery."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from bev_preheat.logs.doubts import integral
from bev_preheat.logs.recording import Series
from bev_preheat.numerics import FloatArray

# The temperature follows the heater's heat on its way by about this time [s].
DELAY_S = 60.0
GRID_S = 30.0
LEAST_S = 600.0
# A share of the electrical power that gets to the battery, and heat capacities of cars' batteries [J/K].
EFFICIENCY, CAPACITIES_J_PER_K = 0.9, (4e4, 1.5e6)
# The heater's heat must warm by at least this [K], and leave at most this share of the squares unexplained.
LEAST_RISE_K, MOST_UNEXPLAINED = 1.5, 0.25
# The number of first columns that explain a start and a steady rise.
STEADY = 2


class HeaterResponse(NamedTuple):
    """The rise that the heater's energy explains [K], and that energy [J]."""

    rise_k: float
    energy_j: float


def heater_response(signals: Mapping[str, Series]) -> HeaterResponse | None:
    """
    Return the response of the battery temperature to `heater_w`; None if it does not answer.

    The rise is fitted by energies, none with a negative share: the heater's, the integrals of the power's square
    (Joule heat) and magnitude (drivetrain), and that of the difference to the air (leakage). It answers if a fit
    without the heater leaves much more, and if the heat capacity is that of a car's battery.
    """
    if not {'heater_w', 'battery_temperature_c'} <= signals.keys() or 'battery_heater_w' in signals:
        return None
    temperature, heater = signals['battery_temperature_c'], signals['heater_w']
    begin_s, end_s = (function(series.time_s[at] for series in (temperature, heater))
                      for function, at in ((max, 0), (min, -1)))
    if end_s - begin_s < LEAST_S or not (heater.value > 0.0).any():
        return None
    at_s = np.arange(begin_s, end_s, GRID_S)
    temperature_c = temperature.at(at_s)
    rise_k = temperature_c - temperature_c[0]
    energy_j = _integral(heater, np.maximum(at_s - DELAY_S, begin_s))
    # A steady rise shows nothing: the drive's own heat, and a cabin's heater that is always on, are as steady.
    others = [np.ones_like(at_s), at_s - begin_s]
    if 'power_w' in signals:
        power = signals['power_w']
        others += [_integral(Series(power.time_s, heat), at_s) for heat in (power.value**2, np.abs(power.value))]
    if 'ambient_c' in signals:
        others.append(GRID_S * np.cumsum(signals['ambient_c'].at(at_s) - temperature_c))
    without, _ = _fitted(rise_k, others)
    left, share = _fitted(rise_k, [*others, energy_j])
    if share <= 0.0 or left > MOST_UNEXPLAINED * without:
        return None
    found = HeaterResponse(share * float(energy_j[-1]), float(_integral(heater, at_s)[-1]))
    low, high = CAPACITIES_J_PER_K
    return found if found.rise_k >= LEAST_RISE_K and low <= EFFICIENCY / share <= high else None


def _integral(series: Series, at_s: FloatArray) -> FloatArray:
    """Return the integral of a signal from the first of the instants on."""
    found = Series(series.time_s, integral(series)).at(at_s)
    return np.asarray(found - found[0])


def _fitted(values: FloatArray, columns: list[FloatArray]) -> tuple[float, float]:
    """Return the sum of squares that columns leave, and the last's share; only the steady may be negative."""
    best = float('inf'), 0.0
    scales = [max(float(np.abs(column).max()), 1e-300) for column in columns]
    rest = range(STEADY, len(columns))
    for count in range(len(rest) + 1):
        for chosen in combinations(rest, count):
            matrix = np.stack([columns[at] / scales[at] for at in (*range(STEADY), *chosen)], axis=1)
            shares, *_ = np.linalg.lstsq(matrix, values, rcond=None)
            left = float(np.sum((values - matrix @ shares)**2))
            if (shares[STEADY:] >= 0.0).all() and left < best[0]:
                last = len(columns) - 1
                best = left, float(shares[-1]) / scales[last] if last in chosen else 0.0
    return best
