# SPDX-License-Identifier: Apache-2.0
"""Heating from the grid at the least cost: against a linear program of the exact solution of the heat balance."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.planning.plan import cost_of
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.tunables import BELOW_HIGHEST_K
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import grid_fed

VEHICLE = load_vehicle('reference')
GRID = grid_fed(VEHICLE)
STEP_S = 300.0
FULL_W = VEHICLE.hvch.maximum_power_w - VEHICLE.defaults.cabin_heating_power_w
LEAKAGE_W_PER_K = VEHICLE.battery.leakage.gamma_0_w_per_k
TAU_S = VEHICLE.battery.heat_capacity_j_per_k / LEAKAGE_W_PER_K
CEILING_C = VEHICLE.battery.temperature_range_c[1] - BELOW_HIGHEST_K
SOC = 0.5

prices_of_an_hour = st.lists(
    st.floats(-0.3, 1.0).map(lambda price: round(price, 3)), min_size=1, max_size=10)


def standing(hours, ambient_c):
    return make_route({'duration_s': [STEP_S] * round(hours * 3600.0 / STEP_S), 'speed_mps': [0.0],
                       'propulsion_power_w': [0.0], 'ambient_temperature_c': [ambient_c]}, VEHICLE.defaults)


def hourly(prices):
    """Return the prices of each step for prices of each hour, by their integral over time."""
    edges_s = 3600.0 * np.arange(len(prices) + 1)
    paid = np.concatenate(([0.0], np.cumsum(3600.0 * np.array(prices))))
    return lambda time_s: np.diff(np.interp(time_s, edges_s, paid)) / np.diff(time_s)


def planned(prices, start_c, ambient_c, target_c, **options):
    return plan_preheating(
        GRID, standing(len(prices), ambient_c), BatteryState(start_c, SOC), Goal(target_c),
        step_prices=hourly(prices), **options)


def rises_k(steps):
    """
    Return the matrix (N, N) of the rise [K] at the end of step i by full power in step j.

    The exact solution of C T' = eta P + gamma (T_ambient - T) for constant power in a step.
    """
    stationary_k = VEHICLE.hvch.efficiency * FULL_W / LEAKAGE_W_PER_K
    ends_s = STEP_S * np.arange(1, steps + 1)
    after_s = ends_s[:, None] - ends_s[None, :]
    return np.where(after_s >= 0.0, stationary_k * (1.0 - np.exp(-STEP_S / TAU_S)) * np.exp(
        -np.maximum(after_s, 0.0) / TAU_S), 0.0)


def least_cost(prices, start_c, ambient_c, target_c):
    """Return (cost, is feasible) of the linear program: shares of full power that end exactly at the target."""
    from scipy.optimize import linprog
    step_prices = np.repeat(prices, round(3600.0 / STEP_S))
    rises = rises_k(len(step_prices))
    unheated_c = ambient_c + (start_c - ambient_c) * np.exp(
        -STEP_S * np.arange(1, len(step_prices) + 1) / TAU_S)
    found = linprog(step_prices * FULL_W * STEP_S / 3.6e6, A_ub=rises, b_ub=CEILING_C - unheated_c,
                    A_eq=rises[-1:], b_eq=[target_c - unheated_c[-1]], bounds=(0.0, 1.0), method='highs')
    return found.fun, found.status == 0


@pytest.mark.needs('scipy')
@given(prices_of_an_hour, st.floats(-15.0, 10.0), st.floats(-15.0, 5.0), st.floats(12.0, 38.0))
def test_it_costs_as_little_as_the_linear_program(prices, start_c, ambient_c, target_c):
    plan = planned(prices, start_c, ambient_c, target_c)
    # A negative price counts as 0.
    counted = np.maximum(prices, 0.0)
    cost, is_feasible = least_cost(counted, start_c, ambient_c, target_c)
    if not is_feasible:
        assert plan.status is Status.TARGET_UNREACHABLE
        return
    assert plan.arrival_temperature_c == pytest.approx(target_c, abs=1e-3)
    energy_kwh = np.abs(plan.hvch_battery_power_w).sum() * STEP_S / 3.6e6
    # The recursion's temperatures lie apart, and what costs nothing counts as a thousandth of the highest price.
    tolerance = 2e-3 * energy_kwh * max(counted) + 1e-6
    assert cost_of(plan, hourly(counted)) == pytest.approx(cost, abs=tolerance)
    assert plan.battery_temperature_c.max() <= max(CEILING_C, start_c) + 0.01


@pytest.mark.parametrize('target_c', [14.0, 15.0, 16.0])
def test_heat_that_costs_nothing_ends_at_the_target_all_the_same(target_c):
    plan = planned([0.0, 1.0, 1.0], 8.0, -4.0, target_c)
    assert plan.arrival_temperature_c == pytest.approx(target_c, abs=2e-3)
    assert not plan.hvch_battery_power_w[12:].any()


def test_a_grid_that_pays_is_no_reason_to_heat_early_and_hot():
    # Ten hours at negative prices: the earliest heating would leak the most, and be paid the most.
    plan = planned([-0.5] * 10, 0.0, 0.0, 35.0)
    latest = plan_preheating(GRID, standing(10, 0.0), BatteryState(0.0, SOC), Goal(35.0))
    assert plan.arrival_temperature_c == pytest.approx(35.0, abs=1e-3)
    assert plan.battery_temperature_c.max() <= 35.0 + 0.01
    assert plan.heating_start_s == pytest.approx(latest.heating_start_s, abs=STEP_S)


@pytest.mark.parametrize('prices, insures', [([0.3] * 4, False), ([0.05] * 2 + [0.5] * 2, True)])
def test_what_is_uncertain_is_answered_by_more_heat_only_where_that_is_cheap(prices, insures):
    # At one price a later hour repairs what turns out colder; after cheap hours it is dear, so more is stored.
    certain, careful = (planned(prices, -5.0, -8.0, 12.0, uncertainty=Uncertainty(deviation_k))
                        for deviation_k in (0.1, 6.0))
    assert careful.heating_start_s <= certain.heating_start_s
    if insures:
        assert careful.arrival_temperature_c > 13.0
    else:
        assert careful.arrival_temperature_c == pytest.approx(12.0, abs=1e-3)
        assert certain.heating_start_s - careful.heating_start_s <= 3 * STEP_S


@pytest.mark.parametrize('price', [np.nan, np.inf])
def test_a_price_that_is_no_number_is_refused(price):
    with pytest.raises(InvalidInput, match='price of energy: is not a number in every step'):
        planned([0.3, price], 0.0, 0.0, 20.0)


def test_a_battery_that_is_warm_enough_is_not_heated_even_if_the_grid_pays():
    plan = planned([-0.2, -0.2], 30.0, 20.0, 15.0)
    assert plan.status is Status.NOT_NEEDED and not plan.hvch_battery_power_w.any()
