# SPDX-License-Identifier: Apache-2.0
"""
A nonlinear program whose variables and constraints are ordered by stage, and its derivatives.

    minimise  sum of cost(w_k, p_k, q) + last cost(w_N, q)
    subject to  x_{k+1} - ends(w_k, p_k, q) = 0,  paths(w_k, x_{k+1}, p_k, q) and last paths(w_N, q) in bounds

w_k are the variables of stage k, the states x_k first; p_k the stage's inputs, q the common inputs. Variables
have the order w_0, w_1, ..., w_N; of the constraints each stage's defects come first, then its paths. All stages
but the last are alike, so derivatives are generated for one stage, evaluated along all of them, and placed in the
whole. CasADi's own derivatives of the whole program take ten times as long to evaluate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi
import numpy as np

from bev_preheat.nonlinear_program.along_rows import along_rows
from bev_preheat.nonlinear_program.layout import Layout, ProgramQuantity, VariableBlock

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bev_preheat.numerics.arrays import IntArray


@dataclass(frozen=True, eq=False)
class Stage:
    """
    One stage as CasADi expressions of `vector` (its variables), `inputs` (p_k) and `common` (q).

    `ends` (no rows in the last stage) are the states at the start of the next stage; in `path_values` the symbols
    `end` stand for them: both are differentiated separately and combined by the chain rule, which takes a
    quarter fewer operations. All are columns.
    """

    variables: tuple[ProgramQuantity, ...]
    paths: tuple[ProgramQuantity, ...]
    vector: casadi.SX
    inputs: casadi.SX
    common: casadi.SX
    end: casadi.SX
    ends: casadi.SX
    cost: casadi.SX
    path_values: casadi.SX

    @cached_property
    def price(self) -> casadi.Function:
        """The cost."""
        return self._function('price', [], [self.cost])

    @cached_property
    def outcome(self) -> casadi.Function:
        """Ends and paths, one column."""
        return self._function('outcome', [], [self._outcome])

    @cached_property
    def gradient(self) -> casadi.Function:
        """The cost, and its gradient."""
        return self._function('gradient', [], [
            self.cost, casadi.densify(casadi.gradient(self.cost, self.vector))])

    @cached_property
    def slopes(self) -> casadi.Function:
        """Ends and paths, and the nonzero elements of their Jacobian."""
        return self._function('slopes', [], [self._outcome, _elements(self._jacobian)])

    @cached_property
    def curvature(self) -> casadi.Function:
        """
        Gradient of the Lagrangian, and the nonzero elements of its Hessian.

        More inputs: the multipliers of the cost, and of ends and paths.
        """
        multipliers, gradient, hessian = self._lagrangian
        return self._function('curvature', multipliers, [
            casadi.densify(gradient), _elements(hessian)])

    @property
    def jacobian_places(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the Jacobian's nonzero elements."""
        return _places(self._jacobian)

    @property
    def hessian_places(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the Hessian's nonzero elements."""
        return _places(self._lagrangian[2])

    @cached_property
    def _outcome(self) -> casadi.SX:
        return casadi.vertcat(self.ends, self._at_ends(self.path_values))

    @cached_property
    def _jacobian(self) -> casadi.SX:
        paths = self._at_ends(casadi.jacobian(self.path_values, self._of_paths))
        return casadi.vertcat(self._ends_jacobian, paths @ self._of_paths_jacobian)

    @cached_property
    def _lagrangian(self) -> tuple[list[casadi.SX], casadi.SX, casadi.SX]:
        price, multipliers = casadi.SX.sym('price'), casadi.SX.sym('multipliers', self._outcome.shape[0])
        states = self.ends.shape[0]
        of_ends, of_paths = multipliers[:states], multipliers[states:]
        paths_hessian, paths_gradient = map(self._at_ends, casadi.hessian(
            casadi.dot(of_paths, self.path_values), self._of_paths))
        # The gradient of the paths with respect to an end state acts as another multiplier of that state.
        gain = casadi.SX.sym('gain', states)
        hessian, gradient = (casadi.substitute(value, gain, paths_gradient[:states]) for value in casadi.hessian(
            price * self.cost + casadi.dot(of_ends + gain, self.ends), self.vector))
        along = self._of_paths_jacobian
        return ([price, multipliers], gradient + paths_gradient[states:],
                hessian + along.T @ paths_hessian @ along)

    @property
    def _of_paths(self) -> casadi.SX:
        """The variables of the path expressions, beside the inputs."""
        return casadi.vertcat(self.end, self.vector)

    @cached_property
    def _ends_jacobian(self) -> casadi.SX:
        return casadi.jacobian(self.ends, self.vector)

    @property
    def _of_paths_jacobian(self) -> casadi.SX:
        return casadi.vertcat(self._ends_jacobian, casadi.SX.eye(self.vector.shape[0]))

    def _at_ends(self, expression: casadi.SX) -> casadi.SX:
        return casadi.substitute(expression, self.end, self.ends)

    def _function(self, name: str, more: Sequence[casadi.SX],
                  outputs: Iterable[casadi.SX]) -> casadi.Function:
        return casadi.Function(
            name, [self.vector, self.inputs, self.common, *more],
            casadi.cse([casadi.densify(output) for output in outputs]))


def _elements(matrix: casadi.SX) -> casadi.SX:
    """Return the nonzero elements, column by column."""
    elements: casadi.SX = matrix.nz[:]
    return elements


def _places(matrix: casadi.SX) -> tuple[IntArray, IntArray]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, int), np.array(columns, int)


