# SPDX-License-Identifier: Apache-2.0
"""
The steps of a drive in a nonlinear program: named rows of variables and their constraints.

Blocks know the places of the rows in the program's vector.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TYPE_CHECKING

import casadi
import numpy as np

from bev_preheat.nonlinear_program.symbols import FACTORS, symbolic_curve, symbolic_rates, symbolic_step
from bev_preheat.tunables import ROUNDING_W
from bev_preheat.vehicle.model import heat_with_brake_w

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle import Vehicle
    from bev_preheat.vehicle.description import HeatSource
    from bev_preheat.vehicle.variants import Corrections

# Values of each row: one number for all its elements, or one for each, in SI units.
Values = Mapping[str, 'FloatArray | float']

# The scale that brings powers near 1.
POWER_SCALE_W = 1e3


class Blocks:
    """Rows of a program, in the order of its vector; `scale` is the SI value that is 1 in the program."""

    def __init__(self) -> None:
        """Begin empty."""
        self._rows: dict[str, casadi.MX] = {}
        self._scales: dict[str, float] = {}

    def add(self, name: str, row: casadi.MX, scale: float = 1.0) -> None:
        """Add a row vector, scaled."""
        self._rows[name], self._scales[name] = row, scale

    def variable(self, name: str, count: int, scale: float = 1.0) -> casadi.MX:
        """Add and return a row of variables, scaled."""
        self.add(name, casadi.MX.sym(name, 1, count), scale)
        return self._rows[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows."""
        return tuple(self._rows)

    def row(self, name: str) -> casadi.MX:
        """Return the row that was added under a name; raises KeyError for an unknown name."""
        return self._rows[name]

    def vector(self) -> casadi.MX:
        """Return all rows as one column."""
        return casadi.vertcat(*(row.T for row in self._rows.values()))

    def pack(self, values: Values, otherwise: float | None = None) -> FloatArray:
        """
        Return the vector of values in SI units, scaled.

        Names that are not in the program are ignored; missing ones have the value `otherwise`. Raises KeyError if
        that is None, ValueError if a row has another number of values.
        """
        return np.concatenate([
            np.broadcast_to(np.asarray(values[name] if otherwise is None else values.get(name, otherwise),
                                       dtype=float) / self._scales[name], row.shape[1])
            for name, row in self._rows.items()])

    def unpack(self, vector: FloatArray) -> dict[str, FloatArray]:
        """Return the rows of a vector by name, in SI units."""
        ends = np.cumsum([row.shape[1] for row in self._rows.values()])
        return {name: scale * part for (name, scale), part in zip(
            self._scales.items(), np.split(np.asarray(vector), ends[:-1]))}


# Scales that bring variables and constraints near 1.
SOC_SCALE = 0.01
ENERGY_SCALE_J = 1e6

# Margins to the power limits (9i) at the start and at the end of a step.
RESERVES = ('discharge', 'charge', 'discharge_at_end', 'charge_at_end')
# Duration [s], idle power [W], power variance [W^2], idle heat [W], leakage [W/K]; with heat sources beside the
# HVCH also ambient temperature [deg C] and cabin heating [W].
ROUTE_INPUTS = 5
WEATHER_INPUTS = 2


def power_row(source: HeatSource) -> str:
    """Return the name of the variables of a heat source's power; that of its margins begins with `room_`."""
    return f'power_of_{source.name}'


class Quantity(NamedTuple):
    """A variable of each step; `scale` is the SI value that is 1 in the program."""

    name: str
    scale: float = 1.0


@dataclass(frozen=True)
class DriveSteps:
    """
    Steps of a drive, and parameters: `route_inputs` of each step, then FACTORS.

    `energy` is the battery's, and `heating` that of the heat sources, scaled.
    """

    parameters: casadi.MX
    energy: casadi.MX
    heating: casadi.MX


def route_inputs(vehicle: Vehicle) -> int:
    """Return how many inputs the route gives to each step."""
    return ROUTE_INPUTS + (WEATHER_INPUTS if vehicle.heat_sources else 0)


