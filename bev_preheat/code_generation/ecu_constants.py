# SPDX-License-Identifier: Apache-2.0
"""A vehicle, and a situation, as constants of C: the numbers of the structs that the core is called with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from ctypes import c_double, cast, POINTER
import math
from textwrap import fill
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.native.structs import NativeVehicle, NotDescribed, TABLE, VehicleStruct
from bev_preheat.vehicle.trip_columns import TRIP_COLUMNS

if TYPE_CHECKING:
    from bev_preheat.native.structs import CurveStruct
    from bev_preheat.vehicle.description import Vehicle

HEAD = """\
/* SPDX-License-Identifier: Apache-2.0 */
/* Made by preheat export-ecu; changes are made in the vehicle's file. */
#include "vehicle.h"
"""
CURVES = ('open_circuit_voltage', 'resistance', 'charge_power_limit', 'discharge_power_limit')
KINDS = ('BEV_POLYNOMIAL', 'BEV_POLYNOMIAL_AND_LOGARITHM', 'BEV_INVERSE_TEMPERATURE', 'BEV_TABLE')
EXPORT_WIDTH = 100


def vehicle_source(vehicle: Vehicle) -> str:
    """Return vehicle.c of a Vehicle; raises InvalidInput if the core does not have a kind of curve."""
    try:
        native = NativeVehicle(vehicle)
    except NotDescribed as error:
        raise InvalidInput(
            f'vehicle {vehicle.name}: cannot be exported: the core does not describe {error}') from error
    struct = native.struct
    tables: list[str] = []
    members = [f'  .{name} = {number(getattr(struct, name))},' for name, kind, *_ in VehicleStruct._fields_
               if kind is c_double]
    for name in CURVES:
        members.append(f'  .{name} = {_curve(name, getattr(struct, name), tables)},')
    leakage = vehicle.battery.leakage
    car = (leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps, vehicle.hvch.maximum_power_w,
           vehicle.battery.soc_range[0], vehicle.defaults.target_battery_temperature_c)
    return '\n'.join([
        HEAD, *tables, f'const char *const bev_ecu_vehicle_name = {_text(vehicle.name)};', '',
        'const bev_vehicle bev_ecu_vehicle = {', *members, '};', '',
        f'const bev_ecu_car bev_ecu_car_of_vehicle = {_braced(car)};', ''])


def example_source(columns: Sequence[Sequence[float]], situation: Iterable[float]) -> str:
    """Return example.c: the columns of a trip, in the order of bev_trip, and a bev_ecu_situation."""
    arrays = [_array(name, column) for name, column in zip(TRIP_COLUMNS, columns, strict=True)]
    return '\n'.join([
        HEAD, *arrays,
        fill(f'const bev_trip bev_ecu_example_trip = {{{len(columns[1])}, {", ".join(TRIP_COLUMNS)}}};',
             EXPORT_WIDTH, subsequent_indent='    '),
        '', f'const bev_ecu_situation bev_ecu_example = {_braced(situation)};', ''])


def number(value: float) -> str:
    """Return a number as a C literal, bit-exact."""
    if not math.isfinite(value):
        raise InvalidInput(f'{value}: a constant must be finite')
    return repr(float(value))


def _curve(name: str, curve: CurveStruct, tables: list[str]) -> str:
    """Return the initialiser of a curve; the arrays of a table are added to `tables`."""
    members = [f'.kind = {KINDS[curve.kind]}', f'.factor_count = {curve.factor_count}']
    if curve.factor_count:
        members.append(f'.factor = {_braced(curve.factor[:])}')
    if curve.kind != TABLE:
        members.append(f'.parameter = {_braced(curve.parameter[:])}')
        return f'{{{", ".join(members)}}}'
    soc_count, temperature_count = curve.soc_count, curve.temperature_count
    for axis, address, count in (('soc', curve.soc, soc_count),
                                 ('temperature_c', curve.temperature_c, temperature_count),
                                 ('values', curve.values, soc_count * temperature_count)):
        tables.append(_array(f'{name}_{axis}', cast(address, POINTER(c_double))[:count]))
        members.append(f'.{axis} = {name}_{axis}')
    members += [f'.soc_count = {soc_count}', f'.temperature_count = {temperature_count}']
    return f'{{{", ".join(members)}}}'


def _array(name: str, values: Sequence[float]) -> str:
    return fill(f'static const double {name}[{len(values)}] = {_braced(values)};', EXPORT_WIDTH,
                subsequent_indent='    ') + '\n'


def _braced(values: Iterable[float]) -> str:
    return f'{{{", ".join(map(number, values))}}}'


def _text(text: str) -> str:
    """Return a string literal; characters outside plain ASCII, or special in C, become '_'."""
    return '"' + ''.join(each if each.isascii() and each.isprintable() and each not in '"\\?' else '_'
                         for each in text) + '"'
