# SPDX-License-Identifier: Apache-2.0
"""
Plans under an Uncertainty, against a recursion of the test's own on a battery without any limit.

The oracle knows C T' = eta P + gamma (T_ambient - T) only: no charge, no resistance. Its temperatures are finer
and its expectation is a sum over nine deviations of a normal distribution, not a diffusion.
"""
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.tunables import NEAR_K, NEAR_PRICE, SHORT_PRICE, SWITCH_ON_EXPECTED_WH
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import grid_fed

VEHICLE = grid_fed(load_vehicle('reference'))
CAPACITY = VEHICLE.battery.heat_capacity_j_per_k
LEAKAGE_W_PER_K = VEHICLE.battery.leakage.gamma_0_w_per_k
FULL_W = VEHICLE.hvch.maximum_power_w - VEHICLE.defaults.cabin_heating_power_w
STEP_S, STEPS, AMBIENT_C, TARGET_C = 60.0, 60, -10.0, 15.0
JOULES_PER_K = CAPACITY / VEHICLE.hvch.efficiency
DEVIATIONS, WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
ROUTE = make_route({
    'duration_s': [STEP_S] * STEPS, 'speed_mps': [0.0], 'propulsion_power_w': [0.0],
    'ambient_temperature_c': [AMBIENT_C]}, VEHICLE.defaults)


def planned(start_c, deviation_k, is_heating=False):
    return plan_preheating(VEHICLE, ROUTE, BatteryState(start_c, 0.5), Goal(TARGET_C),
                           uncertainty=Uncertainty(deviation_k, is_heating))


def after_a_step(temperature_c, heater_w):
    """Return the exact temperatures [deg C] after a step."""
    settled_c = AMBIENT_C + VEHICLE.hvch.efficiency * heater_w / LEAKAGE_W_PER_K
    return settled_c + (temperature_c - settled_c) * np.exp(-STEP_S * LEAKAGE_W_PER_K / CAPACITY)


def thresholds_c(deviation_k):
    """Return the temperatures [deg C] below which a heater that is off is switched on, at each of the steps."""
    grid_c = np.arange(-30.0, 40.0, 0.02)
    short_k = np.maximum(TARGET_C - grid_c, 0.0)
    short_j = JOULES_PER_K * np.where(
        short_k < NEAR_K, NEAR_PRICE * short_k, NEAR_PRICE * NEAR_K + SHORT_PRICE * (short_k - NEAR_K))
    off_j, on_j, found = short_j, short_j.copy(), []
    for k in reversed(range(STEPS)):
        left = np.array((STEPS - k, STEPS - k - 1)) / STEPS
        spread_k = deviation_k * np.sqrt(left[0] ** 2 - left[1] ** 2) * DEVIATIONS

        def expected(values_j, heater_w):
            ends_c = after_a_step(grid_c, heater_w)[:, None] + spread_k
            return np.interp(ends_c, grid_c, values_j) @ WEIGHTS / WEIGHTS.sum()

        stays_off_j, heated_j = expected(off_j, 0.0), FULL_W * STEP_S + expected(on_j, FULL_W)
        switched_j = heated_j + 3600.0 * SWITCH_ON_EXPECTED_WH
        # Below the threshold, as long as heating can still help.
        heats = switched_j < stays_off_j
        found.append(grid_c[heats].max() if heats.any() else -np.inf)
        off_j, on_j = np.minimum(stays_off_j, switched_j), np.minimum(stays_off_j, heated_j)
    return np.array(found[::-1])


@pytest.mark.parametrize('deviation_k', [0.5, 1.0, 2.0])
def test_heating_begins_where_a_recursion_of_the_test_begins_it(deviation_k):
    start_c = 2.0
    unheated_c = AMBIENT_C + (start_c - AMBIENT_C) * np.exp(
        -STEP_S * np.arange(STEPS) * LEAKAGE_W_PER_K / CAPACITY)
    expected = int(np.flatnonzero(unheated_c < thresholds_c(deviation_k))[0])
    plan = planned(start_c, deviation_k)
    assert plan.status is Status.WAITING
    # Values are spread by the distance of temperatures, too, and the price of heating is 2 % more.
    assert plan.heating_start_s / STEP_S == pytest.approx(expected, abs=2.0)


@pytest.mark.parametrize('deviation_k', [0.1, 1.0, 2.0])
def test_it_arrives_at_the_target_in_whole_steps(deviation_k):
    plan = planned(2.0, deviation_k)
    assert plan.arrival_temperature_c == pytest.approx(TARGET_C, abs=0.01)
    heated = np.flatnonzero(plan.hvch_battery_power_w > 1.0)
    powers_w = plan.hvch_battery_power_w[heated]
    assert powers_w[:-1] == pytest.approx(np.full(len(heated) - 1, FULL_W))
    # If it ends within a step, the heater is on at full power, then off.
    end_s = plan.time_s[heated[-1] + 1] if plan.heating_end_s is None else plan.heating_end_s
    assert plan.power_at_w(end_s - 0.01) == pytest.approx(FULL_W, rel=1e-3)
    assert plan.power_at_w(end_s + 0.01) == 0.0


def test_a_heater_that_is_on_stays_on_where_one_that_is_off_stays_off():
    edge_c = thresholds_c(1.0)[0]
    at_edge = [[planned(edge_c + above_k, 1.0, is_heating).heating_start_s == 0.0
                for above_k in np.arange(-1.5, 1.5, 0.1)] for is_heating in (False, True)]
    assert sum(at_edge[1]) > sum(at_edge[0]) > 0


@pytest.mark.parametrize('deviation_k', [np.nan, np.inf, -0.1, 10.1])
def test_an_uncertainty_that_is_none_is_refused(deviation_k):
    with pytest.raises(InvalidInput, match='uncertainty of the arrival: .* is not allowed; it must be 0'):
        planned(2.0, deviation_k)
