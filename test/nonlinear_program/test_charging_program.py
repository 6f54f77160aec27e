# SPDX-License-Identifier: Apache-2.0
"""The joint program of drive and session: against scans of its own, and against the best target."""

from dataclasses import replace

import numpy as np
from own_car import Car
import pytest

from bev_preheat.charging.equations import heated_c, heater_power_of
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import ChargingStop, stop_after
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import Route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat_studies.optimality import charging_program
from bev_preheat_studies.optimality.charging_program import ChargingProgram, solve_charging, symbolic_charging_step

REFERENCE, LFP = load_vehicle('reference'), load_vehicle('mid_size_lfp')
COOLANT = replace(REFERENCE, heat_path=HeatPath(40.0, 8e3, 600.0, 0.0))
UNHEATED_AT_CHARGER = replace(LFP, charging=replace(LFP.charging, battery_heating=False))
GOAL, PRICES = Goal(25.0), Prices(0.55, 12.0)


def drive(minutes=25, ambient_c=-8.0):
    """Return a Route of one-minute steps at 90 km/h and 15 kW."""
    return Route(np.full(minutes, 60.0), *(np.full(minutes, value) for value in (
        25.0, 15e3, 15e3, ambient_c, 1500.0, 400.0, 15e3)))


# Vehicle, route, state, charger [W], departure, prices.
CASES = {
    'usual': (REFERENCE, drive(), BatteryState(6.0, 0.35), 150e3, 0.8, PRICES),
    'time is worth nothing': (
        REFERENCE, drive(), BatteryState(-5.0, 0.35), 150e3, 0.8, Prices(0.55, 0.0)),
    'only time counts': (REFERENCE, drive(), BatteryState(-5.0, 0.35), 150e3, 0.8, Prices(0.0, 12.0)),
    'time is worth all': (REFERENCE, drive(), BatteryState(-5.0, 0.35), 150e3, 0.8, Prices(0.55, 1e6)),
    'weak charger in the cold': (
        REFERENCE, drive(ambient_c=-20.0), BatteryState(-18.0, 0.35), 6e3, 0.35, PRICES),
    'lfp': (LFP, drive(ambient_c=-15.0), BatteryState(-15.0, 0.35), 88e3, 0.6, PRICES),
    'lfp not heated at the charger': (
        UNHEATED_AT_CHARGER, drive(ambient_c=-15.0), BatteryState(-15.0, 0.35), 88e3, 0.6, PRICES),
    'heat path': (COOLANT, drive(), BatteryState(-5.0, 0.35), 150e3, 0.8, PRICES),
}
DAILY = ('lfp not heated at the charger',)


def solved(case, **options):
    """Return (Worth, ChargingOptimum) of a case in CASES; the program does not know the best target."""
    vehicle, route, state, charger_w, departure_soc, prices = case
    return (find_worth(vehicle, route, state, GOAL, charger_w, departure_soc, prices),
            solve_charging(vehicle, route, state, GOAL, stop_after(route, charger_w, departure_soc),
                           prices, **options))


@pytest.mark.costly
@pytest.mark.parametrize('name', [
    pytest.param(name, marks=[] if name in DAILY else [pytest.mark.deep]) for name in CASES])
def test_the_best_target_costs_what_the_program_does(name):
    worth, optimum = solved(CASES[name])
    # Both are simulated: they differ by no more than the cost of their resolution.
    assert worth.best.cost == pytest.approx(optimum.best.cost, rel=1e-4)
    assert len(optimum.attempts) >= 2


@pytest.mark.deep
@pytest.mark.costly
def test_a_program_that_may_heat_at_any_time_finds_the_best_switch_of_a_scan():
    vehicle, route, state, charger_w, departure_soc, prices = CASES['usual']
    stop = stop_after(route, charger_w, departure_soc)
    program = ChargingProgram(vehicle, route, state, GOAL, stop, prices)
    attempt = program.attempt(plan_unheated(vehicle, route, state, GOAL))
    # Without limits late heat is best: full power from some instant on, one step heated in part.
    costs, heating = [], ChargerHeating(vehicle, stop, prices)
    limit_w = vehicle.hvch.maximum_power_w - 1500.0
    # The coarse scan begins before the cheapest instant, the fine one is around it.
    for heated_steps in (*np.arange(0.0, 25.0), *np.arange(-0.9, 1.0, 0.1)):
        if len(costs) >= 25:
            heated_steps += int(np.argmin(costs[:25]))
        heater_w = limit_w * np.clip(heated_steps - np.arange(24, -1, -1), 0.0, 1.0)
        soc, temperature_c, _ = Car(vehicle).drive(route, state, heater_w)[-1].tolist()
        costs.append(heating.choose(BatteryState(temperature_c, soc)).cost)
    assert attempt.driven.cost == pytest.approx(min(costs), rel=2e-5)
    # The program's own cost has rounded corners and longer steps.
    assert attempt.program_cost == pytest.approx(attempt.driven.cost, rel=1e-3)


@pytest.mark.deep
def test_half_and_twice_the_steps_at_the_charger_change_hardly_anything():
    vehicle, route, state, charger_w, departure_soc, prices = CASES['usual']
    stop = stop_after(route, charger_w, departure_soc)
    unheated = plan_unheated(vehicle, route, state, GOAL)
    coarse, usual, fine = (ChargingProgram(
        vehicle, route, state, GOAL, stop, prices, steps).attempt(unheated) for steps in (40, 80, 160))
    assert abs(fine.program_cost - usual.program_cost) < 5e-5 * fine.program_cost
    assert abs(usual.program_cost - coarse.program_cost) < 5e-5 * fine.program_cost
    assert fine.driven.cost == pytest.approx(usual.driven.cost, rel=1e-5)


@pytest.mark.parametrize('vehicle', [
    COOLANT, *(pytest.param(vehicle, marks=pytest.mark.deep) for vehicle in (REFERENCE, UNHEATED_AT_CHARGER))],
    ids=['coolant', 'direct', 'unheated'])
def test_its_steps_lead_where_the_session_does(vehicle, monkeypatch):
    # With hardly rounded corners, only the session's own equations remain.
    monkeypatch.setattr(charging_program, 'TEMPERATURE_WIDTH_K', 0.01)
    monkeypatch.setattr(charging_program, 'SWITCH_K', 0.05)
    stop = ChargingStop(88e3, 0.5, -8.0, 1500.0, 400.0)
    session = charge(vehicle, stop, BatteryState(9.0, 0.2, 0.0, 0.0))
    step = symbolic_charging_step(vehicle, stop)
    steps = 300
    states, bought_j = [0.2, 9.0, 0.0, 0.0], 0.0
    duration_s = session.charging_time_s / steps
    for _ in range(steps):
        reached = states
        # The temperature at the end is implicit: the program solves for it; here it is iterated.
        for _ in range(20):
            *reached, terminal_w, drawn_w = map(float, step(
                *states, duration_s, heated_c(vehicle, *reached[1:]), heater_power_of(vehicle, stop)))
        states = reached
        bought_j += duration_s * (terminal_w + drawn_w + 1900.0)
    assert states[0] == pytest.approx(0.5, abs=1e-4)
    assert states[1] == pytest.approx(session.battery_temperature_c[-1], abs=0.05)
    assert bought_j / 3600.0 == pytest.approx(session.bought_energy_wh, rel=3e-4)
