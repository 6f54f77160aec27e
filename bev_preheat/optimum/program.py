# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program (9a)-(9j), built once for a vehicle and a number of steps.

Multiple shooting with the Runge-Kutta step of `model`. Variables: state of charge and temperature
at each instant; in each step the heater's power and the power of the friction brake. Where the
vehicle has a heat path, heater and coolant are states too, and what a heater that lags takes after
arrival is paid for. The brake is
not in the paper: where the battery may not take what the drivetrain regenerates (9i), the rest
must go somewhere, or every descent with a cold battery would make the program infeasible. It takes
from regeneration only, and what it takes no longer passes the drivetrain, whose heat shrinks with
it.

An elastic program adds slacks, dearly paid for. It is solved where the program itself has no
solution, to say which constraint is at fault and what the best is that can be done. First what is
asked of the battery gives: target, state of charge, discharge limit. What the battery may hold
gives only where even that is not enough: a long climb can heat it beyond its highest temperature
by Joule heat alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi
import numpy as np

from bev_preheat.optimum.blocks import Blocks, POWER_SCALE_W
from bev_preheat.optimum.drive_steps import add_drive_steps, SOC_SCALE
from bev_preheat.optimum.layout import Layout

if TYPE_CHECKING:
    from typing import Any

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle import Vehicle

    # What CasADi takes by name; its own hints leave much of that out.
    ByName = dict[str, Any]

# What a kelvin, a per cent and a kilowatt that are lacking cost, in scaled joules: more than
# heating could ever save, and charge before warmth.
TARGET_PRICE = 1e2
SOC_PRICE = 1e4
DISCHARGE_PRICE = 1e4
# At each instant, a per cent above the highest state of charge and a kelvin above the highest
# temperature; higher prices keep IPOPT from converging.
RANGE_PRICE = 1e3

SOLVER_OPTIONS: ByName = {
    'print_time': False,
    'ipopt.print_level': 0,
    'ipopt.sb': 'yes',
    'ipopt.max_iter': 500,
    'ipopt.tol': 1e-9,
    'ipopt.constr_viol_tol': 1e-9,
    'ipopt.acceptable_iter': 0,
    # The bounds are meant: relaxed ones would let the heater exceed what the cabin leaves.
    'ipopt.bound_relax_factor': 0.0,
}


class Give(IntEnum):
    """Which constraints have slacks; each has those of the one before it too."""

    NOTHING = 0
    # Target; lowest state of charge, on the way and on arrival; discharge power.
    DEMANDS = 1
    # Highest state of charge, highest temperature.
    RANGES = 2


@dataclass(frozen=True)
class Slacks:
    """
    What constraints lack; arrays of shape (N,).

    `target_k` [K]; `soc` below the lowest at the end of each step, in the last below the one on
    arrival; `discharge_w` [W]; `soc_above` and `above_k` [K] beyond the highest at the end of each
    step.
    """

    target_k: float
    soc: FloatArray
    discharge_w: FloatArray
    soc_above: FloatArray
    above_k: FloatArray


@dataclass(frozen=True)
class Solution:
    """
    States (N + 1,) and powers [W] (N,) of a solution, and what its constraints lack.

    `heater_w` is what is commanded; `heater_power_w`, what the heater takes, and `coolant_excess_k`
    are states (N + 1,) where the vehicle's heat path has them, else None.
    """

    soc: FloatArray
    temperature_c: FloatArray
    heater_w: FloatArray
    brake_w: FloatArray
    slacks: Slacks
    heater_power_w: FloatArray | None = None
    coolant_excess_k: FloatArray | None = None


