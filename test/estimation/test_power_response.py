# SPDX-License-Identifier: Apache-2.0
"""Evidence on the heater from the battery's power, with synthetic powers."""

import math

import numpy as np
import pytest

from bev_preheat.estimation.hypotheses import Heater, SHARES
from bev_preheat.estimation.measured_power import PowerResponse, PRIOR
from bev_preheat.tunables import (
    CONSUMPTION,
    EXCESS_W,
    MOST_BLOCK_EVIDENCE,
    NO_CONTRADICTION,
    POWER_BLOCK_S,
    SCATTER_W,
)

FAULTS = (Heater.DERATED, Heater.DEAD, Heater.STUCK_ON)
LIMIT_W = 5000.0
# Off, on for 5 min, off again.
ON_S = (600, 900)
SECONDS = 1500


# A drive that alternates between road and motorway.
PROPULSION_W = np.where(np.arange(SECONDS) // 120 % 2, 28e3, 12e3)


def seen(heater_w=lambda second, command_w: command_w, traffic_w=1000.0, beyond_w=0.0, consumption=1.0, seed=1):
    """Return the PowerResponse after a heater, and traffic with a time constant of 20 s."""
    response, drawn, extra_w = PowerResponse(), np.random.default_rng(seed), 0.0
    for second in range(SECONDS):
        command_w = LIMIT_W if ON_S[0] <= second < ON_S[1] else 0.0
        extra_w += -extra_w / 20.0 + traffic_w * math.sqrt(2.0 / 20.0) * drawn.standard_normal()
        response, _ = response.seen(
            1.0, beyond_w + (consumption - 1.0) * PROPULSION_W[second] + extra_w + heater_w(second, command_w),
            PROPULSION_W[second], command_w, LIMIT_W, PRIOR)
    return response


def test_the_first_block_is_weighed_as_by_hand():
    response, beyond_w, propulsion_w, command_w = PowerResponse(), 4200.0, 20e3, 5000.0
    for _ in range(int(POWER_BLOCK_S) - 1):
        response, logs = response.seen(1.0, beyond_w, propulsion_w, command_w, LIMIT_W, PRIOR)
        assert logs is None
    _, logs = response.seen(1.0, beyond_w, propulsion_w, command_w, LIMIT_W, PRIOR)
    # Excess and consumption stay uncertain; Student's t with 4 degrees of freedom around each heater's power.
    total_w2 = EXCESS_W**2 + (CONSUMPTION * propulsion_w)**2 + SCATTER_W**2
    errors_w = beyond_w - np.array([*np.multiply(SHARES[:-1], command_w), LIMIT_W])
    expected = -2.5 * np.log(1.0 + errors_w**2 / (4.0 * total_w2))
    assert expected.max() - expected.min() < MOST_BLOCK_EVIDENCE
    assert logs - logs.max() == pytest.approx(expected - expected.max(), abs=1e-9)


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('fault, heater_w', [
    (Heater.DEAD, lambda second, command_w: 0.0), (Heater.DERATED, lambda second, command_w: 0.5 * command_w),
    (Heater.STUCK_ON, lambda second, command_w: LIMIT_W if second >= 700 else command_w)])
def test_a_fault_is_supported_by_the_power(fault, heater_w, seed):
    response = seen(heater_w, traffic_w=300.0, seed=seed)
    assert response.support(fault) > math.log(20.0)
    assert response.support(fault) == max(response.support(each) for each in FAULTS)


def test_traffic_that_hides_the_heater_supports_nothing():
    for share in (0.0, 1.0):
        response = seen(lambda second, command_w: share * command_w, traffic_w=15e3)
        assert all(abs(response.support(fault)) < math.log(20.0) for fault in (Heater.DEAD, Heater.DERATED))


def test_a_consumer_that_the_plan_does_not_know_is_no_dead_or_weak_heater():
    response = seen(beyond_w=3000.0)
    assert all(response.support(fault) < 0.0 for fault in (Heater.DEAD, Heater.DERATED))


@pytest.mark.parametrize('consumption', [0.85, 0.92, 1.08, 1.15])
def test_a_consumption_that_the_plan_does_not_know_is_no_faulty_heater(consumption):
    response = seen(traffic_w=300.0, consumption=consumption)
    assert all(response.support(fault) < math.log(2.0) for fault in FAULTS)


def test_power_that_a_healthy_heater_left_unexplained_is_no_sign_of_a_later_fault():
    """Half an hour of 5 kW without a cause; until then the temperature excludes a heater that is stuck on."""
    only_healthy, ratios = np.eye(len(SHARES))[0] + 1e-12, {}
    for stuck_w in (0.0, LIMIT_W):
        response, ratios[stuck_w] = PowerResponse(), 0.0
        for second in range(2100):
            heaters = only_healthy if second < 1800 else PRIOR
            response, logs = response.seen(
                1.0, LIMIT_W + (stuck_w if second >= 1800 else 0.0), 0.0, 0.0, LIMIT_W, heaters)
            if second >= 1800 and logs is not None:
                ratios[stuck_w] += logs[-1] - logs[0]
    assert ratios[0.0] < -2.0
    assert ratios[LIMIT_W] > 2.0


def test_power_that_answers_contradicts_a_dead_heater_whatever_the_temperature_says():
    """A sensor that is stuck makes a dead heater certain, once the heater has begun."""
    surely_dead, response, supports = np.eye(len(SHARES))[3] + 1e-12, PowerResponse(), []
    for second in range(900):
        command_w = LIMIT_W if second >= 300 else 0.0
        response, _ = response.seen(
            1.0, command_w, 20e3, command_w, LIMIT_W, surely_dead if second >= 500 else PRIOR)
        supports.append(response.support(Heater.DEAD))
    assert supports[499] < NO_CONTRADICTION
    assert max(supports[500:]) < NO_CONTRADICTION
