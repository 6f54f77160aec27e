# SPDX-License-Identifier: Apache-2.0
"""
C of the model's equations, made from the Python ones: `python3 -m bev_preheat.code_generation.c_source DIR`.

core/CMakeLists.txt runs it when the core is built. DIR gets formulas.h, the formulas of curves, steps.h,
the rates of change, the steps of the integrators, with and without a heat path, and the limits on terminal
power, drives.h, the functions of the estimation for a car known up to factors, constants.h, the constants
that the core shares with Python modules, and interface.h, a digest of the core's headers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
import re
import sys
from textwrap import fill

from bev_preheat.code_generation.symbols import Field, Operand, Symbol, SYMBOLS, written_out
from bev_preheat.numerics import AnyNumber, Arithmetic, CurveFunction
from bev_preheat.vehicle import model
from bev_preheat.vehicle.core_interface import constant_lines, constants, read_headers
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage
from bev_preheat.vehicle.description import Battery, Defaults, Drivetrain, HeatPath, Hvch, Leakage, Vehicle
from bev_preheat.vehicle.heated_step import make_heated_step
from bev_preheat.vehicle.model import (
    make_euler,
    make_midpoint,
    make_rates,
    make_runge_kutta_4,
    make_terminal_limits,
)
from bev_preheat.vehicle.variants import DriveInputs, Lagging, make_drive_rates, make_lagging_step

HEAD = """\
/* SPDX-License-Identifier: Apache-2.0 */
/* Made by bev_preheat.code_generation.c_source from Python and the core's headers; changes are made there. */
#ifndef {guard}
#define {guard}

{includes}
"""
SOURCE_WIDTH = 100
INPUTS = ('duration_s', 'power_w', 'variance_w2', 'heat_w', 'leakage_w_per_k')
STEP = ('soc', 'temperature_c', *INPUTS)
HEATED_STEP = ('soc', 'temperature_c', 'heater_w', 'excess_k', *INPUTS, 'command_w')
CURVE = ('soc', 'temperature_c')
LIMITS = ('soc', 'temperature_c', 'variance_w2')
RATES = ('soc', 'temperature_c', *INPUTS[1:])
# Values of the curves at a state, as arguments.
CIRCUIT = ('voltage_v', 'resistance_ohm')
POWER_LIMITS = ('charge_w', 'discharge_w')
# State, factors and inputs of a car known up to factors, and the nominal leakage.
FACTORS = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'propulsion')
ROUTE_DRIVE = tuple(field.name for field in fields(DriveInputs)
                    if field.name not in ('terminal_power_w', 'hidden_variance_w2'))
LEAKAGE = tuple(field.name for field in fields(Leakage))
LAGGING = tuple(field.name for field in fields(Lagging))


NO_LEAKAGE = Leakage(0.0, 0.0)


@dataclass(frozen=True)
class _VehicleCurve:
    """A curve of the vehicle, whatever its kind: `bev_at` finds that out."""

    name: str

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)`, a Symbol."""
        return lambda soc, temperature_c: Symbol(
            f'bev_at(&vehicle->{self.name}, saturating, {{}}, {{}})', soc, temperature_c)