def drive_states(vehicle: Vehicle) -> tuple[Quantity, ...]:
    """Return the states of a drive, without quantities that have no lag and hence no freedom."""
    path = vehicle.heat_path
    states = [Quantity('soc', SOC_SCALE), Quantity('temperature')]
    if path.heater_lag_s > 0.0:
        states.append(Quantity('heater_power', POWER_SCALE_W))
    if path.has_coolant:
        states.append(Quantity('coolant_excess'))
    return tuple(states)


def add_drive_steps(vehicle: Vehicle, steps: int, limited: bool, variables: Blocks, constraints: Blocks,
                    deficit_w: casadi.MX | float = 0.0) -> DriveSteps:
    """Add a drive's steps, with defects and limits, to a program; `deficit_w` may be missing (scaled)."""
    states = drive_states(vehicle)
    rows = [variables.variable(state.name, steps + 1, state.scale) for state in states]
    controls = [variables.variable(control.name, steps, control.scale) for control in _controls(vehicle, limited)]
    route = casadi.MX.sym('route', route_inputs(vehicle), steps)
    corrections = casadi.MX.sym('corrections', len(FACTORS))
    ends, energy, reserves, room = along_rows(_drive_step(vehicle, limited), [
        casadi.vertcat(*(row[:-1] for row in rows), *controls), route, corrections], steps)
    energy = casadi.sum2(energy)
    for number, (state, row) in enumerate(zip(states, rows)):
        constraints.add(f'{state.name}_defect', ends[number, :] - row[1:], state.scale)
        if state.name == 'heater_power':
            energy += vehicle.heat_path.heater_lag_s * state.scale * row[-1] / ENERGY_SCALE_J
    if limited:
        for number, reserve in enumerate(RESERVES):
            margin = reserves[number, :]
            constraints.add(reserve, margin + deficit_w if reserve.startswith('discharge') else margin,
                            POWER_SCALE_W)
    for number, source in enumerate(vehicle.heat_sources):
        constraints.add(f'room_{power_row(source)}', room[number, :], POWER_SCALE_W)
    heating = casadi.sum2(route[0, :] * sum(map(variables.row, map(power_row, vehicle.heat_sources)),
                                            variables.row('heater'))) * (POWER_SCALE_W / ENERGY_SCALE_J)
    return DriveSteps(casadi.vertcat(casadi.vec(route), corrections), energy, heating)


def drive_parameters(trip: Trip, corrections: Corrections) -> FloatArray:
    """Return the values of `DriveSteps.parameters` for the trip of a car with corrections."""
    return np.concatenate([
        np.vstack([trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2,
                   trip.idle_heat_w, trip.leakage_w_per_k, *((
                       trip.route.ambient_temperature_c, trip.route.cabin_heating_power_w)
                       if trip.vehicle.heat_sources else ())]).ravel(order='F'),
        [getattr(corrections, factor) for factor in FACTORS]])


def along_rows(function: casadi.Function, arguments: Sequence[casadi.MX],
               columns: int) -> list[casadi.MX]:
    """
    Return the outputs of a Function of SX for each column of its arguments, one column each.

    Its inputs and outputs are columns without structural zeros. An argument with one column is used for all
    columns. One operation serves all columns, so a program is solved ten times as fast as with `Function.map`.
    """
    rows = [casadi.vertsplit(argument) for argument in arguments]
    work: dict[int, casadi.MX] = {}
    outputs = [[casadi.MX(0.0)] * function.nnz_out(number) for number in range(function.n_out())]
    for number in range(function.n_instructions()):
        operation = function.instruction_id(number)
        into, operands = function.instruction_output(number), function.instruction_input(number)
        if operation == casadi.OP_INPUT:
            work[into[0]] = rows[operands[0]][operands[1]]
        elif operation == casadi.OP_OUTPUT:
            outputs[into[0]][into[1]] = work[operands[0]]
        elif operation == casadi.OP_CONST:
            work[into[0]] = casadi.MX(function.instruction_constant(number))
        elif len(operands) == 1:
            work[into[0]] = casadi.MX.unary(operation, work[operands[0]])
        else:
            left, right = operands
            work[into[0]] = casadi.MX.binary(operation, work[left], work[right])
    return [casadi.vertcat(casadi.MX(0, columns), *(
        value if value.shape[1] == columns else casadi.repmat(value, 1, columns)
        for value in output)) for output in outputs]


