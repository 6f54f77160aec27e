# SPDX-License-Identifier: Apache-2.0
"""Ageing by the published equations, for one state at a time: no code of the package but its description."""

from math import exp, sqrt, tanh

from bev_preheat.vehicle.description import Ageing

AGEING = Ageing('schimpe_2018', 9000.0, age_years=4.0, full_cycles=300.0, end_of_life=0.75)


def own_cost_per_s(soc, temperature_c, soc_per_s, ageing=AGEING):
    """Return the price of ageing [1/s]."""
    kelvin, per_h = min(max(temperature_c, 0.0), 55.0) + 273.15, min(3600.0 * soc_per_s, 1.0)
    x = 8.5e-3 + soc * (7.8e-1 - 8.5e-3)
    anode_v = (0.6379 + 0.5416 * exp(-305.5309 * x) + 0.044 * tanh(-(x - 0.1958) / 0.1088)
               - 0.1978 * tanh((x - 1.0571) / 0.0854) - 0.6875 * tanh((x + 0.0117) / 0.0529)
               - 0.0175 * tanh((x - 0.5692) / 0.0875))

    def arrhenius(activation):
        return exp(-activation / 8.314 * (1.0 / kelvin - 1.0 / 298.15))

    hours, amperes, in_ah = 8766.0 * ageing.age_years, 3.0 * 3600.0 * soc_per_s, 3.0 * ageing.full_cycles
    storage = 3.694e-4 * arrhenius(20592.0) * (
        exp(0.384 * 96485.0 / 8.314 * (0.123 - anode_v) / 298.15) + 0.142) / (2.0 * sqrt(hours))
    hot = 1.456e-4 * arrhenius(32699.0) / (2.0 * sqrt(2.0 * in_ah))
    cold = 4.009e-4 * arrhenius(-55546.0) * exp(2.64 * (3.0 * per_h - 3.0) / 3.0) / (2.0 * sqrt(in_ah))
    full = 2.031e-6 * arrhenius(-2.33e5) * exp(7.84 * (3.0 * per_h - 3.0) / 3.0) * (soc >= 0.82)
    lost_per_h = storage + (hot + cold + full) * amperes
    return ageing.battery_price / (1.0 - ageing.end_of_life) * lost_per_h / 3600.0


def own_session_cost(session):
    """Return the price of a Session's ageing, by the midpoint rule."""
    ends = list(zip(session.time_s.tolist(), session.battery_temperature_c.tolist(), session.soc.tolist()))
    return sum((after[0] - before[0]) * own_cost_per_s(
        0.5 * (before[2] + after[2]), 0.5 * (before[1] + after[1]),
        (after[2] - before[2]) / (after[0] - before[0])) for before, after in zip(ends, ends[1:]))
