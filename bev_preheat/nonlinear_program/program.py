# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program (9a)-(9j), built once for a vehicle and a number of steps.

Multiple shooting with the Runge-Kutta step of `model`. Variables: state of charge and temperature at each instant;
in each step the heater's power and the power of the friction brake. With a heat path, heater and coolant are
states too, and the energy that a heater with lag draws after arrival is paid for. The brake is not in the paper:
if the battery cannot accept the drivetrain's regeneration (9i), the rest must go somewhere, or every descent with
a cold battery would make the program infeasible. The brake takes power from regeneration only. This power no
longer passes the drivetrain, whose heat decreases with it.

An elastic program adds slacks at a high price. It is solved if the program itself has no solution, to identify the
violated constraint and the best possible result. Demands on the battery are relaxed first: target, state of
charge, discharge limit. The battery's ranges are relaxed only if that is not enough: a long climb can heat the
battery beyond its highest temperature by Joule heat alone. But if power is short only because a battery that is
warm enough to deliver a climb overheats on it, the highest temperature is not a bound (`solve`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi
import numpy as np

from bev_preheat.nonlinear_program.blocks import POWER_SCALE_W
from bev_preheat.nonlinear_program.drive_step import (
    CORRECTIONS,
    drive_controls,
    drive_states,
    drive_step,
    lost_after_arrival,
    RESERVES,
    ROUTE_INPUTS,
    SOC_SCALE,
)
from bev_preheat.nonlinear_program.layout import Layout, ProgramQuantity
from bev_preheat.nonlinear_program.program_solvers import make_solver
from bev_preheat.nonlinear_program.stages import Stage, StagedProgram

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle import Vehicle

# Prices of a kelvin, a per cent and a kilowatt of deficit, in scaled joules: more than heating could ever save,
# and charge before warmth.
TARGET_PRICE = 1e2
SOC_PRICE = 1e4
DISCHARGE_PRICE = 1e4
# At each instant, of a per cent above the highest state of charge and of a kelvin above the highest temperature;
# higher prices keep IPOPT from converging.
RANGE_PRICE = 1e3

# At each instant, in each step, and on arrival, in an elastic program.
DEFICIT_SOC, ABOVE = ProgramQuantity('deficit_soc', SOC_SCALE), (
    ProgramQuantity('soc_above', SOC_SCALE), ProgramQuantity('k_above'))
DEFICIT_W, DEFICIT_K = ProgramQuantity('deficit_w', POWER_SCALE_W), ProgramQuantity('deficit_k')
LOWEST_SOC = ProgramQuantity('lowest_soc', SOC_SCALE)
HIGHEST = ProgramQuantity('highest_soc', SOC_SCALE), ProgramQuantity('highest_temperature')
ON_ARRIVAL = ProgramQuantity('target'), ProgramQuantity('final_soc', SOC_SCALE)


class Give(IntEnum):
    """Constraints with slacks; each level includes the slacks of the one before."""

    NOTHING = 0
    # Target; lowest state of charge, on the way and on arrival; discharge power.
    DEMANDS = 1
    # Highest state of charge, highest temperature.
    RANGES = 2


@dataclass(frozen=True)
class Slacks:
    """
    Deficits of the constraints; arrays of shape (N,).

    `target_k` [K]; `soc` below the lowest at the end of each step, and in the last step below the reserve;
    `discharge_w` [W]; `soc_above` beyond the highest at the end of each step.
    """

    target_k: float
    soc: FloatArray
    discharge_w: FloatArray
    soc_above: FloatArray


@dataclass(frozen=True)
class ProgramSolution:
    """
    States (N + 1,) and powers [W] (N,) of a solution, and the deficits of its constraints.

    `heater_w` is the command; `heater_power_w`, the heater's power, and `coolant_excess_k` are states (N + 1,) if
    the vehicle's heat path has them, else None.
    """

    soc: FloatArray
    temperature_c: FloatArray
    heater_w: FloatArray
    brake_w: FloatArray
    slacks: Slacks
    heater_power_w: FloatArray | None = None
    coolant_excess_k: FloatArray | None = None


@dataclass(frozen=True)
class NonlinearProgram:
    """
    A nonlinear program, its solvers, and the layout of its variables and constraints.

    Variables: `soc` and `temperature` at each instant, `heater` and, if limited, `brake` in each step;
    `heater_power` and `coolant_excess` at each instant, if the vehicle's heat path has them; the slacks:
    `deficit_k` (of the target), `deficit_soc` at each instant, `deficit_w` (of the discharge power) with
    Give.DEMANDS, `soc_above` and `k_above` with RANGES. Constraints: `soc_defect`, `temperature_defect`, and one
    for each state of a heat path; if limited, `discharge` and `charge`, the margin to either limit at the start of
    a step, and `discharge_at_end` and `charge_at_end`, the margin at its end; with DEMANDS `lowest_soc`, with
    RANGES `highest_soc` and `highest_temperature`, each with its slack; `target` and `final_soc`, the margin of
    either.
    """

    staged: StagedProgram
    limited: bool
    give: Give
    _solvers: dict[str, casadi.Function] = field(default_factory=dict)

    @property
    def variables(self) -> Layout:
        """Layout of the variables."""
        return self.staged.variables

    @property
    def constraints(self) -> Layout:
        """Layout of the constraints."""
        return self.staged.constraints

    def solver(self, name: str) -> casadi.Function:
        """Return a solver of `program_solvers`, built on its first use."""
        if name not in self._solvers:
            self._solvers[name] = make_solver(name, self.staged)
        return self._solvers[name]

    def solution(self, variables: FloatArray) -> ProgramSolution:
        """Return the ProgramSolution of the program's variables (scaled)."""
        found = self.variables.unpack(variables)
        nothing = np.zeros(len(found['heater']))

        def later(name: str) -> FloatArray:
            # Demands at the first instant have no deficit.
            return found[name][1:] if name in found else nothing

        return ProgramSolution(
            found['soc'], found['temperature'], found['heater'], found.get('brake', nothing), Slacks(
                float(found['deficit_k'][0]) if 'deficit_k' in found else 0.0,
                later('deficit_soc'), found.get('deficit_w', nothing), later('soc_above')),
            found.get('heater_power'), found.get('coolant_excess'))


# As many as one trip may need: each takes some megabytes with its solvers, and on a drive the number of steps only
# falls. The stages, which are the same for any number of steps, are cached separately. Positional only, without
# defaults: for lru_cache f(1, 2) and f(1, b=2) are different calls.
@lru_cache(maxsize=4)
def build_program(vehicle: Vehicle, steps: int, limited: bool, give: Give) -> NonlinearProgram:
    """
    Return the NonlinearProgram of a vehicle, for any corrections and a number of steps.

    `limited`: with the power limits of the battery (9i); `give`: which constraints are elastic.
    """
    return NonlinearProgram(StagedProgram(*_stages(vehicle, limited, give), steps), limited, give)


def programs_built() -> int:
    """Return the number of programs that this process has built so far."""
    return build_program.cache_info().misses


@lru_cache(maxsize=12)
def _stages(vehicle: Vehicle, limited: bool, give: Give) -> tuple[Stage, Stage]:
    """Return a step of the program, and the stage on arrival."""
    states, controls = drive_states(vehicle), drive_controls(limited)
    slacks = (*((DEFICIT_SOC,) if give else ()), *(ABOVE if give is Give.RANGES else ()))
    bounds = (*((LOWEST_SOC,) if give else ()), *(HIGHEST if give is Give.RANGES else ()))
    in_step = (*states, *slacks, *controls, *((DEFICIT_W,) if give else ()))
    on_arrival = (*states, *slacks, *((DEFICIT_K,) if give else ()))
    # Target temperature [deg C] and lowest state of charge on arrival, then the corrections.
    common = casadi.SX.sym('common', 2 + CORRECTIONS)

    def symbols(variables: tuple[ProgramQuantity, ...]) -> dict[str, casadi.SX]:
        return {variable.name: casadi.SX.sym(variable.name) for variable in variables}

    def column(found: dict[str, casadi.SX], variables: tuple[ProgramQuantity, ...]) -> casadi.SX:
        return casadi.vertcat(*(found[variable.name] for variable in variables))

    def at_instant(found: dict[str, casadi.SX]) -> tuple[casadi.SX, list[casadi.SX]]:
        """Return the price of the slacks of an instant, and its bounds."""
        price, values = casadi.SX(0.0), []
        if give:
            price += SOC_PRICE * found['deficit_soc']
            values.append(found['soc'] + found['deficit_soc'])
        if give is Give.RANGES:
            price += RANGE_PRICE * (found['soc_above'] + found['k_above'])
            values += [found['soc'] - found['soc_above'], found['temperature'] - found['k_above']]
        return price, values

    found, route = symbols(in_step), casadi.SX.sym('route', ROUTE_INPUTS)
    end = casadi.SX.sym('end', len(states))
    ends, energy, reserves = drive_step(vehicle, limited, end)(
        column(found, (*states, *controls)), route, common[2:], end)
    price, values = at_instant(found)
    if give:
        energy += DISCHARGE_PRICE * found['deficit_w']
    if give and limited:
        reserves = casadi.vertcat(*(
            value + found['deficit_w'] if reserve.name.startswith('discharge') else value
            for reserve, value in zip(RESERVES, casadi.vertsplit(reserves))))
    step = Stage(in_step, (*(RESERVES if limited else ()), *bounds), column(found, in_step), route, common,
                 end, ends, energy + price, casadi.vertcat(reserves, *values))
    found = symbols(on_arrival)
    price, values = at_instant(found)
    beyond_k = found['temperature'] - common[0]
    beyond_soc = found['soc'] - common[1] / SOC_SCALE
    if give:
        price += TARGET_PRICE * found['deficit_k']
        beyond_k, beyond_soc = beyond_k + found['deficit_k'], beyond_soc + found['deficit_soc']
    arrival = Stage(
        on_arrival, (*bounds, *ON_ARRIVAL), column(found, on_arrival), casadi.SX(0, 1), common,
        casadi.SX(0, 1), casadi.SX(0, 1), lost_after_arrival(vehicle, column(found, states)) + price,
        casadi.vertcat(*values, beyond_k, beyond_soc))
    return step, arrival
