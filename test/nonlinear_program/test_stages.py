# SPDX-License-Identifier: Apache-2.0
"""Programs ordered by stage: their layout, and their derivatives against CasADi's own."""

from dataclasses import replace

import casadi
import numpy as np
import pytest

from bev_preheat.nonlinear_program.along_rows import along_rows
from bev_preheat.nonlinear_program.program import build_program, Give
from bev_preheat.nonlinear_program.program_solvers import derivatives
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi')]

REFERENCE = load_vehicle('reference')
SLOW = replace(REFERENCE, heat_path=HeatPath(45.0, 15e3, 300.0))
STEPS = 3
PROGRAMS = {
    'free': (REFERENCE, False, Give.NOTHING), 'limits': (REFERENCE, True, Give.NOTHING),
    'heat path': (SLOW, True, Give.NOTHING), 'elastic': (REFERENCE, False, Give.DEMANDS),
    'ranges': (REFERENCE, True, Give.RANGES)}


def test_a_function_along_rows_is_the_function_of_each_column():
    x, y = casadi.SX.sym('x', 2), casadi.SX.sym('y')
    function = casadi.Function('function', [x, y], [
        casadi.vertcat(casadi.fmax(x[0], x[1]) / y, casadi.sqrt(x[0]) - 3.0, 0.25), x[1]**2])
    columns, same = np.random.default_rng(3).uniform(0.5, 4.0, (2, 5)), 1.7
    rows = casadi.MX.sym('rows', 2, 5)
    found = casadi.Function('rows', [rows], along_rows(function, [rows, casadi.MX(same)], 5))(columns)
    for number, column in enumerate(columns.T):
        a, b = column
        np.testing.assert_allclose(found[0].full()[:, number],
                                   [max(a, b) / same, np.sqrt(a) - 3.0, 0.25], rtol=1e-15)
        assert found[1].full()[0, number] == pytest.approx(b * b, rel=1e-15)


@pytest.fixture
def staged(request):
    vehicle, limited, give = PROGRAMS[request.param]
    return build_program(vehicle, STEPS, limited, give).staged


def random_point(staged):
    """Variables and parameters of a drive whose powers the battery can give, all different."""
    random = np.random.default_rng(17)
    variables = staged.variables.pack({
        **{block.name: block.scale * random.uniform(0.2, 0.9, block.count)
           for block in staged.variables.blocks},
        'soc': random.uniform(0.4, 0.9, STEPS + 1), 'temperature': random.uniform(-15, 30, STEPS + 1)})
    route = np.array([random.uniform(low, high, STEPS) for low, high in (
        (20.0, 60.0), (-2e4, 3e4), (0.0, 1e8), (0.0, 3e3), (20.0, 60.0))])
    return variables, np.concatenate([route.ravel(order='F'), [20.0, 0.2, 1.1, 0.9, 0.85]])


# Triangular for IPOPT, in full for FATROP.
@pytest.mark.parametrize('staged, triangular', [
    *((name, True) for name in PROGRAMS), ('heat path', False),
    *(pytest.param(name, False, marks=pytest.mark.deep) for name in PROGRAMS if name != 'heat path')],
    indirect=['staged'])
def test_derivatives_are_those_that_casadi_takes_of_the_whole_program(staged, triangular):
    variables, parameters = random_point(staged)
    x, p = casadi.MX.sym('x', len(variables)), casadi.MX.sym('p', len(parameters))
    objective, constraints = staged.problem(x, p)
    weights = np.random.default_rng(5).normal(size=constraints.shape[0])
    lagrangian = 0.7 * objective + casadi.dot(weights, constraints)
    expected = [matrix.full() for matrix in casadi.Function('expected', [x, p], [
        casadi.gradient(objective, x), casadi.jacobian(constraints, x), casadi.gradient(lagrangian, x),
        casadi.hessian(lagrangian, x)[0]])(variables, parameters)]
    found = derivatives(staged, triangular)
    slope = found['nlp_grad_f'].call([variables, parameters])[-1]
    jacobian = found['nlp_jac_g'].call([variables, parameters])[-1]
    *gradient, hessian = found['nlp_hess_l'].call([variables, parameters, 0.7, weights])
    np.testing.assert_allclose(slope.full(), expected[0], atol=1e-12)
    np.testing.assert_allclose(jacobian.full(), expected[1], atol=1e-12)
    # FATROP uses this gradient as well, IPOPT only the triangle.
    for values in gradient:
        np.testing.assert_allclose(values.full(), expected[2], atol=1e-12)
    np.testing.assert_allclose(
        hessian.full(), np.triu(expected[3]) if triangular else expected[3], atol=1e-12)
    assert len(gradient) == (not triangular)
    # CasADi stores matrices without structural zeros in full; FATROP reads gradients like that.
    assert slope.is_dense() and all(values.is_dense() for values in gradient)