@dataclass(frozen=True)
class _GivenCurve:
    """A curve whose value at the state is an argument, read beforehand for many states at once."""

    name: str

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)`, a Symbol."""
        return lambda soc, temperature_c: Symbol(self.name)


def _with_given_curves(vehicle: Vehicle) -> Vehicle:
    """Return a Vehicle whose curves have the values of CIRCUIT and POWER_LIMITS."""
    voltage, resistance, charge, discharge = map(_GivenCurve, (*CIRCUIT, *POWER_LIMITS))
    return replace(vehicle, battery=replace(
        vehicle.battery, open_circuit_voltage=voltage, resistance=resistance, charge_power_limit=charge,
        discharge_power_limit=discharge))


def _vehicle(heat_path: HeatPath, leakage: Leakage = NO_LEAKAGE) -> Vehicle:
    """Return a Vehicle whose numbers are fields of the struct `bev_vehicle`, except its leakage."""
    return Vehicle(
        name='', battery=Battery(
            capacity_ah=_field('capacity_ah'),
            heat_capacity_j_per_k=_field('heat_capacity_j_per_k'),
            open_circuit_voltage=_VehicleCurve('open_circuit_voltage'),
            resistance=_VehicleCurve('resistance'),
            discharge_power_limit=_VehicleCurve('discharge_power_limit'),
            charge_power_limit=_VehicleCurve('charge_power_limit'),
            leakage=leakage, soc_range=(0.0, 1.0), temperature_range_c=(0.0, 0.0)),
        # Its heat_share is that of the struct.
        drivetrain=Drivetrain(0.0, _field('heat_share'), 0.0), hvch=Hvch(0.0, _field('heater_efficiency')),
        defaults=Defaults(0.0, 0.0, 0.0), heat_path=heat_path)


def _field(name: str) -> AnyNumber:
    return Field(f'vehicle->{name}')


def _function(name: str, subject: str, arguments: Sequence[str], results: Sequence[Operand],
              is_value: bool = False, may_saturate: bool = True) -> str:
    """Return a C function of `subject`, `saturating` if it may saturate, and doubles, to one value or `result`."""
    lines, ends = written_out(results)
    lines += ([f'return {ends[0]};'] if is_value
              else [f'result[{n}] = {end};' for n, end in enumerate(ends)])
    body = '\n'.join(lines)
    names = [*filter(None, [subject.rpartition('*')[2]]), *may_saturate * ['saturating'], *arguments]
    unused = [f'(void){each};' for each in names if not re.search(rf'\b{each}\b', body)]
    parameters = ', '.join(
        [*(f'const {each}' for each in (subject,) if each), *may_saturate * ['int32_t saturating'],
         *(f'double {each}' for each in arguments),
         *(() if is_value else (f'double result[{len(results)}]',))])
    return '\n'.join([
        fill(f'static inline {"double" if is_value else "void"} {name}({parameters}) {{',
             SOURCE_WIDTH, subsequent_indent='    '),
        *(f'  {line}' for line in [*unused, *lines]), '}', ''])


def _curve(name: str, curve: PolynomialVoltage | InverseTemperatureResistance) -> str:
    arguments = [Symbol(each) for each in CURVE]
    return _function(name, 'bev_curve *curve', CURVE, [curve.function(SYMBOLS)(*arguments)], True)


def formulas() -> str:
    """Return formulas.h: the formulas of `vehicle.curves`, with the parameters of a `bev_curve`."""
    parameters: list[AnyNumber] = [Field(f'curve->parameter[{n}]') for n in range(5)]
    return '\n'.join([
        HEAD.format(guard='BEV_PREHEAT_CORE_FORMULAS_H_', includes=(
            '#include "arithmetic.h"\n#include "bev_preheat_core/core.h"')),
        _curve('bev_polynomial', PolynomialVoltage(tuple(parameters[:4]))),
        _curve('bev_polynomial_and_logarithm',
               PolynomialVoltage(tuple(parameters[:4]), parameters[4])),
        _curve('bev_inverse_temperature', InverseTemperatureResistance(*parameters[:3])),
        '#endif', ''])


def _balance() -> list[str]:
    """Return the terms of the heat balance and of the terminal power along a trip."""
    vehicle = _vehicle(HeatPath())

    def term(name: str, term_of: Callable[..., AnyNumber], *arguments: str, has_vehicle: bool = True) -> str:
        return _function(
            name, 'bev_vehicle *vehicle' if has_vehicle else '', arguments,
            [term_of(*has_vehicle * [vehicle], *map(Symbol, arguments))], is_value=True, may_saturate=False)

    return [
        term('bev_heat_with_heater_w', model.heat_with_heater_w, 'heat_w', 'heater_w'),
        term('bev_heat_with_brake_w', model.heat_with_brake_w, 'heat_w', 'brake_w'),
        term('bev_heat_under_w', model.heat_under_w, 'heat_w', 'heater_w', 'brake_w'),
        term('bev_leaked_w', model.leaked_w, 'leakage_w_per_k', 'ambient_c', 'temperature_c',
             has_vehicle=False),
        term('bev_deliverable_w', model.deliverable_w, *CIRCUIT, has_vehicle=False)]


def _trip_terms() -> list[str]:
    """Return the terms of a trip: leakage, drivetrain heat, power and heat without battery heating."""
    leakage: list[AnyNumber] = [Field(f'terms->{name}') for name in LEAKAGE]
    heat_share: AnyNumber = Field('terms->heat_share')
    drivetrain = Drivetrain(0.0, heat_share, 0.0)
    functions: list[tuple[str, Callable[..., AnyNumber], tuple[str, ...], str]] = [
        ('bev_leakage_w_per_k', Leakage(*leakage).coefficient_w_per_k, ('speed_mps',), 'bev_trip_terms *terms'),
        ('bev_drivetrain_heat_w', drivetrain.heat_to_battery_w, ('magnitude_w',), 'bev_trip_terms *terms'),
        ('bev_idle_power_w', model.idle_power_w, ('propulsion_w', 'cabin_w', 'auxiliary_w'), ''),
        ('bev_idle_heat_w', model.idle_heat_w, (
            'leakage_w_per_k', 'ambient_c', 'drivetrain_heat_w'), '')]
    return [_function(name, subject, arguments, [function(*map(Symbol, arguments))], is_value=True,
                      may_saturate=False) for name, function, arguments, subject in functions]


def steps() -> str:
    """Return steps.h: rates (also with the curves' values), integrators by heat path, limits, heat balance."""
    lag_s = _field('heater_lag_s')
    coolant = _field('coolant_heat_capacity_j_per_k'), _field('coolant_conductance_w_per_k')
    shell_share = _field('shell_share')
    direct = _vehicle(HeatPath())
    functions = [_function('bev_rates', 'bev_vehicle *vehicle', RATES, make_rates(direct, SYMBOLS)(
        *(Symbol(each) for each in RATES)))]
    functions += [
        _function(name, 'bev_vehicle *vehicle', STEP, make_integrator(make_rates(direct, SYMBOLS))(
            *(Symbol(each) for each in STEP)))
        for name, make_integrator in (('bev_euler', make_euler), ('bev_midpoint', make_midpoint),
                                      ('bev_runge_kutta_4', make_runge_kutta_4))]
    functions += [
        _function(name, 'bev_vehicle *vehicle', HEATED_STEP, make_heated_step(
            _vehicle(path), SYMBOLS)(*(Symbol(each) for each in HEATED_STEP)))
        for name, path in (('bev_heated_at_once', HeatPath()),
                           ('bev_heated_with_lag', HeatPath(lag_s)),
                           ('bev_heated_by_coolant', HeatPath(0.0, *coolant)),
                           ('bev_heated_by_coolant_with_lag', HeatPath(lag_s, *coolant)),
                           ('bev_heated_by_shell', HeatPath(0.0, *coolant, shell_share=shell_share)),
                           ('bev_heated_by_shell_with_lag', HeatPath(lag_s, *coolant, shell_share=shell_share)))]
    functions.append(_function(
        'bev_terminal_limits', 'bev_vehicle *vehicle', LIMITS,
        make_terminal_limits(direct, SYMBOLS)(*(Symbol(each) for each in LIMITS))))
    given = _with_given_curves(direct)
    functions += [
        _function('bev_rates_of_circuit', 'bev_vehicle *vehicle', (*CIRCUIT, *RATES[1:]), make_rates(
            given, SYMBOLS)(*(Symbol(each) for each in RATES))),
        _function('bev_terminal_limits_of_circuit', 'bev_vehicle *vehicle',
                  (*CIRCUIT, *POWER_LIMITS, LIMITS[-1]), make_terminal_limits(given, SYMBOLS)(
                      *(Symbol(each) for each in LIMITS)))]
    functions += _balance()
    return '\n'.join([HEAD.format(guard='BEV_PREHEAT_CORE_STEPS_H_', includes='#include "curves.h"'),
                      *functions, '#endif', ''])


def drives() -> str:
    """Return drives.h: rates in a drive of known route or power, and lags; curves' values are arguments."""
    leakage: list[AnyNumber] = [Symbol(name) for name in LEAKAGE]
    car = _with_given_curves(_vehicle(HeatPath(), Leakage(*leakage)))
    rates = make_drive_rates(car, SYMBOLS, lambda mean, variance: Symbol(
        'bev_mean_magnitude({}, {})', mean, variance))
    seen = tuple(field.name for field in fields(DriveInputs))
    functions = [
        _function(name, 'bev_vehicle *vehicle', (*CIRCUIT, 'temperature_c', *FACTORS, *inputs, *LEAKAGE), rates(
            Symbol('temperature_c'), Symbol('soc'), [*map(Symbol, FACTORS)],
            DriveInputs(*map(Symbol, inputs))))
        for name, inputs in (('bev_rates_on_route', ROUTE_DRIVE), ('bev_rates_of_seen_power', seen))]
    functions.append(_function(
        'bev_lagging_step', 'bev_vehicle *vehicle',
        (*LAGGING, 'temperature_rate', 'soc_rate', 'joule_w', 'heat_capacity', 'duration_s'),
        make_lagging_step(replace(car, heat_path=HeatPath(shell_share=_field('shell_share'))))(
            Lagging(*map(Symbol, LAGGING)), (Symbol('temperature_rate'), Symbol('soc_rate'), Symbol('joule_w')),
            Symbol('heat_capacity'), Symbol('duration_s'))))
    return '\n'.join([HEAD.format(guard='BEV_PREHEAT_CORE_DRIVES_H_', includes=(
        '#include "curves.h"\n#include "folded_normal.h"')), *functions, *_trip_terms(), '#endif', ''])


def constants_header() -> str:
    """Return constants.h: tolerances, bounds and other constants defined in Python modules."""
    return '\n'.join([HEAD.format(guard='BEV_PREHEAT_CORE_CONSTANTS_H_', includes='\n'.join(constant_lines())),
                      '#endif', ''])


def interface() -> str:
    """Return interface.h: the digest by which a caller recognises the library."""
    return '\n'.join([
        HEAD.format(guard='BEV_PREHEAT_CORE_INTERFACE_H_',
                    includes=f'#define BEV_INTERFACE_DIGEST {read_headers().digest(constants())}'), '#endif', ''])


def main(folder: str) -> None:
    """Write the headers into a folder, which is made if it does not exist."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, text in (
            ('constants.h', constants_header()), ('formulas.h', formulas()), ('steps.h', steps()),
            ('drives.h', drives()), ('interface.h', interface())):
        Path(folder, name).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main(*sys.argv[1:])
