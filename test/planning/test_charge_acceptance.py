# SPDX-License-Identifier: Apache-2.0
"""Regeneration that a fuller battery rejects on a descent, against forward runs that start with more charge."""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.planning.charge_acceptance import find_acceptance_loss
from bev_preheat.planning.limits import run_unheated, watch_limits
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

REFERENCE = load_vehicle('reference')
HEATER_W = REFERENCE.hvch.maximum_power_w
START = BatteryState(temperature_c=-5.0, soc=0.8)
# Without drivetrain heat, the brake changes the charge alone.
NO_WASTE_HEAT = replace(REFERENCE, drivetrain=replace(
    REFERENCE.drivetrain, heat_recovery_efficiency=0.0))


def descent(power_w=-60e3, cabin_w=HEATER_W):
    """20 min of regeneration, then 5 min on the level."""
    return make_trip(NO_WASTE_HEAT, make_route({
        'duration_s': np.full(50, 30.0), 'speed_mps': [15.0],
        'propulsion_power_w': np.repeat([power_w, 15e3], [40, 10]),
        'ambient_temperature_c': [-5.0], 'cabin_heating_power_w': [cabin_w],
        'auxiliary_power_w': [400.0]}, REFERENCE.defaults))


def loss_along(trip, state=START):
    run = run_unheated(trip, state)
    return find_acceptance_loss(trip, watch_limits(trip, run.soc, run.temperature_c), run)


def test_loss_is_what_is_missing_on_arrival_of_charge_that_was_there_before():
    trip, more_soc = descent(), 1e-4
    loss = loss_along(trip)
    runs = [run_unheated(trip, replace(START, soc=START.soc + extra))
            for extra in (-more_soc, more_soc)]
    kept = (runs[1].soc[-1] - runs[0].soc[-1]) / (2.0 * more_soc)
    assert 0.5 < kept < 0.95
    # The fuller battery also makes less Joule heat while it takes less, and stays colder.
    assert np.prod(1.0 - loss.to_brake) == pytest.approx(kept, abs=0.02)
    assert not loss.to_heater.any()


def test_heater_gets_what_the_battery_does_not_take_until_it_has_no_more_room():
    trip = descent(-25e3, cabin_w=0.0)
    run = run_unheated(trip, START)
    loss = find_acceptance_loss(trip, watch_limits(trip, run.soc, run.temperature_c), run)
    # Cold, the battery accepts so little that the brake gets a share; once it is warm, the heater gets all the
    # surplus.
    is_braked, is_heated = run.brake_power_w > 0.0, run.heater_power_w > 0.0
    assert is_braked.any() and (is_heated & ~is_braked).any()
    np.testing.assert_array_equal(loss.to_brake > 0.0, is_braked)
    np.testing.assert_array_equal(loss.to_heater > 0.0, is_heated & ~is_braked)


def test_nothing_is_lost_where_the_limit_is_not_active():
    loss = loss_along(descent())
    assert not (loss.to_brake[40:].any() or loss.to_heater[40:].any())
    assert not loss_along(descent(-1e3)).any
