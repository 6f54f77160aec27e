# SPDX-License-Identifier: Apache-2.0
"""
Ageing of the battery in a charging session, as money: its loss of capacity, at the price of a new battery.

Model `schimpe_2018`: M. Schimpe, M. E. von Kuepach, M. Naumann, H. C. Hesse, K. Smith, A. Jossen, "Comprehensive
Modeling of Temperature-Dependent Degradation Mechanisms in Lithium Iron Phosphate Batteries", J. Electrochem. Soc.
165 (2018) A181, doi 10.1149/2.1181714jes; its equations in brackets, its parameters in table IV. Four losses of a
cell of graphite and LFP (26650, C_0 = 3 Ah) add up:

    k_cal(T, s) √t            storage                                                          [9]
    k_hot(T) √Q               cycles, Q is all charge that went in and out                     [15]
    k_cold(T, I) √Q_ch        lithium plating, Q_ch is all charge that went in                 [18]
    k_full(T, I, s) Q_ch      … of a cold battery that is nearly full, s ≥ 0.82                [21]

Each k is Arrhenius in T; k_cold and k_full rise with the cold and, exponentially, with the charging current I. The
loss of one session is the derivative at the age of the battery, which the vehicle file states (`Ageing`).

Measured from 0 to 55 degC, at up to 1 C. A state outside counts as at the edge; `AgeingCost` gives the share of
the charge outside. The ageing of drive and parking is not counted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bev_preheat.numerics import array_exp, FloatArray, S_PER_H
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Ageing, Vehicle

GAS_J_PER_MOL_K, FARADAY_C_PER_MOL = 8.314, 96485.0
ZERO_C_K, REFERENCE_K, CELL_AH, HOURS_PER_YEAR = 273.15, 298.15, 3.0, 8766.0
# Where the model was measured.
TEMPERATURES_C, MOST_PER_H = (0.0, 55.0), 1.0
LEAST_TOLD_SHARE = 0.005


class _Mechanism(NamedTuple):
    """One loss: factor at 25 degC and 1 C, activation energy [J/mol], and rise with the current [h]."""

    factor: float
    activation_j_per_mol: float
    per_rate_h: float = 0.0

    def at(self, inverse_k: FloatArray, rate_per_h: FloatArray) -> FloatArray:
        """Return k at 1/T - 1/T_ref [1/K] and a charging current [C]."""
        k: FloatArray = self.factor * array_exp(
            -self.activation_j_per_mol / GAS_J_PER_MOL_K * inverse_k + self.per_rate_h * (rate_per_h - MOST_PER_H))
        return k


STORAGE = _Mechanism(3.694e-4, 20592.0)
HOT = _Mechanism(1.456e-4, 32699.0)
COLD = _Mechanism(4.009e-4, -55546.0, 2.64)
FULL, FULL_FROM_SOC = _Mechanism(2.031e-6, -2.33e5, 7.84), 0.82


class AgeingCost(NamedTuple):
    """Cost of a session's loss of capacity, and the share of its charge outside the model's range (0 ... 1)."""

    cost: float
    outside_share: float


def anode_potential_v(soc: FloatArray) -> FloatArray:
    """Return the open-circuit potential of the graphite [V] over the state of charge, eqs. (A1) and (A2)."""
    x = 8.5e-3 + soc * (0.78 - 8.5e-3)
    potential_v: FloatArray = (
        0.6379 + 0.5416 * array_exp(-305.5309 * x) - 0.044 * np.tanh((x - 0.1958) / 0.1088)
        - 0.1978 * np.tanh((x - 1.0571) / 0.0854) - 0.6875 * np.tanh((x + 0.0117) / 0.0529)
        - 0.0175 * np.tanh((x - 0.5692) / 0.0875))
    return potential_v


def storage_factor(soc: FloatArray) -> FloatArray:
    """Return k_cal over that at 50 %, but for k_0, by the state of charge: the second bracket of eq. (9)."""
    factor: FloatArray = 0.142 + array_exp(
        0.384 * FARADAY_C_PER_MOL / (GAS_J_PER_MOL_K * REFERENCE_K) * (0.123 - anode_potential_v(soc)))
    return factor


def lost_per_s(ageing: Ageing, soc: FloatArray, temperature_c: FloatArray, soc_per_s: FloatArray) -> FloatArray:
    """
    Return the share of the capacity that is lost each second [1/s], while a battery is charged.

    `soc` (0 ... 1), `temperature_c` [deg C] and `soc_per_s` [1/s] have one shape. Outside its range the model is
    taken at the edge.
    """
    inverse_k = 1.0 / (np.clip(temperature_c, *TEMPERATURES_C) + ZERO_C_K) - 1.0 / REFERENCE_K
    rate_per_h = soc_per_s * S_PER_H
    within_per_h = np.minimum(rate_per_h, MOST_PER_H)
    charged_ah = ageing.full_cycles * CELL_AH
    per_ah = (HOT.at(inverse_k, within_per_h) / (2.0 * math.sqrt(2.0 * charged_ah))
              + COLD.at(inverse_k, within_per_h) / (2.0 * math.sqrt(charged_ah))
              + np.where(soc >= FULL_FROM_SOC, FULL.at(inverse_k, within_per_h), 0.0))
    per_h = STORAGE.at(inverse_k, within_per_h) * storage_factor(soc) / (
        2.0 * math.sqrt(ageing.age_years * HOURS_PER_YEAR))
    lost: FloatArray = (per_h + per_ah * CELL_AH * rate_per_h) / S_PER_H
    return lost


def cost_per_s(ageing: Ageing | None, soc: FloatArray, temperature_c: FloatArray,
               soc_per_s: FloatArray) -> FloatArray | float:
    """Return the price of `lost_per_s` [1/s]; 0 for a vehicle without Ageing."""
    return 0.0 if ageing is None else ageing.price * lost_per_s(ageing, soc, temperature_c, soc_per_s)


def session_ageing(ageing: Ageing, time_s: FloatArray, temperature_c: FloatArray, soc: FloatArray) -> AgeingCost:
    """Return the AgeingCost of a session, of the states at the ends of its steps, shape (N + 1,)."""
    duration_s, charged = np.diff(time_s), np.diff(soc)
    middle_c, soc_per_s = 0.5 * (temperature_c[1:] + temperature_c[:-1]), charged / duration_s
    low_c, high_c = TEMPERATURES_C
    outside = (middle_c < low_c) | (middle_c > high_c) | (soc_per_s * S_PER_H > MOST_PER_H)
    cost = cost_per_s(ageing, 0.5 * (soc[1:] + soc[:-1]), middle_c, soc_per_s)
    return AgeingCost(float(np.sum(cost * duration_s)),
                      float(charged[outside].sum() / charged.sum()) if charged.any() else 0.0)


def outside_in_words(vehicle: Vehicle, shares: dict[str, float]) -> str | None:
    """Return the sentence on shares of charge outside the model's range, by the name of the session; or None."""
    ageing = charging_of(vehicle).ageing
    if ageing is None:
        return None
    told = ' and '.join(f'{100.0 * share:.0f} % of the charge {name}' for name, share in shares.items()
                        if share >= LEAST_TOLD_SHARE)
    low_c, high_c = TEMPERATURES_C
    return (f'Ageing by {ageing.model}, measured at {low_c:g} ... {high_c:g} degC and up to {MOST_PER_H:g} C: '
            f'{f"outside is {told}, which counts as at the edge" if told else "all charge is within"}.')
