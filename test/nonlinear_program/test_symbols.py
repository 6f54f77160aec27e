# SPDX-License-Identifier: Apache-2.0
"""The model as CasADi expressions against the same model in plain floats, at random points."""

from dataclasses import replace

import casadi
import numpy as np
import pytest

from bev_preheat.nonlinear_program.drive_steps import along_rows
from bev_preheat.nonlinear_program.symbols import symbolic_curve, symbolic_rates, symbolic_step
from bev_preheat.numerics import FLOATS, SATURATING_FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.heat_path import make_heated_step
from bev_preheat.vehicle.model import make_rates
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

# Formulas, and tables.
VEHICLES = {name: load_vehicle(name) for name in ('reference', 'small_car')}
CURVES = ('open_circuit_voltage', 'resistance', 'discharge_power_limit', 'charge_power_limit')
POINTS = 300
# Both sides round each of about a hundred operations to 1e-16.
ROUNDING = 1e-12
# In the functions' order: of the heat capacity, of the resistance and of the heater's efficiency.
FACTORS = (1.13, 0.79, 0.93, 1.2)
CORRECTIONS = Corrections(heat_capacity=1.13, resistance=0.79, heater_efficiency=0.93)


@pytest.fixture(params=VEHICLES)
def vehicle(request):
    return VEHICLES[request.param]


def random_points(vehicle, seed):
    """
    States and inputs of steps, one per row, in the order of a step's arguments without duration.

    States extend beyond the ends of the tables; powers up to nearly the circuit's maximum.
    """
    random = np.random.default_rng(seed)
    battery = vehicle.battery
    voltage = battery.open_circuit_voltage.function(FLOATS)
    resistance = battery.resistance.function(FLOATS)
    for _ in range(POINTS):
        soc, temperature_c = random.uniform(-0.1, 1.1), random.uniform(-38.0, 75.0)
        most_w = voltage(soc, temperature_c)**2 / (4.0 * resistance(soc, temperature_c))
        # Near 0 W the root of the quadratic loses digits, on both sides alike.
        share = random.choice([random.uniform(-0.9, -0.02), random.uniform(0.02, 0.95)])
        yield (soc, temperature_c, share * most_w, random.uniform(0.0, 30e3)**2,
               random.uniform(-2e3, 9e3), random.uniform(10.0, 120.0))


def test_rates_are_those_of_floats(vehicle):
    symbolic = symbolic_rates(vehicle)
    numeric = make_rates(corrected_vehicle(vehicle, CORRECTIONS), FLOATS)
    for point in random_points(vehicle, seed=11):
        soc_rate, temperature_rate, joule_w = numeric(*point)
        _, temperature_c, _, _, heat_w, leakage_w_per_k = point
        # The temperature's rate is a sum that may nearly cancel.
        terms_k_per_s = (abs(heat_w) + abs(leakage_w_per_k * temperature_c) + joule_w) / (
            1.13 * vehicle.battery.heat_capacity_j_per_k)
        assert [float(value) for value in symbolic(*point, *FACTORS)] == [
            pytest.approx(soc_rate, rel=ROUNDING),
            pytest.approx(temperature_rate, rel=0.0, abs=ROUNDING * terms_k_per_s),
            pytest.approx(joule_w, rel=ROUNDING)]


@pytest.mark.parametrize('path', [HeatPath(), HeatPath(31.0, 9e3, 410.0)])
def test_a_step_is_that_of_floats(vehicle, path):
    vehicle = replace(vehicle, heat_path=path)
    symbolic = symbolic_step(vehicle)
    # The program keeps the state of charge within 0 ... 1 by its bounds, not by its curves.
    unbounded = replace(SATURATING_FLOATS, share=lambda value: value)
    numeric = make_heated_step(corrected_vehicle(vehicle, CORRECTIONS), unbounded)
    random = np.random.default_rng(12)
    for soc, temperature_c, power_w, *inputs in random_points(vehicle, seed=13):
        step = (soc, temperature_c, random.uniform(0.0, 7e3), random.uniform(-5.0, 40.0),
                random.uniform(0.5, 300.0), 0.4 * power_w, *inputs, random.uniform(0.0, 2e3))
        # Temperatures in degC pass through 0; rounding depends on their size in kelvin.
        for found, expected, scale in zip(symbolic(*step, *FACTORS), numeric(*step), (
                1.0, 300.0, 7e3, 300.0, 300.0, 1e5, 7e3, 1e5)):
            assert float(found) == pytest.approx(expected, rel=0.0, abs=scale * ROUNDING)


