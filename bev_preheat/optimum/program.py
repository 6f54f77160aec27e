# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program (9a)-(9j), built once for a vehicle and a number of steps.

Multiple shooting with the Runge-Kutta step of `model`. Variables: state of charge and temperature
at each instant; in each step the heater's power and the power of the friction brake. The brake is
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

from bev_preheat.optimum.symbols import FACTORS, symbolic_curve, symbolic_rates, symbolic_step

if TYPE_CHECKING:
    from typing import Any

    from bev_preheat.arrays import FloatArray
    from bev_preheat.vehicle import Vehicle

    # What CasADi takes by name; its own hints leave much of that out.
    ByName = dict[str, Any]

# Scales that bring variables and constraints near 1.
SOC_SCALE = 0.01
POWER_SCALE_W = 1e3
ENERGY_SCALE_J = 1e6
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
class Program:
    """
    A CasADi solver and where its variables and constraints lie.

    Variables, in this order: soc (N + 1), temperature (N + 1), heater (N), brake (N), then slacks:
    target (1), soc and discharge (N each) with DEMANDS, soc above and temperature above (N each)
    with RANGES. Constraints: 2 N defects; if limited, N of discharge and N of charge power; with
    DEMANDS, N of the lowest soc; with RANGES, N each of the highest soc and temperature; the
    target and the final soc.
    """

    solver: casadi.Function
    steps: int
    limited: bool
    give: Give

    @property
    def slack_count(self) -> int:
        """Number of slacks."""
        return {Give.NOTHING: 0, Give.DEMANDS: 1 + 2 * self.steps,
                Give.RANGES: 1 + 4 * self.steps}[self.give]

    def split(
            self,
            variables: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, Slacks]:
        """Return (soc, temperature [deg C], heater [W], brake [W], Slacks) of a solution."""
        n = self.steps
        flat = np.zeros(4 * n + 2 + 1 + 4 * n)
        solution = np.asarray(variables).ravel()
        flat[:len(solution)] = solution
        soc, temperature_c, heater, brake, target_k, *slacks = np.split(
            flat, np.cumsum([n + 1, n + 1, n, n, 1, n, n, n]))
        return (soc * SOC_SCALE, temperature_c, heater * POWER_SCALE_W, brake * POWER_SCALE_W,
                Slacks(float(target_k[0]), slacks[0] * SOC_SCALE, slacks[1] * POWER_SCALE_W,
                       slacks[2] * SOC_SCALE, slacks[3]))


# Positional only, without defaults: for lru_cache f(1, 2) and f(1, b=2) are different calls.
@lru_cache(maxsize=16)
def build_program(vehicle: Vehicle, steps: int, limited: bool, give: Give) -> Program:
    """
    Return the Program of a vehicle, whatever its corrections, for a number of steps.

    `limited`: with the power limits of the battery (9i); `give`: elastic, and how far.
    """
    soc = casadi.MX.sym('soc', 1, steps + 1)
    temperature_c = casadi.MX.sym('temperature', 1, steps + 1)
    heater = casadi.MX.sym('heater', 1, steps)
    brake = casadi.MX.sym('brake', 1, steps)
    slack_target = casadi.MX.sym('slack_target')
    slack_soc, slack_discharge, slack_soc_above, slack_above = (
        casadi.MX.sym(name, 1, steps)
        for name in ('slack_soc', 'slack_discharge', 'slack_soc_above', 'slack_above'))
    # Rows: duration, idle power, power variance, idle heat, leakage; then target and final soc,
    # and the corrections, so that a car whose factors are being learned needs no new program.
    route = casadi.MX.sym('route', 5, steps)
    target_c, final_soc = casadi.MX.sym('target'), casadi.MX.sym('final_soc')
    factors = [casadi.MX.sym(name) for name in FACTORS]
    heater_efficiency = casadi.MX.sym('heater_efficiency')
    duration_s, idle_power_w, variance_w2, idle_heat_w, leakage_w_per_k = (
        route[row, :] for row in range(5))
    heater_w, brake_w = heater * POWER_SCALE_W, brake * POWER_SCALE_W
    power_w = idle_power_w + heater_w + brake_w
    heat_w = (idle_heat_w + heater_efficiency * heater_w
              - vehicle.drivetrain.heat_share * brake_w)

    soc_end, temperature_end_c, _, mean_joule_w = symbolic_step(vehicle).map(steps)(
        soc[:-1] * SOC_SCALE, temperature_c[:-1], duration_s, power_w, variance_w2, heat_w,
        leakage_w_per_k, *factors)
    energy = casadi.sum2(duration_s * (power_w + mean_joule_w)) / ENERGY_SCALE_J
    constraints = [(soc_end / SOC_SCALE - soc[1:]).T, (temperature_end_c - temperature_c[1:]).T]
    if limited:
        soc_start, start_c = soc[:-1] * SOC_SCALE, temperature_c[:-1]
        joule_w = symbolic_rates(vehicle).map(steps)(
            soc_start, start_c, power_w, variance_w2, heat_w, leakage_w_per_k, *factors)[2]
        most_w = symbolic_curve(vehicle.battery.discharge_power_limit).map(steps)(
            soc_start, start_c)
        least_w = symbolic_curve(vehicle.battery.charge_power_limit).map(steps)(soc_start, start_c)
        battery_w = power_w + joule_w
        lacking = slack_discharge if give else 0.0
        constraints += [((most_w - battery_w) / POWER_SCALE_W + lacking).T,
                        ((battery_w - least_w) / POWER_SCALE_W).T]
    variables = [soc.T, temperature_c.T, heater.T, brake.T]
    lacking_k: casadi.MX | float = 0.0
    lacking_soc: casadi.MX | float = 0.0
    if give:
        variables += [slack_target, slack_soc.T, slack_discharge.T]
        constraints.append((soc[1:] + slack_soc).T)
        lacking_k, lacking_soc = slack_target, slack_soc[-1]
        energy += (TARGET_PRICE * slack_target + SOC_PRICE * casadi.sum2(slack_soc)
                   + DISCHARGE_PRICE * casadi.sum2(slack_discharge))
    if give is Give.RANGES:
        variables += [slack_soc_above.T, slack_above.T]
        constraints += [(soc[1:] - slack_soc_above).T, (temperature_c[1:] - slack_above).T]
        energy += RANGE_PRICE * casadi.sum2(slack_soc_above + slack_above)
    constraints += [temperature_c[-1] - target_c + lacking_k,
                    soc[-1] - final_soc / SOC_SCALE + lacking_soc]
    problem: ByName = {
        'x': casadi.vertcat(*variables),
        'p': casadi.vertcat(casadi.vec(route), target_c, final_soc, *factors, heater_efficiency),
        'f': energy,
        'g': casadi.vertcat(*constraints)}
    solver = casadi.nlpsol('optimum', 'ipopt', problem, SOLVER_OPTIONS)
    return Program(solver, steps, limited, give)


def programs_built() -> int:
    """Return how many programs this process has built so far."""
    return build_program.cache_info().misses
