# SPDX-License-Identifier: Apache-2.0
"""
C of the model's equations, made from the Python ones: `python3 -m bev_preheat.code_generation.c_source DIR`.

core/CMakeLists.txt runs it when the core is built. DIR gets formulas.h, the formulas of curves, steps.h,
the rates of change, the steps of the integrators, with and without a heat path, and the limits on terminal
power, drives.h, the functions of the estimation for a car known up to factors, constants.h, the constants
that the core shares with Python modules, and interface.h, a digest of the core's headers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
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
from bev_preheat.vehicle.heat_path import make_heated_step
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
VEHICLE = 'bev_vehicle *vehicle'
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
FACTORS = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'propulsion', 'source_heat')
ROUTE_DRIVE = tuple(field.name for field in fields(DriveInputs)
                    if field.name not in ('terminal_power_w', 'hidden_variance_w2'))
LEAKAGE = tuple(field.name for field in fields(Leakage))
LAGGING = tuple(field.name for field in fields(Lagging))


NO_LEAKAGE = Leakage(0.0, 0.0)


@dataclass(frozen=True)
class _Curve:
    """A curve whose value at a state is an expression in C."""

    value: Callable[[AnyNumber, AnyNumber], AnyNumber]

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)`, a Symbol."""
        return self.value


def _vehicle_curve(name: str) -> _Curve:
    """Return a curve of the vehicle, whatever its kind: `bev_at` finds that out."""
    return _Curve(partial(Symbol, f'bev_at(&vehicle->{name}, saturating, {{}}, {{}})'))


def _given_curve(name: str) -> _Curve:
    """Return a curve whose value at the state is an argument, read beforehand for many states at once."""
    return _Curve(lambda soc, temperature_c: Symbol(name))


def _with_given_curves(vehicle: Vehicle) -> Vehicle:
    """Return a Vehicle whose curves have the values of CIRCUIT and POWER_LIMITS."""
    voltage, resistance, charge, discharge = map(_given_curve, (*CIRCUIT, *POWER_LIMITS))
    return replace(vehicle, battery=replace(
        vehicle.battery, open_circuit_voltage=voltage, resistance=resistance, charge_power_limit=charge,
        discharge_power_limit=discharge))


