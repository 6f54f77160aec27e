# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program (9a)-(9j), built once for a vehicle and a number of steps.

Multiple shooting with the Runge-Kutta step of `model`, solved by IPOPT. Variables: state of charge and temperature
at each instant; in each step the heater's power and the power of the friction brake. With a heat path, heater and
coolant are states too, and the energy that a heater with lag draws after arrival is paid for. The brake is not in
the paper: if the battery cannot accept the drivetrain's regeneration (9i), the rest must go somewhere, or every
descent with a cold battery would make the program infeasible. The brake takes power from regeneration only. This
power no longer passes the drivetrain, whose heat decreases with it.

An elastic program adds slacks at a high price. It is solved if the program itself has no solution, to identify the
violated constraint and the best possible result. Demands on the battery are relaxed first: target, state of
charge, discharge limit. The battery's ranges are relaxed only if that is not enough: a long climb can heat the
battery beyond its highest temperature by Joule heat alone. But if power is short only because a battery that is
warm enough to deliver a climb overheats on it, the highest temperature is not a bound (`solve`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi
import numpy as np

from bev_preheat.nonlinear_program.blocks import Blocks, POWER_SCALE_W
from bev_preheat.nonlinear_program.drive_steps import add_drive_steps, SOC_SCALE

if TYPE_CHECKING:
    from typing import Any

    from bev_preheat.numerics import FloatArray
    from bev_preheat.vehicle import Vehicle

    # Options that CasADi takes by name; its own type hints omit many.
    ByName = dict[str, Any]

# Prices of a kelvin, a per cent and a kilowatt of deficit, in scaled joules: more than heating could ever save,
# and charge before warmth.
TARGET_PRICE = 1e2
SOC_PRICE = 1e4
DISCHARGE_PRICE = 1e4
# At each instant, of a per cent above the highest state of charge and of a kelvin above the highest temperature;
# higher prices keep IPOPT from converging.
RANGE_PRICE = 1e3

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


class Give(IntEnum):
    """Constraints with slacks; each level includes the slacks of the one before."""

    NOTHING = 0
    # Target; lowest state of charge, on the way and on arrival; discharge power.
    DEMANDS = 1
    # Highest state of charge, highest temperature.
    RANGES = 2


@dataclass(frozen=True)
class NonlinearProgram:
    """
    A nonlinear program, its solver, and its variables and constraints.

    Variables: `soc` and `temperature` at each instant, `heater` and, if limited, `brake` in each step;
    `heater_power` and `coolant_excess` at each instant, if the vehicle's heat path has them; the slacks:
    `deficit_k` (of the target), `deficit_soc` at each instant, `deficit_w` (of the discharge power) with
    Give.DEMANDS, `soc_above` and `k_above` with RANGES. Constraints: `soc_defect`, `temperature_defect`, and one
    for each state of a heat path; if limited, the RESERVES of each step; with DEMANDS `lowest_soc`, with
    RANGES `highest_soc` and `highest_temperature`, each with its slack; `target` and `final_soc`, the margin of
    either. Parameters: those of the DriveSteps, the target temperature [deg C], the lowest state of charge on
    arrival.
    """

    variables: Blocks
    constraints: Blocks
    solver: casadi.Function
    give: Give

    def values(self, variables: FloatArray) -> dict[str, FloatArray]:
        """Return the variables by name, in SI units; those that the program does not have are at rest."""
        found = self.variables.unpack(variables)
        in_steps, at_instants = np.zeros(len(found['heater'])), np.zeros(len(found['soc']))
        return {'brake': in_steps, 'deficit_w': in_steps, 'deficit_k': np.zeros(1),
                **dict.fromkeys(('deficit_soc', 'soc_above', 'k_above', 'coolant_excess'), at_instants),
                # Without a lag the heater follows its command.
                'heater_power': np.append(found['heater'][:1], found['heater']), **found}


# As many as one trip may need: each takes some megabytes with its solver, and on a drive the number of steps only
# falls. Positional only, without defaults: for lru_cache f(1, 2) and f(1, b=2) are different calls.
@lru_cache(maxsize=4)
def build_program(vehicle: Vehicle, steps: int, limited: bool, give: Give) -> NonlinearProgram:
    """
    Return the NonlinearProgram of a vehicle, for any corrections and a number of steps.

    `limited`: with the power limits of the battery (9i); `give`: which constraints are elastic.
    """
    variables, constraints = Blocks(), Blocks()
    deficit_w = variables.variable('deficit_w', steps, POWER_SCALE_W) if give else casadi.MX(0.0)
    drive = add_drive_steps(vehicle, steps, limited, variables, constraints, deficit_w)
    cost, soc, temperature = drive.energy, variables.row('soc'), variables.row('temperature')
    goal = casadi.MX.sym('goal', 2)
    beyond_k, beyond_soc = temperature[-1] - goal[0], soc[-1] - goal[1] / SOC_SCALE
    if give:
        deficit_soc, deficit_k = variables.variable('deficit_soc', steps + 1, SOC_SCALE), variables.variable(
            'deficit_k', 1)
        beyond_k, beyond_soc = beyond_k + deficit_k, beyond_soc + deficit_soc[-1]
        cost += (DISCHARGE_PRICE * casadi.sum2(deficit_w) + SOC_PRICE * casadi.sum2(deficit_soc)
                 + TARGET_PRICE * deficit_k)
        constraints.add('lowest_soc', soc + deficit_soc, SOC_SCALE)
    if give is Give.RANGES:
        soc_above = variables.variable('soc_above', steps + 1, SOC_SCALE)
        k_above = variables.variable('k_above', steps + 1)
        cost += RANGE_PRICE * casadi.sum2(soc_above + k_above)
        constraints.add('highest_soc', soc - soc_above, SOC_SCALE)
        constraints.add('highest_temperature', temperature - k_above)
    constraints.add('target', beyond_k)
    constraints.add('final_soc', beyond_soc, SOC_SCALE)
    solver = casadi.nlpsol('optimum', 'ipopt', {
        'x': variables.vector(), 'p': casadi.vertcat(drive.parameters, goal), 'f': cost,
        'g': constraints.vector()}, IPOPT_OPTIONS)
    return NonlinearProgram(variables, constraints, solver, give)