class StagedProgram:
    """
    A program of `steps` equal stages and a last one.

    `variables` and `constraints` are the layouts of both; `is_equality` marks the constraints that are
    defects. Parameters: the inputs of each stage, then the common inputs.
    """

    def __init__(self, stage: Stage, last: Stage, steps: int) -> None:
        """Assemble the stages; derivatives come with `functions`."""
        self._stage, self._last, self._steps = stage, last, steps
        states = self._states = stage.ends.shape[0]
        self.variables = _layout(stage.variables, last.variables, steps)
        defects = [ProgramQuantity(f'{state.name}_defect', state.scale)
                   for state in stage.variables[:states]]
        self.constraints = _layout((*defects, *stage.paths), last.paths, steps)
        self.is_equality = np.zeros(self.constraints.size, bool)
        for defect in defects:
            self.is_equality[self.constraints.places[defect.name]] = True
        self._x = casadi.MX.sym('x', self.variables.size)
        self._p = casadi.MX.sym('p', steps * stage.inputs.shape[0] + stage.common.shape[0])

    @cached_property
    def problem(self) -> casadi.Function:
        """Objective and constraints, as `casadi.nlpsol` takes them."""
        (price,), (outcome,) = self._each(self._stage.price), self._each(self._stage.outcome)
        (last_price,), (last_outcome,) = (
            self._at_last(self._last.price), self._at_last(self._last.outcome))
        return self.function('problem', [], [
            casadi.sum2(price) + last_price, self._constraints(outcome, last_outcome)], [], ['f', 'g'])

    def gradient(self) -> tuple[casadi.MX, casadi.MX]:
        """Return the objective and its gradient."""
        cost, gradient = self._each(self._stage.gradient)
        last_cost, last_gradient = self._at_last(self._last.gradient)
        return (casadi.sum2(cost) + last_cost,
                casadi.densify(casadi.vertcat(casadi.vec(gradient), last_gradient)))

    def jacobian(self) -> tuple[casadi.MX, casadi.MX]:
        """Return the constraints and their Jacobian."""
        outcome, elements = self._each(self._stage.slopes)
        last_outcome, last_elements = self._at_last(self._last.slopes)
        width, height = len(self._stage.variables), self._stage.path_values.shape[0] + self._states
        rows, columns = _repeated(self._stage.jacobian_places, self._steps, height, width)
        is_end = rows % height < self._states
        last_rows, last_columns = self._last.jacobian_places
        # Jacobian of a defect: the next stage's state, less the state at the end of this stage.
        next_rows, next_columns = self._defects(), self._next_states()
        matrix = _matrix(
            (self.constraints.size, self.variables.size),
            casadi.vertcat(casadi.vec(elements) * casadi.DM(np.where(is_end, -1.0, 1.0)),
                           last_elements, casadi.DM.ones(len(next_rows))),
            np.concatenate([rows, self._steps * height + last_rows, next_rows]),
            np.concatenate([columns, self._steps * width + last_columns, next_columns]))
        return self._constraints(outcome, last_outcome), matrix

    def hessian(self, triangular: bool) -> tuple[list[casadi.MX], casadi.MX, casadi.MX]:
        """
        Return multipliers, and gradient and Hessian of the Lagrangian.

        The multipliers, of objective and constraints, are inputs that follow variables and parameters.
        `triangular`: only the upper triangle of the Hessian is needed.
        """
        price, multipliers = casadi.MX.sym('price'), casadi.MX.sym('g', self.constraints.size)
        width, height = len(self._stage.variables), self._stage.path_values.shape[0] + self._states
        inner = multipliers[:self._steps * height].reshape((height, self._steps))
        signs = casadi.DM(np.where(np.arange(height) < self._states, -1.0, 1.0))
        gradient, elements = self._each(
            self._stage.curvature, price, inner * casadi.repmat(signs, 1, self._steps))
        last_gradient, last_elements = self._at_last(
            self._last.curvature, price, multipliers[self._steps * height:])
        rows, columns = _repeated(self._stage.hessian_places, self._steps, width, width)
        last_rows, last_columns = self._last.hessian_places
        rows = np.concatenate([rows, self._steps * width + last_rows])
        columns = np.concatenate([columns, self._steps * width + last_columns])
        kept = np.flatnonzero(rows <= columns) if triangular else np.arange(len(rows))
        matrix = _matrix(
            (self.variables.size, self.variables.size),
            casadi.vertcat(casadi.vec(elements), last_elements), rows[kept], columns[kept], kept)
        places = self._next_states()
        from_defects = casadi.MX(
            casadi.Sparsity.triplet(self.variables.size, 1, places.tolist(), [0] * len(places)),
            multipliers[self._defects().tolist()])
        gradient = casadi.vertcat(casadi.vec(gradient), last_gradient) + from_defects
        return [price, multipliers], casadi.densify(gradient), matrix

    def function(self, name: str, more_inputs: Sequence[casadi.MX], outputs: Sequence[casadi.MX],
                 input_names: Sequence[str], output_names: Sequence[str]) -> casadi.Function:
        """Return a CasADi Function of variables, parameters and more inputs."""
        return casadi.Function(name, [self._x, self._p, *more_inputs], list(outputs),
                               ['x', 'p', *input_names], list(output_names))

    def _each(self, function: casadi.Function, *more: casadi.MX) -> list[casadi.MX]:
        """Return a function's outputs for each stage but the last, one column each."""
        width, inputs = len(self._stage.variables), self._stage.inputs.shape[0]
        return along_rows(function, [
            self._x[:self._steps * width].reshape((width, self._steps)),
            self._p[:self._steps * inputs].reshape((inputs, self._steps)), self._common(), *more],
            self._steps)

    def _at_last(self, function: casadi.Function, *more: casadi.MX) -> list[casadi.MX]:
        outputs: list[casadi.MX] = function.call([
            self._x[self._steps * len(self._stage.variables):], casadi.MX(0, 1), self._common(),
            *more])
        return outputs

    def _common(self) -> casadi.MX:
        return self._p[self._steps * self._stage.inputs.shape[0]:]

    def _constraints(self, outcome: casadi.MX, last_outcome: casadi.MX) -> casadi.MX:
        following = self._x[self._next_states().tolist()].reshape((self._states, self._steps))
        return casadi.vertcat(casadi.vec(casadi.vertcat(
            following - outcome[:self._states, :], outcome[self._states:, :])), last_outcome)

    def _next_states(self) -> IntArray:
        """Return the positions of each stage's next states among the variables."""
        return np.add.outer(np.arange(1, self._steps + 1) * len(self._stage.variables),
                            np.arange(self._states)).ravel()

    def _defects(self) -> IntArray:
        """Return the positions of the defects among the constraints, in the order of `_next_states`."""
        return np.flatnonzero(self.is_equality)


