# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program (9a)-(9j), built once for a vehicle and a number of steps.

Multiple shooting with the Runge-Kutta step of `model`. Variables: state of charge and temperature
at each instant; in each step the heater's power and the power of the friction brake. The brake is
not in the paper: where the battery may not take what the drivetrain regenerates (9i), the rest must
go somewhere, or every descent with a cold battery would make the program infeasible. It takes from
regeneration only, and what it takes no longer passes the drivetrain, whose heat shrinks with it.

The elastic program adds slacks, dearly paid for, on the target, on the state of charge and on the
discharge limit. It is solved where the program itself has no solution, to say which constraint is
at fault and what the best is that can be done.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi
import numpy as np

from bev_preheat.optimum.symbols import symbolic_curve, symbolic_rates, symbolic_step

# Scales that bring variables and constraints near 1.
SOC_SCALE = 0.01
POWER_SCALE_W = 1e3
ENERGY_SCALE_J = 1e6
# What a kelvin, a per cent and a kilowatt that are lacking cost, in scaled joules: more than
# heating could ever save, and charge before warmth.
TARGET_PRICE = 1e2
SOC_PRICE = 1e4
DISCHARGE_PRICE = 1e4

SOLVER_OPTIONS = {
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


@dataclass(frozen=True)
class Program:
    """
    A CasADi solver and where its variables and constraints lie.

    Variables, in this order: soc (N + 1), temperature (N + 1), heater (N), brake (N) and, if
    elastic, slacks of target, final soc (1 each) and discharge power (N). Constraints: 2 N defects,
    then, if limited, N of discharge and N of charge power, the target and the final soc.
    """

    solver: casadi.Function
    steps: int
    limited: bool
    elastic: bool

    def split(self, variables):
        """Return (soc, temperature [deg C], heater [W], brake [W], slacks) of a solution."""
        n = self.steps
        flat = np.asarray(variables).ravel()
        soc, temperature_c, heater, brake, slacks = np.split(
            flat, np.cumsum([n + 1, n + 1, n, n]))
        return (soc * SOC_SCALE, temperature_c, heater * POWER_SCALE_W, brake * POWER_SCALE_W,
                slacks)


@lru_cache(maxsize=16)
def build_program(vehicle, steps, limited=True, elastic=False):
    """
    Return the Program of a vehicle for a number of steps.

    `limited`: with the power limits of the battery (9i).
    """
    soc = casadi.MX.sym('soc', 1, steps + 1)
    temperature_c = casadi.MX.sym('temperature', 1, steps + 1)
    heater = casadi.MX.sym('heater', 1, steps)
    brake = casadi.MX.sym('brake', 1, steps)
    slack_target = casadi.MX.sym('slack_target')
    slack_soc = casadi.MX.sym('slack_soc')
    slack_discharge = casadi.MX.sym('slack_discharge', 1, steps)
    # Rows: duration, idle power, power variance, idle heat, leakage; then target and final soc.
    route = casadi.MX.sym('route', 5, steps)
    target_c, final_soc = casadi.MX.sym('target'), casadi.MX.sym('final_soc')
    duration_s, idle_power_w, variance_w2, idle_heat_w, leakage_w_per_k = (
        route[row, :] for row in range(5))
    heater_w, brake_w = heater * POWER_SCALE_W, brake * POWER_SCALE_W
    power_w = idle_power_w + heater_w + brake_w
    heat_w = (idle_heat_w + vehicle.hvch.efficiency * heater_w
              - vehicle.drivetrain.heat_share * brake_w)

    soc_end, temperature_end_c, _, mean_joule_w = symbolic_step(vehicle).map(steps)(
        soc[:-1] * SOC_SCALE, temperature_c[:-1], duration_s, power_w, variance_w2, heat_w,
        leakage_w_per_k)
    energy = casadi.sum2(duration_s * (power_w + mean_joule_w)) / ENERGY_SCALE_J
    constraints = [(soc_end / SOC_SCALE - soc[1:]).T, (temperature_end_c - temperature_c[1:]).T]
    if limited:
        soc_start, start_c = soc[:-1] * SOC_SCALE, temperature_c[:-1]
        joule_w = symbolic_rates(vehicle).map(steps)(
            soc_start, start_c, power_w, variance_w2, heat_w, leakage_w_per_k)[2]
        most_w = symbolic_curve(vehicle.battery.discharge_power_limit).map(steps)(
            soc_start, start_c)
        least_w = symbolic_curve(vehicle.battery.charge_power_limit).map(steps)(soc_start, start_c)
        battery_w = power_w + joule_w
        lacking = slack_discharge if elastic else 0.0
        constraints += [((most_w - battery_w) / POWER_SCALE_W + lacking).T,
                        ((battery_w - least_w) / POWER_SCALE_W).T]
    constraints += [temperature_c[-1] - target_c + (slack_target if elastic else 0.0),
                    soc[-1] - final_soc / SOC_SCALE + (slack_soc if elastic else 0.0)]
    variables = [soc.T, temperature_c.T, heater.T, brake.T]
    if elastic:
        variables += [slack_target, slack_soc, slack_discharge.T]
        energy += (TARGET_PRICE * slack_target + SOC_PRICE * slack_soc
                   + DISCHARGE_PRICE * casadi.sum2(slack_discharge))
    solver = casadi.nlpsol('optimum', 'ipopt', {
        'x': casadi.vertcat(*variables),
        'p': casadi.vertcat(casadi.vec(route), target_c, final_soc),
        'f': energy,
        'g': casadi.vertcat(*constraints)}, SOLVER_OPTIONS)
    return Program(solver, steps, limited, elastic)
