# SPDX-License-Identifier: Apache-2.0
"""Plans that heat until arrival, because the heat under way reaches the battery at the charger."""

from dataclasses import replace
from functools import partial
from itertools import product

from drives import route_of
import numpy as np
import pytest

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import stop_after
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath

REFERENCE = load_vehicle('reference')
LATE = replace(REFERENCE, heat_path=HeatPath(45.0, 15e3, 300.0))
STATE, GOAL = BatteryState(-9.0, 0.45), Goal(11.0)
COUNTED = replace(GOAL, heats_until_arrival=True)
PRICES = Prices(0.37, 29.0)


# Of 40 one-minute steps, at -9 degC.
drive = partial(route_of, step_s=60.0, speed_mps=24.0, ambient_c=-9.0, cabin_w=1300.0, auxiliary_w=350.0)
FLAT = drive((40, 14e3))
# Regeneration, which a cold battery may not take, and then a climb.
HILLY = drive((12, 12e3), (8, -45e3), (12, 11e3), (8, 60e3))


@pytest.mark.parametrize('route, target_c', [(FLAT, 11.0), (HILLY, 21.0)], ids=['flat', 'hilly'])
def test_the_arrival_is_as_warm_and_heating_begins_later(route, target_c):
    usual, counted = (plan_preheating(LATE, route, STATE, replace(
        goal, target_temperature_c=target_c)) for goal in (GOAL, COUNTED))
    assert counted.arrival_temperature_c == pytest.approx(usual.arrival_temperature_c, abs=2e-3)
    assert usual.hvch_battery_power_w[-1] < 5000.0
    assert counted.hvch_battery_power_w[-1] == pytest.approx(REFERENCE.hvch.maximum_power_w - 1300.0)
    on_usual, on_counted = (np.flatnonzero(plan.hvch_battery_power_w > 1.0) for plan in (usual, counted))
    assert on_counted[-1] == 39 >= on_usual[-1]
    assert counted.heating_start_s >= usual.heating_start_s
    # More heat is under way on arrival.
    assert counted.heat.coolant_excess_k[-1] > usual.heat.coolant_excess_k[-1] + 5.0


def test_heat_for_a_climb_is_not_followed_by_more():
    usual, counted = (plan_preheating(LATE, HILLY, STATE, goal) for goal in (GOAL, COUNTED))
    assert usual.arrival_temperature_c > GOAL.target_temperature_c + 1.0
    assert (counted.hvch_battery_power_w == usual.hvch_battery_power_w).all()


def test_a_heater_that_is_on_for_the_target_stays_on():
    """The planner plans again on every battery state; the later start must not switch the heater off."""
    plan = plan_preheating(LATE, FLAT, STATE, COUNTED)
    step = int(np.searchsorted(plan.time_s, plan.heating_start_s)) + 2
    state = BatteryState(float(plan.battery_temperature_c[step]), float(plan.soc[step]),
                         float(plan.heat.heater_power_w[step]), float(plan.heat.coolant_excess_k[step]))
    again = plan_preheating(
        LATE, FLAT.after(60.0 * step), state, COUNTED, uncertainty=Uncertainty(0.3, direction=1))
    assert again.heating_start_s == pytest.approx(0.0, abs=1e-6)


def test_no_other_start_and_end_of_heating_costs_less_than_the_best_target():
    """The oracle drives full power between any two instants, and charges after it."""
    vehicle = replace(LATE, charging=replace(REFERENCE.charging, battery_heating=False))
    best = find_worth(vehicle, FLAT, STATE, GOAL, 150e3, 0.75, PRICES).best
    trip, stop = make_trip(vehicle, FLAT), stop_after(FLAT, 150e3, 0.75)
    heating = ChargerHeating(vehicle, stop, PRICES)

    def cost(on_s, off_s):
        share = np.clip((np.minimum(trip.time_s[1:], off_s) - np.maximum(trip.time_s[:-1], on_s)) / 60.0, 0.0, 1.0)
        driven = drive_as_planned(trip, STATE, share * trip.heater_limit_w)
        return heating.choose(BatteryState(
            float(driven.temperature_c[-1]), float(driven.soc[-1]), float(driven.heat.heater_power_w[-1]),
            float(driven.heat.coolant_excess_k[-1]))).cost

    found = min(cost(on_s, off_s) for on_s, off_s in product(
        np.arange(0.0, 2400.0, 120.0), (1920.0, 2160.0, 2280.0, 2340.0, 2370.0, 2400.0)) if on_s < off_s)
    assert best.cost <= found * (1.0 + 1e-4)
    # With the heater off before arrival, the same search over targets would be dearer.
    usual = min(heating.choose(plan_preheating(
        vehicle, FLAT, STATE, Goal(float(target_c))).arrival_state).cost for target_c in np.arange(4.0, 24.0, 0.5))
    assert best.cost < usual * (1.0 - 2e-4)
