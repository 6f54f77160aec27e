# SPDX-License-Identifier: Apache-2.0
"""The best target of `preheat worth` never costs more than no heating, with a heat path and in coarse steps."""

from dataclasses import fields, replace

import numpy as np
import pytest

from bev_preheat.charging.stop import stop_after
from bev_preheat.charging.worth import find_worth, WorthSearch
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.vehicle.description import HeatPath
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip

# 41 s of heater lag and 12 kJ/K of coolant.
PATH = HeatPath(41.0, 12e3, 450.0)
COARSE_S, FINE_S = 20.0, 5.0
# Share of the cost by which steps of 20 s may falsify a saving.
MOST_FALSIFIED = 1e-4


def in_steps(route, step_s):
    """Return the same drive in steps of an equal length."""
    counts = np.rint(route.duration_s / step_s).astype(int)
    columns = {field.name: np.repeat(getattr(route, field.name), counts) for field in fields(route)}
    return replace(route, **{**columns, 'duration_s': np.full(counts.sum(), step_s)})


@pytest.mark.costly
@pytest.mark.parametrize('number', [
    pytest.param(number, marks=[] if number == 4 else pytest.mark.deep) for number in range(24)])
def test_the_best_target_costs_no_more_than_no_heating(number):
    trip = draw_charging_trip(11, number)
    vehicle = replace(trip.vehicle, heat_path=PATH)

    def find(step_s, prices):
        return find_worth(vehicle, in_steps(trip.route, step_s), trip.state, trip.goal,
                          trip.stop.charger_power_w, trip.stop.departure_soc, prices)

    try:
        worth = find(COARSE_S, trip.prices)
        # The value of time is just enough for heating to pay, so a rounding error would decide.
        value = worth.break_even_value_of_time_per_h
        prices = trip.prices if value is None else replace(trip.prices, time_per_h=1.001 * value)
        worth = find(COARSE_S, prices)
    except InvalidInput:
        # The trip cannot be driven, or the battery not charged.
        return
    assert worth.best.cost <= worth.without_heating.cost
    if worth.best is worth.without_heating:
        return
    assert worth.best.cost == min(target.cost for target in worth.targets)
    # In finer steps the target costs no more than no heating, up to the error of the steps.
    fine = in_steps(trip.route, FINE_S)
    search = WorthSearch(
        vehicle, stop_after(fine, trip.stop.charger_power_w, trip.stop.departure_soc),
        plan_unheated(vehicle, fine, trip.state, trip.goal), trip.goal.target_temperature_c, prices,
        lambda target_c: plan_preheating(vehicle, fine, trip.state, replace(
            trip.goal, target_temperature_c=target_c, heats_until_arrival=True)))
    again = search.look_at(worth.best.target_c)
    assert again.cost <= search.without.cost * (1.0 + MOST_FALSIFIED)
