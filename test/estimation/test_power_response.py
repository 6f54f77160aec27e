# SPDX-License-Identifier: Apache-2.0
"""Evidence on the heater from the battery's power, with synthetic powers."""

import math

import numpy as np
import pytest

from bev_preheat.estimation.hypotheses import Heater, SHARES
from bev_preheat.estimation.measured_power import PowerResponse
from bev_preheat.tunables import EXCESS_W, MOST_BLOCK_EVIDENCE, POWER_BLOCK_S, SCATTER_W

FAULTS = (Heater.DERATED, Heater.DEAD, Heater.STUCK_ON)
LIMIT_W = 5000.0
# Off, on for 5 min, off again.
ON_S = (600, 900)
SECONDS = 1500


def seen(heater_w=lambda second, command_w: command_w, traffic_w=1000.0, beyond_w=0.0, seed=1):
    """Return the PowerResponse after a heater, and traffic with a time constant of 20 s."""
    response, drawn, extra_w = PowerResponse(), np.random.default_rng(seed), 0.0
    for second in range(SECONDS):
        command_w = LIMIT_W if ON_S[0] <= second < ON_S[1] else 0.0
        extra_w += -extra_w / 20.0 + traffic_w * math.sqrt(2.0 / 20.0) * drawn.standard_normal()
        response, _ = response.seen(
            1.0, beyond_w + extra_w + heater_w(second, command_w), command_w, LIMIT_W)
    return response


def test_the_first_block_is_weighed_as_by_hand():
    response, beyond_w, command_w = PowerResponse(), 4200.0, 5000.0
    for _ in range(int(POWER_BLOCK_S) - 1):
        response, logs = response.seen(1.0, beyond_w, command_w, LIMIT_W)
        assert logs is None
    _, logs = response.seen(1.0, beyond_w, command_w, LIMIT_W)
    # The excess stays uncertain; Student's t with 4 degrees of freedom around each heater's power.
    total_w2 = EXCESS_W**2 + SCATTER_W**2
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
