# SPDX-License-Identifier: Apache-2.0
"""
The solvers of a StagedProgram: FATROP, which exploits the stages, and IPOPT.

Both get the derivatives of `stages` in the form in which CasADi would generate its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi

if TYPE_CHECKING:
    from typing import Any

    from bev_preheat.nonlinear_program.stages import StagedProgram

    # Options that CasADi takes by name; its own type hints omit many.
    ByName = dict[str, Any]

FATROP = 'FATROP'
IPOPT = 'IPOPT'
TOLERANCE = 1e-9

IPOPT_OPTIONS: ByName = {
    'print_time': False,
    'ipopt.print_level': 0,
    'ipopt.sb': 'yes',
    'ipopt.max_iter': 500,
    # With a monotone barrier IPOPT may stall at a barrier value whose minimum lies at a corner of a limit's table.
    'ipopt.mu_strategy': 'adaptive',
    'ipopt.tol': TOLERANCE,
    'ipopt.constr_viol_tol': TOLERANCE,
    'ipopt.acceptable_iter': 0,
    # Bounds are strict: relaxed ones would let the heater exceed the power that the cabin leaves.
    'ipopt.bound_relax_factor': 0.0,
}
FATROP_OPTIONS: ByName = {
    'print_time': False,
    'structure_detection': 'auto',
    'fatrop.print_level': 0,
    'fatrop.tol': TOLERANCE,
    # A successful run takes about 50 at most.
    'fatrop.max_iter': 100,
}


def has_fatrop() -> bool:
    """Whether this CasADi comes with FATROP."""
    return bool(casadi.has_nlpsol('fatrop'))


def make_solver(name: str, program: StagedProgram) -> casadi.Function:
    """Return the solver FATROP or IPOPT for a program."""
    if name == FATROP:
        return casadi.nlpsol('optimum', 'fatrop', program.problem, {
            **FATROP_OPTIONS, 'equality': program.is_equality.tolist(),
            'cache': derivatives(program, triangular=False)})
    return casadi.nlpsol('optimum', 'ipopt', program.problem, {
        **IPOPT_OPTIONS, 'cache': derivatives(program, triangular=True)})


def derivatives(program: StagedProgram, triangular: bool) -> dict[str, casadi.Function]:
    """Return the derivatives under the names by which CasADi looks for them before it generates any."""
    multipliers, slope, hessian = program.hessian(triangular)
    objective = program.gradient()
    functions = (
        program.function('nlp_jac_g', [], program.jacobian(), [], ['g', 'jac_g_x']),
        program.function('nlp_grad_f', [], objective, [], ['f', 'grad_f_x']) if triangular else
        program.function('nlp_grad_f', [], objective[1:], [], ['grad_f_x']),
        program.function('nlp_hess_l', multipliers, [hessian], ['lam_f', 'lam_g'],
                         ['triu_hess_gamma_x_x']) if triangular else
        program.function('nlp_hess_l', multipliers, [slope, hessian], ['lam_f', 'lam_g'],
                         ['grad_gamma_x', 'hess_gamma_x_x']))
    return {function.name(): function for function in functions}
