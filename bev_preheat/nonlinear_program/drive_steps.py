# SPDX-License-Identifier: Apache-2.0
"""The steps of a drive in a program without stages: rows of variables and their constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi

from bev_preheat.nonlinear_program.drive_step import (
    CORRECTIONS,
    drive_controls,
    drive_states,
    drive_step,
    RESERVES,
    ROUTE_INPUTS,
)

if TYPE_CHECKING:
    from bev_preheat.nonlinear_program.blocks import Blocks
    from bev_preheat.vehicle import Vehicle


@dataclass(frozen=True)
class DriveSteps:
    """N steps of a drive: `parameters` are the ROUTE_INPUTS of each step, then the CORRECTIONS."""

    vehicle: Vehicle
    parameters: casadi.MX


def add_drive_steps(vehicle: Vehicle, steps: int, limited: bool, variables: Blocks,
                    constraints: Blocks) -> DriveSteps:
    """Add the steps of a drive, with defects and power limits, to a program, and return them."""
    states = drive_states(vehicle)
    rows = [variables.variable(state.name, steps + 1, state.scale) for state in states]
    controls = [variables.variable(control.name, steps, control.scale)
                for control in drive_controls(limited)]
    route = casadi.MX.sym('route', ROUTE_INPUTS, steps)
    corrections = casadi.MX.sym('corrections', CORRECTIONS)
    ends, _, reserves = drive_step(vehicle, limited).map(steps)(
        casadi.vertcat(*(row[:-1] for row in rows), *controls), route, corrections)
    for number, (state, row) in enumerate(zip(states, rows)):
        constraints.add(f'{state.name}_defect', ends[number, :] - row[1:], state.scale)
    if limited:
        for number, reserve in enumerate(RESERVES):
            constraints.add(reserve.name, reserves[number, :], reserve.scale)
    return DriveSteps(vehicle, casadi.vertcat(casadi.vec(route), corrections))
