# SPDX-License-Identifier: Apache-2.0
"""One step of a drive in a nonlinear program, as a function of its scaled variables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi

from bev_preheat.nonlinear_program.blocks import POWER_SCALE_W
from bev_preheat.nonlinear_program.layout import ProgramQuantity
from bev_preheat.nonlinear_program.symbols import (
    FACTORS,
    symbolic_curve,
    symbolic_heated_step,
    symbolic_rates,
    symbolic_step,
)
from bev_preheat.vehicle.model import heat_with_brake_w

if TYPE_CHECKING:
    from bev_preheat.vehicle import Vehicle

# Scales that bring variables and constraints near 1.
SOC_SCALE = 0.01
ENERGY_SCALE_J = 1e6

HEATER, BRAKE = ProgramQuantity('heater', POWER_SCALE_W), ProgramQuantity('brake', POWER_SCALE_W)
# Margins to the power limits (9i) at the start and at the end of a step.
RESERVES = (ProgramQuantity('discharge', POWER_SCALE_W), ProgramQuantity('charge', POWER_SCALE_W),
            ProgramQuantity('discharge_at_end', POWER_SCALE_W), ProgramQuantity('charge_at_end', POWER_SCALE_W))
# Duration [s], idle power [W], power variance [W^2], idle heat [W], leakage [W/K].
ROUTE_INPUTS = 5
# FACTORS and the heater's efficiency are inputs, so that a car whose factors are being learned needs no new
# program.
CORRECTIONS = len(FACTORS) + 1


def drive_states(vehicle: Vehicle) -> tuple[ProgramQuantity, ...]:
    """
    Return the states of a drive.

    Quantities without a lag are not states, because such variables would have no freedom.
    """
    path = vehicle.heat_path
    states = [ProgramQuantity('soc', SOC_SCALE), ProgramQuantity('temperature')]
    if path.heater_lag_s > 0.0:
        states.append(ProgramQuantity('heater_power', POWER_SCALE_W))
    if path.has_coolant:
        states.append(ProgramQuantity('coolant_excess'))
    return tuple(states)


def drive_controls(limited: bool) -> tuple[ProgramQuantity, ...]:
    """Return the controls of each step; the brake only with power limits, without which it has no effect."""
    return (HEATER, BRAKE) if limited else (HEATER,)


def drive_step(vehicle: Vehicle, limited: bool, end: casadi.SX | None = None) -> casadi.Function:
    """
    Return one step of a drive as a CasADi Function.

    Inputs: states and controls (scaled, one column), the ROUTE_INPUTS of the step, the CORRECTIONS, and
    `end`, if given: symbols for the states at the end (scaled, one column) in the RESERVES. Outputs: the states
    at the end; the energy from the cells (scaled); the RESERVES (scaled; only if `limited`). Derivatives: with
    respect to states and controls only.
    """
    quantities = (*drive_states(vehicle), *drive_controls(limited))
    variables = casadi.SX.sym('variables', len(quantities))
    route = casadi.SX.sym('route', ROUTE_INPUTS)
    corrections = casadi.SX.sym('corrections', CORRECTIONS)
    duration_s, idle_power_w, variance_w2, idle_heat_w, leakage_w_per_k = casadi.vertsplit(route)
    *factors, efficiency = casadi.vertsplit(corrections)
    in_si = {quantity.name: quantity.scale * value for quantity, value in zip(
        quantities, casadi.vertsplit(variables))}
    soc, temperature_c = in_si['soc'], in_si['temperature']
    heater_w, brake_w = in_si['heater'], in_si.get('brake', casadi.SX(0.0))
    heat_w = heat_with_brake_w(vehicle, idle_heat_w, brake_w)
    ends = {}
    if vehicle.heat_path.is_direct:
        drawn_w, heat_w = heater_w, heat_w + efficiency * heater_w
        ends['soc'], ends['temperature'], _, joule_w = symbolic_step(vehicle)(
            soc, temperature_c, duration_s, idle_power_w + brake_w + drawn_w, variance_w2, heat_w,
            leakage_w_per_k, *factors)
    else:
        nothing = casadi.SX(0.0)
        (ends['soc'], ends['temperature'], ends['heater_power'], ends['coolant_excess'], _, joule_w,
         drawn_w, _) = symbolic_heated_step(vehicle)(
            soc, temperature_c, in_si.get('heater_power', nothing),
            in_si.get('coolant_excess', nothing), duration_s, idle_power_w + brake_w, variance_w2,
            heat_w, leakage_w_per_k, heater_w, *factors, efficiency)
    power_w = idle_power_w + brake_w + drawn_w
    at_end = ends if end is None else {state.name: state.scale * value for state, value in zip(
        drive_states(vehicle), casadi.vertsplit(end))}
    reserves = []
    if limited:
        rates = symbolic_rates(vehicle)
        most_w, least_w = (symbolic_curve(curve) for curve in (
            vehicle.battery.discharge_power_limit, vehicle.battery.charge_power_limit))
        for state in (soc, temperature_c), (at_end['soc'], at_end['temperature']):
            battery_w = power_w + rates(
                *state, power_w, variance_w2, heat_w, leakage_w_per_k, *factors)[2]
            reserves += [most_w(*state) - battery_w, battery_w - least_w(*state)]
    outputs = casadi.cse([
        casadi.vertcat(*(ends[state.name] / state.scale for state in drive_states(vehicle))),
        duration_s * (power_w + joule_w) / ENERGY_SCALE_J,
        casadi.vertcat(casadi.SX(0, 1), *reserves) / POWER_SCALE_W])
    more = {} if end is None else {'end': end}
    return casadi.Function(
        'drive_step', [variables, route, corrections, *more.values()], outputs,
        ['variables', 'route', 'corrections', *more], ['ends', 'energy', 'reserves'],
        {'is_diff_in': [True, False, False, *(True for _ in more)]})


def lost_after_arrival(vehicle: Vehicle, states: casadi.SX) -> casadi.SX:
    """Return the energy (scaled) that a heater with lag draws after the states on arrival (scaled)."""
    for state, value in zip(drive_states(vehicle), casadi.vertsplit(states)):
        if state.name == 'heater_power':
            return vehicle.heat_path.heater_lag_s * state.scale * value / ENERGY_SCALE_J
    return casadi.SX(0.0)