@dataclass(frozen=True)
class Program:
    """
    A CasADi solver, and where its variables and constraints lie.

    Variables: `soc` and `temperature` at each instant, `heater` and `brake` in each step;
    `heater_power` and `coolant_excess` at each instant, where the vehicle's heat path has them; then
    the slacks: `lacking_k` (of the target), `lacking_soc`, `lacking_w` (of the discharge power) with
    Give.DEMANDS, `soc_above` and `k_above` with RANGES. Constraints: `soc_defect`,
    `temperature_defect`, and one for each state of a heat path; if limited, `discharge` and
    `charge`, what is left to either limit; with DEMANDS `lowest_soc`, with RANGES `highest_soc` and
    `highest_temperature`, each with its slack; `target` and `final_soc`, by how much either is
    surpassed.
    """

    solver: casadi.Function
    variables: Layout
    constraints: Layout
    limited: bool
    give: Give

    def solution(self, variables: FloatArray) -> Solution:
        """Return the Solution that the program's variables, scaled, stand for."""
        found = self.variables.unpack(variables)
        nothing = np.zeros(len(found['heater']))
        return Solution(
            found['soc'], found['temperature'], found['heater'], found['brake'], Slacks(
                float(found['lacking_k'][0]) if 'lacking_k' in found else 0.0,
                found.get('lacking_soc', nothing), found.get('lacking_w', nothing),
                found.get('soc_above', nothing), found.get('k_above', nothing)),
            found.get('heater_power'), found.get('coolant_excess'))


# Positional only, without defaults: for lru_cache f(1, 2) and f(1, b=2) are different calls.
@lru_cache(maxsize=16)
def build_program(vehicle: Vehicle, steps: int, limited: bool, give: Give) -> Program:
    """
    Return the Program of a vehicle, whatever its corrections, for a number of steps.

    `limited`: with the power limits of the battery (9i); `give`: elastic, and how far.
    """
    variables, constraints = Blocks(), Blocks()
    drive = add_drive_steps(vehicle, steps, variables, constraints)
    soc, temperature_c, energy = drive.soc, drive.temperature_c, drive.energy
    target_c, final_soc = casadi.MX.sym('target'), casadi.MX.sym('final_soc')
    # What is lacking of each demand: nothing, unless the program is elastic.
    lacking_k = lacking_soc = lacking_w = casadi.MX(0.0)
    if give:
        lacking_k = variables.variable('lacking_k', 1)
        lacking_soc = variables.variable('lacking_soc', steps, SOC_SCALE)
        lacking_w = variables.variable('lacking_w', steps, POWER_SCALE_W)
        energy += (TARGET_PRICE * lacking_k + SOC_PRICE * casadi.sum2(lacking_soc)
                   + DISCHARGE_PRICE * casadi.sum2(lacking_w))
    if limited:
        most_w, least_w = drive.power_reserves_w()
        constraints.add('discharge', most_w / POWER_SCALE_W + lacking_w, POWER_SCALE_W)
        constraints.add('charge', least_w / POWER_SCALE_W, POWER_SCALE_W)
    if give:
        constraints.add('lowest_soc', soc[1:] + lacking_soc, SOC_SCALE)
    if give is Give.RANGES:
        soc_above = variables.variable('soc_above', steps, SOC_SCALE)
        k_above = variables.variable('k_above', steps)
        constraints.add('highest_soc', soc[1:] - soc_above, SOC_SCALE)
        constraints.add('highest_temperature', temperature_c[1:] - k_above)
        energy += RANGE_PRICE * casadi.sum2(soc_above + k_above)
    constraints.add('target', temperature_c[-1] - target_c + lacking_k)
    constraints.add(
        'final_soc', soc[-1] - final_soc / SOC_SCALE + lacking_soc[-1], SOC_SCALE)
    problem: ByName = {
        'x': variables.vector(),
        'p': drive.parameters(target_c, final_soc),
        'f': energy,
        'g': constraints.vector()}
    solver = casadi.nlpsol('optimum', 'ipopt', problem, SOLVER_OPTIONS)
    return Program(solver, variables.layout(), constraints.layout(), limited, give)


def programs_built() -> int:
    """Return how many programs this process has built so far."""
    return build_program.cache_info().misses
