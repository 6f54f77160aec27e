# SPDX-License-Identifier: Apache-2.0
"""Energies are compared only between plans that reach the same."""

from dataclasses import dataclass
from math import nan
from types import SimpleNamespace

import pytest

from bev_preheat.planning.comparison import difference, energy_gap_wh
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle


@dataclass(frozen=True)
class Made:
    """The compared results of a plan."""

    shortfall_k: float = 0.0
    soc_shortfall: float = 0.0
    undeliverable_power_w: float = 0.0
    wh: float = 5000.0
    arrival_temperature_c: float = 25.0

    @property
    def energy_wh(self):
        return SimpleNamespace(battery_total=self.wh)


@pytest.mark.parametrize('plan, optimum, expected', [
    ({}, {}, ''),
    ({'shortfall_k': 0.19}, {}, ''),
    ({'shortfall_k': 0.21}, {}, '0.21 K colder'),
    ({'shortfall_k': 14.13}, {'shortfall_k': 14.13}, ''),
    ({'shortfall_k': 15.5}, {'shortfall_k': 14.25}, '1.25 K colder'),
    ({'shortfall_k': 1.5}, {'shortfall_k': 4.25}, '2.75 K warmer'),
    ({'soc_shortfall': 0.004}, {}, 'reserve missed'),
    ({}, {'soc_shortfall': 0.004}, 'reserve kept'),
    ({'soc_shortfall': 0.02}, {'soc_shortfall': 0.03}, ''),
    # Difference between planning by Euler and by Runge-Kutta.
    ({'soc_shortfall': 0.0004}, {}, ''),
    ({'undeliverable_power_w': 1500.0}, {}, 'power deficit 1.50 kW larger'),
    ({'undeliverable_power_w': 500.0}, {'undeliverable_power_w': 700.0}, 'power deficit 0.20 kW smaller'),
    ({'undeliverable_power_w': 705.0}, {'undeliverable_power_w': 700.0}, ''),
    ({'shortfall_k': nan}, {}, 'unknown arrival'),
    ({}, {'undeliverable_power_w': nan}, 'unknown power')])
def test_what_is_not_the_same_is_said(plan, optimum, expected):
    plan, optimum = Made(**plan, wh=5155.0), Made(**optimum)
    assert difference(plan, optimum) == expected
    assert energy_gap_wh(plan, optimum) == (None if expected else 155.0)


def test_more_than_the_target_is_no_achievement():
    """A plan for 30 degC compared with the goal of 25 degC: it wastes heat, but does not reach more."""
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    state = BatteryState(-7.0, 0.9)
    wanted, hotter = (plan_preheating(vehicle, route, state, Goal(target_c))
                      for target_c in (25.0, 30.0))
    assert hotter.arrival_temperature_c > wanted.arrival_temperature_c + 4.9
    # 5 K of 377 kJ/K by a heater of 87 %, before losses.
    assert energy_gap_wh(hotter, wanted) > 5.0 * 377e3 / 3600.0 / 0.87