def points_of_curve(curve, seed):
    """States within and beyond the curve, and the points of its table, if it has one."""
    random = np.random.default_rng(seed)
    inside_and_beyond = zip(random.uniform(-0.5, 1.5, POINTS), random.uniform(-40.0, 90.0, POINTS))
    nodes = [(soc, temperature_c) for soc in getattr(curve, 'soc', ())
             for temperature_c in getattr(curve, 'temperature_c', ())]
    far_beyond = [(soc, temperature_c) for soc in (-3.0, 4.0) for temperature_c in (-44.0, 500.0)]
    return [*inside_and_beyond, *nodes, *far_beyond]


@pytest.mark.parametrize('name', CURVES)
def test_curve_is_that_of_floats(vehicle, name):
    curve = getattr(vehicle.battery, name)
    symbolic, numeric = symbolic_curve(curve), curve.function(FLOATS)
    points = points_of_curve(curve, seed=14)
    expected = np.array([numeric(*point) for point in points])
    # Limits go down to 0 W.
    assert np.array([float(symbolic(*point)) for point in points]) == pytest.approx(
        expected, rel=ROUNDING, abs=ROUNDING * np.abs(expected).max())


def test_derivatives_are_those_of_the_expressions(vehicle):
    """CasADi's derivatives of a step, against differences of its results."""
    step, point = symbolic_step(vehicle), np.array([0.63, -4.0, 9e3, 2.5e3])

    def outputs(variables):
        soc, temperature_c, power_w, heat_w = (variables[at] for at in range(4))
        return casadi.vertcat(
            *step(soc, temperature_c, 0.0, 0.0, 30.0, power_w, 7e6, heat_w, 40.0, 0.0, *FACTORS))

    variables = casadi.MX.sym('variables', 4)
    jacobian = np.array(casadi.Function(
        'jacobian', [variables], [casadi.jacobian(outputs(variables), variables)])(point))
    for column, shift in enumerate((1e-5, 1e-3, 1.0, 1.0)):
        to_side = shift * np.eye(4)[column]
        difference = np.array(outputs(casadi.DM(point + to_side))
                              - outputs(casadi.DM(point - to_side))).ravel() / (2.0 * shift)
        np.testing.assert_allclose(jacobian[:, column], difference, rtol=1e-4, atol=1e-9)
        assert np.abs(jacobian[:, column]).max() > 0.0


def test_a_function_along_rows_is_the_function_of_each_column():
    x, y = casadi.SX.sym('x', 2), casadi.SX.sym('y')
    function = casadi.Function('function', [x, y], [
        casadi.vertcat(casadi.fmax(x[0], x[1]) / y, casadi.sqrt(x[0]) - 3.0, 0.25), x[1]**2])
    columns, same = np.random.default_rng(3).uniform(0.5, 4.0, (2, 5)), 1.7
    rows = casadi.MX.sym('rows', 2, 5)
    found = casadi.Function('rows', [rows], along_rows(function, [rows, casadi.MX(same)], 5))(columns)
    for number, (a, b) in enumerate(columns.T):
        np.testing.assert_allclose(found[0].full()[:, number],
                                   [max(a, b) / same, np.sqrt(a) - 3.0, 0.25], rtol=1e-15)
        assert found[1].full()[0, number] == pytest.approx(b * b, rel=1e-15)
