# SPDX-License-Identifier: Apache-2.0
"""Trips to a known charger for tests of the chosen target, and the cost of a target."""

import math

import numpy as np
from stepwise import Stepwise

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import Charger, ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.target_choice import TargetSearchInput
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import Route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
PRICES = Prices(0.55, 12.0)
MEASURED = Settings(estimation=False, energy_price_per_kwh=0.55, value_of_time_per_h=12.0)
FAST, SLOW = Charger(150e3, 0.8), Charger(50e3, 0.8)
STATE = BatteryState(6.0, 0.35)
# Enough updates for any search, with one plan each.
ENOUGH = 85


def drive(minutes=25, ambient_c=-8.0, cabin_w=1500.0, power_w=15e3):
    """Return a Route of one-minute steps at 90 km/h."""
    return Route(np.full(minutes, 60.0), *(np.full(minutes, value) for value in (
        25.0, power_w, power_w, ambient_c, cabin_w, 400.0, power_w)))


def a_mission(charger=FAST, route_id='home', route=None, start_ns=START_NS, **leg):
    return Mission(route_id, (Leg(route or drive(), start_ns, charger=charger, **leg),))


def a_supervisor(charger=FAST, settings=MEASURED, vehicle=VEHICLE, learned=None, **mission):
    supervisor = Stepwise(vehicle, settings, learned)
    supervisor.run(START_NS)
    supervisor.accept_mission(a_mission(charger, **mission))
    return supervisor


def feed(supervisor, at_s=0.0, state=STATE):
    """Take in a battery state; return the Decision."""
    now_ns = START_NS + round(at_s * NS_PER_S)
    supervisor.accept_battery(Measurement(state, now_ns), now_ns)
    return supervisor.state.decision


def cost(vehicle, route, state, target_c, charger, prices=PRICES, minimum_soc=0.0):
    """Return the cost of a target (None: no heating), computed from plan, session and prices."""
    goal = Goal(20.0 if target_c is None else target_c, minimum_soc)
    plan = (plan_unheated if target_c is None else plan_preheating)(vehicle, route, state, goal)
    stop = ChargingStop(charger.power_w, charger.departure_soc, float(route.ambient_temperature_c[-1]),
                        float(route.cabin_heating_power_w[-1]), float(route.auxiliary_power_w[-1]))
    heating = ChargerHeating(vehicle, stop, prices)
    unheated = plan_unheated(vehicle, route, state, goal)
    # The unheated arrival comes first, as in the search: the heat at the charger is fitted to it.
    for arrived in (unheated, plan):
        session = heating.choose(BatteryState(arrived.arrival_temperature_c, arrived.arrival_soc)).session
    return (prices.energy_per_kwh * session.bought_energy_wh / 1000.0
            + prices.time_per_h * session.charging_time_s / 3600.0)


def target_of(choice):
    return choice.target_c if choice.heating_pays else None


def search_input(at_s, factors=(0.0, 0.0, 0.0, 0.0, 0.0), state=STATE):
    """Return the search input of the decision maker, for a car with these logarithms of its factors."""
    leg, = a_mission().legs
    car = corrected_vehicle(VEHICLE, Corrections(*np.exp(factors[:4]).tolist()))
    return TargetSearchInput('home', 0, leg, MEASURED, Goal(25.0), car, drive().with_propulsion(
        math.exp(factors[4])), state, START_NS + round(at_s * NS_PER_S))
