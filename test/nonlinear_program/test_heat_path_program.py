# SPDX-License-Identifier: Apache-2.0
"""The program with heater and coolant as states: against plans, and against a drive with its powers."""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.nonlinear_program.program import SUCCESS
from bev_preheat.nonlinear_program.solve import solve_optimum
from bev_preheat.numerics import FLOATS
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.heat_path import make_heated_step
from bev_preheat_studies.optimality.drawn_trips import draw_trip

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi')]

REFERENCE = load_vehicle('reference')
LAG = HeatPath(heater_lag_s=60.0)
COOLANT = HeatPath(coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
BOTH = HeatPath(45.0, 15e3, 300.0)
EACH_PATH = pytest.mark.parametrize('path', [
    pytest.param(LAG, marks=pytest.mark.deep), pytest.param(COOLANT, marks=pytest.mark.deep), BOTH])


def situation(path, name='reference'):
    """A vehicle with a heat path, route, state and goal: the paper's trip, or a drawn one."""
    if name == 'reference':
        return (replace(REFERENCE, heat_path=path), load_route('reference', REFERENCE.defaults),
                BatteryState(-7.0, 0.9), Goal(25.0))
    trip = draw_trip(REFERENCE, 4, int(name))
    return replace(trip.vehicle, heat_path=path), trip.route, trip.state, trip.goal


@pytest.mark.parametrize('name', ['reference', pytest.param('2', marks=pytest.mark.deep)])
@EACH_PATH
def test_plans_without_limits_are_within_a_tenth_of_a_watt_hour(name, path):
    inputs = situation(path, name)
    optimum = solve_optimum(*inputs, False)
    assert optimum.solver_status == SUCCESS
    plan = plan_preheating(*inputs)
    assert plan.heating_start_s is not None
    assert plan.arrival_temperature_c == pytest.approx(optimum.plan.arrival_temperature_c, abs=1e-5)
    assert -0.01 < plan.energy_wh.battery_total - optimum.plan.energy_wh.battery_total < 0.1
    assert optimum.plan.heating_start_s == pytest.approx(plan.heating_start_s, abs=60.0)


@EACH_PATH
def test_its_states_are_those_of_a_drive_under_its_commands(path):
    vehicle, route, state, goal = situation(path)
    state = replace(state, heater_power_w=2e3 if path.heater_lag_s else 0.0,
                    coolant_excess_k=4.0 if path.has_coolant else 0.0)
    plan = solve_optimum(vehicle, route, state, goal).plan
    trip, step = make_trip(vehicle, route), make_heated_step(vehicle, FLOATS)
    states = [(state.soc, state.temperature_c, state.heater_power_w, state.coolant_excess_k)]
    for row in zip(*(column.tolist() for column in (*trip.inputs(), plan.hvch_battery_power_w))):
        states.append(step(*states[-1], *row)[:4])
    soc, temperature_c, heater_w, excess_k = np.array(states).T
    assert plan.soc == pytest.approx(soc, abs=1e-9)
    assert plan.battery_temperature_c == pytest.approx(temperature_c, abs=1e-6)
    assert plan.heat.coolant_excess_k == pytest.approx(excess_k, abs=1e-6)
    if path.heater_lag_s:
        assert plan.heat.heater_power_w == pytest.approx(heater_w, abs=1e-3)