def _controls(vehicle: Vehicle, limited: bool) -> tuple[Quantity, ...]:
    """Return the controls of each step; the brake only with power limits, without which it has no effect."""
    names = ('heater', *(['brake'] if limited else []), *map(power_row, vehicle.heat_sources))
    return tuple(Quantity(name, POWER_SCALE_W) for name in names)


def _drive_step(vehicle: Vehicle, limited: bool) -> casadi.Function:
    """
    Return one step of a drive as a CasADi Function.

    Inputs: states and controls (scaled, one column), the `route_inputs` of the step, the FACTORS. Outputs: the
    states at the end; the energy from the cells (scaled); the RESERVES (scaled; only if `limited`); the room of
    each heat source, whose power is free below its maximum. Derivatives: with respect to states and controls only.
    """
    states = drive_states(vehicle)
    quantities = (*states, *_controls(vehicle, limited))
    variables = casadi.SX.sym('variables', len(quantities))
    route = casadi.SX.sym('route', route_inputs(vehicle))
    factors = casadi.SX.sym('corrections', len(FACTORS))
    duration_s, idle_power_w, variance_w2, idle_heat_w, leakage_w_per_k, *weather = casadi.vertsplit(route)
    in_si = {quantity.name: quantity.scale * value for quantity, value in zip(
        quantities, casadi.vertsplit(variables))}
    nothing = casadi.SX(0.0)
    soc, temperature_c, brake_w = in_si['soc'], in_si['temperature'], in_si.get('brake', nothing)
    heat_w, ends = heat_with_brake_w(vehicle, idle_heat_w, brake_w), {}
    room, command_w = [], in_si['heater']
    for source in vehicle.heat_sources:
        ambient_c, cabin_w = weather
        source_w = in_si[power_row(source)]
        limit_w, hvch_watts = (symbolic_curve(curve)(ambient_c, temperature_c) for curve in (
            source.maximum_power_w, source.hvch_watts))
        if source.shares_cabin_limit:
            limit_w = casadi.fmax(limit_w - cabin_w, 0.0)
        if source.power_steps_w:
            limit_w = sum(((high_w - low_w) * (limit_w + ROUNDING_W >= high_w)
                           for low_w, high_w in pairwise((0.0, *source.power_steps_w))), nothing)
        room.append(limit_w - source_w)
        hvch_watts = hvch_watts * factors[FACTORS.index('source_heat')]
        # All heat takes the HVCH's path; the power beyond that of the HVCH for it has no heat.
        command_w, idle_power_w = command_w + hvch_watts * source_w, idle_power_w + (1.0 - hvch_watts) * source_w
    (ends['soc'], ends['temperature'], ends['heater_power'], ends['coolant_excess'], _, joule_w,
     drawn_w, _) = symbolic_step(vehicle)(
        soc, temperature_c, in_si.get('heater_power', nothing), in_si.get('coolant_excess', nothing), duration_s,
        idle_power_w + brake_w, variance_w2, heat_w, leakage_w_per_k, command_w, *casadi.vertsplit(factors))
    power_w = idle_power_w + brake_w + drawn_w
    reserves = []
    if limited:
        rates = symbolic_rates(vehicle)
        most_w, least_w = (symbolic_curve(curve) for curve in (
            vehicle.battery.discharge_power_limit, vehicle.battery.charge_power_limit))
        for state in (soc, temperature_c), (ends['soc'], ends['temperature']):
            battery_w = power_w + rates(
                *state, power_w, variance_w2, heat_w, leakage_w_per_k, *casadi.vertsplit(factors))[2]
            reserves += [most_w(*state) - battery_w, battery_w - least_w(*state)]
    outputs = casadi.cse([
        casadi.vertcat(*(ends[state.name] / state.scale for state in states)),
        duration_s * (power_w + joule_w) / ENERGY_SCALE_J,
        casadi.vertcat(casadi.SX(0, 1), *reserves) / POWER_SCALE_W,
        casadi.vertcat(casadi.SX(0, 1), *room) / POWER_SCALE_W])
    return casadi.Function('drive_step', [variables, route, factors], outputs,
                           {'is_diff_in': [True, False, False]})