def _vehicle(heat_path: HeatPath, leakage: Leakage = NO_LEAKAGE) -> Vehicle:
    """Return a Vehicle whose numbers are fields of the struct `bev_vehicle`, except its leakage."""
    return Vehicle(
        name='', battery=Battery(
            capacity_ah=_field('capacity_ah'),
            heat_capacity_j_per_k=_field('heat_capacity_j_per_k'),
            open_circuit_voltage=_vehicle_curve('open_circuit_voltage'),
            resistance=_vehicle_curve('resistance'),
            discharge_power_limit=_vehicle_curve('discharge_power_limit'),
            charge_power_limit=_vehicle_curve('charge_power_limit'),
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


def _traced(name: str, equation: Callable[..., Sequence[Operand]], arguments: Sequence[str]) -> str:
    """Return the C function of an equation of the vehicle, which is called with a Symbol for each argument."""
    return _function(name, VEHICLE, arguments, equation(*map(Symbol, arguments)))


def _term(name: str, equation: Callable[..., AnyNumber], arguments: Sequence[str], subject: str = '') -> str:
    """Return the C function of an equation with one value, which never saturates."""
    return _function(name, subject, arguments, [equation(*map(Symbol, arguments))], is_value=True,
                     may_saturate=False)


def _header(name: str, includes: str, functions: Iterable[str] = ()) -> str:
    """Return a header file."""
    return '\n'.join([HEAD.format(guard=f'BEV_PREHEAT_CORE_{name}_H_', includes=includes), *functions,
                      '#endif', ''])


def formulas() -> str:
    """Return formulas.h: the formulas of `vehicle.curves`, with the parameters of a `bev_curve`."""
    parameters: list[AnyNumber] = [Field(f'curve->parameter[{n}]') for n in range(5)]
    curves: dict[str, PolynomialVoltage | InverseTemperatureResistance] = {
        'bev_polynomial': PolynomialVoltage(tuple(parameters[:4])),
        'bev_polynomial_and_logarithm': PolynomialVoltage(tuple(parameters[:4]), parameters[4]),
        'bev_inverse_temperature': InverseTemperatureResistance(*parameters[:3])}
    return _header('FORMULAS', '#include "arithmetic.h"\n#include "bev_preheat_core/core.h"', (
        _function(name, 'bev_curve *curve', CURVE, [curve.function(SYMBOLS)(*map(Symbol, CURVE))], is_value=True)
        for name, curve in curves.items()))


def _balance() -> list[str]:
    """Return the terms of the heat balance and of the terminal power along a trip."""
    of_vehicle: dict[str, tuple[Callable[..., AnyNumber], tuple[str, ...]]] = {
        'bev_heat_with_heater_w': (model.heat_with_heater_w, ('heat_w', 'heater_w')),
        'bev_heat_with_brake_w': (model.heat_with_brake_w, ('heat_w', 'brake_w')),
        'bev_heat_under_w': (model.heat_under_w, ('heat_w', 'heater_w', 'brake_w'))}
    vehicle = _vehicle(HeatPath())
    return [*(_term(name, partial(equation, vehicle), arguments, VEHICLE)
              for name, (equation, arguments) in of_vehicle.items()),
            _term('bev_leaked_w', model.leaked_w, ('leakage_w_per_k', 'ambient_c', 'temperature_c')),
            _term('bev_deliverable_w', model.deliverable_w, CIRCUIT)]


def _trip_terms() -> list[str]:
    """Return the terms of a trip: leakage, drivetrain heat, power and heat without battery heating."""
    leakage: list[AnyNumber] = [Field(f'terms->{name}') for name in LEAKAGE]
    heat_share: AnyNumber = Field('terms->heat_share')
    drivetrain, subject = Drivetrain(0.0, heat_share, 0.0), 'bev_trip_terms *terms'
    return [
        _term('bev_leakage_w_per_k', Leakage(*leakage).coefficient_w_per_k, ('speed_mps',), subject),
        _term('bev_drivetrain_heat_w', drivetrain.heat_to_battery_w, ('magnitude_w',), subject),
        _term('bev_idle_power_w', model.idle_power_w, ('propulsion_w', 'cabin_w', 'auxiliary_w')),
        _term('bev_idle_heat_w', model.idle_heat_w, ('leakage_w_per_k', 'ambient_c', 'drivetrain_heat_w'))]


def steps() -> str:
    """Return steps.h: rates (also with the curves' values), integrators by heat path, limits, heat balance."""
    lag_s = _field('heater_lag_s')
    coolant = _field('coolant_heat_capacity_j_per_k'), _field('coolant_conductance_w_per_k')
    shell_share = _field('shell_share')
    direct = _vehicle(HeatPath())
    given = _with_given_curves(direct)
    integrators = {'bev_euler': make_euler, 'bev_midpoint': make_midpoint, 'bev_runge_kutta_4': make_runge_kutta_4}
    paths = {
        'bev_heated_at_once': HeatPath(),
        'bev_heated_with_lag': HeatPath(lag_s),
        'bev_heated_by_coolant': HeatPath(0.0, *coolant),
        'bev_heated_by_coolant_with_lag': HeatPath(lag_s, *coolant),
        'bev_heated_by_shell': HeatPath(0.0, *coolant, shell_share=shell_share),
        'bev_heated_by_shell_with_lag': HeatPath(lag_s, *coolant, shell_share=shell_share)}
    return _header('STEPS', '#include "curves.h"', [
        _traced('bev_rates', make_rates(direct, SYMBOLS), RATES),
        *(_traced(name, make_integrator(make_rates(direct, SYMBOLS)), STEP)
          for name, make_integrator in integrators.items()),
        *(_traced(name, make_heated_step(_vehicle(path), SYMBOLS), HEATED_STEP) for name, path in paths.items()),
        _traced('bev_terminal_limits', make_terminal_limits(direct, SYMBOLS), LIMITS),
        _function('bev_rates_of_circuit', VEHICLE, (*CIRCUIT, *RATES[1:]),
                  make_rates(given, SYMBOLS)(*map(Symbol, RATES))),
        _function('bev_terminal_limits_of_circuit', VEHICLE, (*CIRCUIT, *POWER_LIMITS, LIMITS[-1]),
                  make_terminal_limits(given, SYMBOLS)(*map(Symbol, LIMITS))),
        *_balance()])


def drives() -> str:
    """Return drives.h: rates in a drive of known route or power, and lags; curves' values are arguments."""
    leakage: list[AnyNumber] = [Symbol(name) for name in LEAKAGE]
    car = _with_given_curves(_vehicle(HeatPath(), Leakage(*leakage)))
    rates = make_drive_rates(car, SYMBOLS, lambda mean, variance: Symbol(
        'bev_mean_magnitude({}, {})', mean, variance))
    seen = tuple(field.name for field in fields(DriveInputs))
    functions = [
        _function(name, VEHICLE, (*CIRCUIT, 'temperature_c', *FACTORS, *inputs, *LEAKAGE), rates(
            Symbol('temperature_c'), Symbol('soc'), [*map(Symbol, FACTORS)],
            DriveInputs(*map(Symbol, inputs))))
        for name, inputs in (('bev_rates_on_route', ROUTE_DRIVE), ('bev_rates_of_seen_power', seen))]
    functions.append(_function(
        'bev_lagging_step', VEHICLE,
        (*LAGGING, 'temperature_rate', 'soc_rate', 'joule_w', 'heat_capacity', 'duration_s'),
        make_lagging_step(replace(car, heat_path=HeatPath(shell_share=_field('shell_share'))))(
            Lagging(*map(Symbol, LAGGING)), (Symbol('temperature_rate'), Symbol('soc_rate'), Symbol('joule_w')),
            Symbol('heat_capacity'), Symbol('duration_s'))))
    return _header('DRIVES', '#include "curves.h"\n#include "folded_normal.h"', [*functions, *_trip_terms()])


def constants_header() -> str:
    """Return constants.h: tolerances, bounds and other constants defined in Python modules."""
    return _header('CONSTANTS', '\n'.join(constant_lines()))


def interface() -> str:
    """Return interface.h: the digest by which a caller recognises the library."""
    return _header('INTERFACE', f'#define BEV_INTERFACE_DIGEST {read_headers().digest(constants())}')


def main(folder: str) -> None:
    """Write the headers into a folder, which is made if it does not exist."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, text in (
            ('constants.h', constants_header()), ('formulas.h', formulas()), ('steps.h', steps()),
            ('drives.h', drives()), ('interface.h', interface())):
        Path(folder, name).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main(*sys.argv[1:])
