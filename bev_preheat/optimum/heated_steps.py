# SPDX-License-Identifier: Apache-2.0
"""The steps of a program for a vehicle with a heat path: heater and coolant are variables, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi

from bev_preheat.optimum.blocks import POWER_SCALE_W
from bev_preheat.optimum.symbols import symbolic_heated_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.optimum.blocks import Blocks
    from bev_preheat.vehicle import Vehicle


def add_heated_steps(
        vehicle: Vehicle, variables: Blocks, constraints: Blocks,
        start: tuple[casadi.MX, casadi.MX],
        inputs: Sequence[casadi.MX]) -> tuple[casadi.MX, ...]:
    """
    Add the states of a heat path to a program, with their defects, and return what its steps do.

    `start` are state of charge and temperature [deg C] at the start of each step, `inputs` the other
    arguments of `symbolic_heated_step`, in its order. Returns state of charge and temperature at the
    ends, mean Joule heat [W], what the heater takes [W], and what it takes after arrival [J].
    """
    path, steps = vehicle.heat_path, start[0].shape[1]
    heater_power = excess_k = None
    # What does not lag is no state: it would be a variable without a choice.
    if path.heater_lag_s > 0.0:
        heater_power = variables.variable('heater_power', steps + 1, POWER_SCALE_W)
    if path.has_coolant:
        excess_k = variables.variable('coolant_excess', steps + 1)
    nothing = casadi.MX.zeros(1, steps)
    soc_end, temperature_end_c, heater_end_w, excess_end_k, _, mean_joule_w, drawn_w, _ = (
        symbolic_heated_step(vehicle).map(steps)(
            *start, nothing if heater_power is None else heater_power[:-1] * POWER_SCALE_W,
            nothing if excess_k is None else excess_k[:-1], *inputs))
    lost_j = casadi.MX(0.0)
    if heater_power is not None:
        constraints.add('heater_power_defect', heater_end_w / POWER_SCALE_W - heater_power[1:],
                        POWER_SCALE_W)
        lost_j = path.heater_lag_s * POWER_SCALE_W * heater_power[-1]
    if excess_k is not None:
        constraints.add('coolant_excess_defect', excess_end_k - excess_k[1:])
    return soc_end, temperature_end_c, mean_joule_w, drawn_w, lost_j