def _layout(each: Sequence[ProgramQuantity], last: Sequence[ProgramQuantity], steps: int) -> Layout:
    """Return the Layout of the quantities of each stage but the last, and of the last one."""
    names, last_names = ({quantity.name for quantity in quantities} for quantities in (each, last))
    return Layout(tuple(
        VariableBlock(quantity.name, len(stages), quantity.scale, stages)
        for quantity in (*each, *(more for more in last if more.name not in names))
        for stages in [(*(range(steps) if quantity.name in names else ()),
                        *((steps,) if quantity.name in last_names else ()))]))


def _repeated(places: tuple[IntArray, IntArray], steps: int, height: int,
              width: int) -> tuple[IntArray, IntArray]:
    """Return rows and columns of blocks along the diagonal."""
    rows, columns = places
    return (np.add.outer(height * np.arange(steps), rows).ravel(),
            np.add.outer(width * np.arange(steps), columns).ravel())


def _matrix(shape: tuple[int, int], elements: casadi.MX, rows: IntArray, columns: IntArray,
            kept: IntArray | None = None) -> casadi.MX:
    """Return the sparse matrix of elements; `kept` are the indices of those at rows and columns."""
    order = np.lexsort((rows, columns))
    sparsity = casadi.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return casadi.MX(sparsity, elements[(order if kept is None else kept[order]).tolist()])
