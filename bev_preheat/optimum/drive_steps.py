# SPDX-License-Identifier: Apache-2.0
"""The steps of a drive in a nonlinear program: variables, parameters and defects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi

from bev_preheat.optimum.blocks import POWER_SCALE_W
from bev_preheat.optimum.heated_steps import add_heated_steps
from bev_preheat.optimum.symbols import FACTORS, symbolic_curve, symbolic_rates, symbolic_step

if TYPE_CHECKING:
    from bev_preheat.optimum.blocks import Blocks
    from bev_preheat.vehicle import Vehicle

# Scales that bring variables and constraints near 1.
SOC_SCALE = 0.01
ENERGY_SCALE_J = 1e6


@dataclass(frozen=True)
class DriveSteps:
    """
    N steps of a drive as expressions, rows.

    Parameters: `route` (5, N), its rows duration, idle power, power variance, idle heat, leakage; the
    `corrections`, FACTORS and the heater's efficiency, so that a car whose factors are being learned
    needs no new program. `soc` (scaled) and `temperature_c` (N + 1); `power_w`, terminal, and `heat_w`
    in each step; `energy`, what the cells give and what a heater that lags takes after arrival (scaled).
    """

    vehicle: Vehicle
    route: casadi.MX
    corrections: tuple[casadi.MX, ...]
    soc: casadi.MX
    temperature_c: casadi.MX
    power_w: casadi.MX
    heat_w: casadi.MX
    energy: casadi.MX

    def parameters(self, *more: casadi.MX) -> casadi.MX:
        """Return the vector of parameters, with others between route and corrections."""
        return casadi.vertcat(casadi.vec(self.route), *more, *self.corrections)

    def power_reserves_w(self) -> tuple[casadi.MX, casadi.MX]:
        """Return what is left to the limits (9i) at the start of each step [W]: discharge, charge."""
        battery, steps = self.vehicle.battery, self.route.shape[1]
        soc, start_c = self.soc[:-1] * SOC_SCALE, self.temperature_c[:-1]
        joule_w = symbolic_rates(self.vehicle).map(steps)(
            soc, start_c, self.power_w, self.route[2, :], self.heat_w, self.route[4, :],
            *self.corrections[:-1])[2]
        most_w, least_w = (symbolic_curve(curve).map(steps)(soc, start_c) for curve in (
            battery.discharge_power_limit, battery.charge_power_limit))
        battery_w = self.power_w + joule_w
        return most_w - battery_w, battery_w - least_w


def add_drive_steps(vehicle: Vehicle, steps: int, variables: Blocks,
                    constraints: Blocks) -> DriveSteps:
    """Add the steps of a drive, with their defects, to a program, and return them."""
    soc = variables.variable('soc', steps + 1, SOC_SCALE)
    temperature_c = variables.variable('temperature', steps + 1)
    heater = variables.variable('heater', steps, POWER_SCALE_W)
    brake = variables.variable('brake', steps, POWER_SCALE_W)
    route = casadi.MX.sym('route', 5, steps)
    factors = [casadi.MX.sym(name) for name in FACTORS]
    heater_efficiency = casadi.MX.sym('heater_efficiency')
    duration_s, idle_power_w, variance_w2, idle_heat_w, leakage_w_per_k = (
        route[row, :] for row in range(5))
    heater_w, brake_w = heater * POWER_SCALE_W, brake * POWER_SCALE_W
    lost_j = casadi.MX(0.0)
    if vehicle.heat_path.is_direct:
        power_w = idle_power_w + heater_w + brake_w
        heat_w = (idle_heat_w + heater_efficiency * heater_w
                  - vehicle.drivetrain.heat_share * brake_w)
        soc_end, temperature_end_c, _, mean_joule_w = symbolic_step(vehicle).map(steps)(
            soc[:-1] * SOC_SCALE, temperature_c[:-1], duration_s, power_w, variance_w2, heat_w,
            leakage_w_per_k, *factors)
    else:
        heat_w = idle_heat_w - vehicle.drivetrain.heat_share * brake_w
        soc_end, temperature_end_c, mean_joule_w, drawn_w, lost_j = add_heated_steps(
            vehicle, variables, constraints, (soc[:-1] * SOC_SCALE, temperature_c[:-1]),
            (duration_s, idle_power_w + brake_w, variance_w2, heat_w, leakage_w_per_k, heater_w,
             *factors, heater_efficiency))
        power_w = idle_power_w + drawn_w + brake_w
    energy = (casadi.sum2(duration_s * (power_w + mean_joule_w)) + lost_j) / ENERGY_SCALE_J
    constraints.add('soc_defect', soc_end / SOC_SCALE - soc[1:], SOC_SCALE)
    constraints.add('temperature_defect', temperature_end_c - temperature_c[1:])
    return DriveSteps(vehicle, route, (*factors, heater_efficiency), soc, temperature_c, power_w,
                      heat_w, energy)
