# SPDX-License-Identifier: Apache-2.0
"""The folder of an export: C sources of the core and of its own, a vehicle as constants, and their layout."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from ctypes import c_double, cast, POINTER
import math
import os
from pathlib import Path
import re
from textwrap import fill

from bev_preheat.code_generation import c_source
from bev_preheat.code_generation.ecu_vectors import draw_vectors, first_heated, Vector, vectors_text
from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import installed_prefix
from bev_preheat.files.output_files import AnyPath, check_outputs, expanded, OutputFile, write_whole
from bev_preheat.vehicle.core_structs import CurveStruct, NativeVehicle, NotDescribed, TABLE, VehicleStruct
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.model import TRIP_COLUMNS

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
    if vehicle.heat_sources:
        raise InvalidInput(f'vehicle {vehicle.name}: cannot be exported: heat_sources are not exported; the '
                           'export needs a file with the HVCH alone')
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
        fill(f'const bev_trip bev_ecu_example_trip = {{{len(columns[1])}, {", ".join(TRIP_COLUMNS)}, NULL}};',
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


MADE = ('example.c', 'vectors.txt', 'vehicle.c')
# Output of the export's Makefile.
BUILD = 'build'
# If the sources are read in place, the C files beside them belong to them.
CHECKOUT = Path(__file__).resolve().parents[2]
_OWN = Path(__file__).resolve().parent / 'c'
CORE = 'bev_preheat_core'
# Files for bev_find_switch, bev_find_two_switches and bev_plan_by_values; headers as they are included.
SOURCES = (
    'accounts.c', 'checks.c', 'curves.c', 'limited_run.c', 'limited_step.c',
    'limits.c', 'prices.c', 'runs.c', 'switch_search.c', 'two_switches.c', 'value_function.c',
    'value_layers.c', 'value_path.c', 'value_run.c', 'value_steps.c')
INCLUDED = re.compile(r'^#include "([^/"]+)"', re.MULTILINE)
OWN_FILES = ('MISRA.md', 'Makefile', 'README.md', 'bev_ecu.c', 'bev_ecu.h', 'bev_ecu_shared.h', 'bev_ecu_switch.c',
             'bev_ecu_values.c', 'check.c', 'main.c', 'vehicle.h')


class Export:
    """An export of one vehicle: checked first, then written."""

    def __init__(self, vehicle: Vehicle, folder: AnyPath, inputs: list[Path]) -> None:
        """
        Collect the files that need no planning, and check that the export can be written.

        `inputs` are the files that were read. Raises InvalidInput if the folder cannot be made or has
        files that do not belong to an export, if the vehicle cannot be exported, and if the sources of
        the core are missing.
        """
        if vehicle.heating_gates.is_any:
            raise InvalidInput('heating_gates: the exported sources do not know them; export a file without '
                               'heating_gates, and keep them in the control unit')
        self._vehicle, self._folder = vehicle, expanded(folder)
        self._files = {**core_sources(), **own_sources(), 'vehicle.c': vehicle_source(vehicle)}
        names = {*self._files, *MADE}
        self._check_folder(folder, names)
        try:
            check_outputs([OutputFile('--output', os.path.join(folder, name), make_folder=True)
                           for name in sorted(names)], inputs)
        except InvalidInput as error:
            # A problem of the folder is a problem of each of its files: raise only the first.
            raise InvalidInput(error.problems[0]) from error

    def write(self, count: int, seed: int, report: Callable[[], None]) -> list[Vector]:
        """Draw `count` vectors, write all files, and return the vectors; `report` is called after each."""
        vectors = draw_vectors(self._vehicle, count, seed, report)
        example = first_heated(vectors)
        self._files['example.c'] = example_source(example.columns, example.situation)
        self._files['vectors.txt'] = vectors_text(vectors)
        for name, text in self._files.items():
            write_whole(os.path.join(self._folder, name), text, make_folder=True)
        return vectors

    def _check_folder(self, folder: AnyPath, names: set[str]) -> None:
        """Raise InvalidInput if a folder has files that an export does not write."""
        if self._folder and not os.path.lexists(self._folder):
            return
        if not os.path.isdir(self._folder):
            raise InvalidInput(f"--output: {os.fspath(folder) or repr('')}: is not a folder")
        ours = {name.partition('/')[0] for name in names} | {BUILD}
        try:
            others = sorted(set(os.listdir(self._folder)) - ours)
        except OSError as error:
            raise InvalidInput(f'--output: {os.fspath(folder)}: cannot be read: {error.strerror}') from error
        if others:
            raise InvalidInput(f'--output: {os.fspath(folder)}: has files that an export does not write: '
                               f'{", ".join(others[:3])}{" …" if len(others) > 3 else ""}; '
                               'name a folder of its own')


def core_sources() -> dict[str, str]:
    """Return {path in the export: text} of the core; raises InvalidInput where its sources are missing."""
    include, source = _core_folders()
    files = {}
    try:
        files[f'include/{CORE}/core.h'] = (include / CORE / 'core.h').read_text(encoding='utf-8')
        wanted = [*SOURCES]
        for name in wanted:
            files[f'src/{name}'] = text = (source / name).read_text(encoding='utf-8')
            wanted += [header for header in INCLUDED.findall(text) if header not in wanted]
    except OSError as error:
        raise InvalidInput(f'{error.filename}: the source of {CORE} cannot be read: {error.strerror}; '
                           'build the packages of one version') from error
    generated = f'include/{CORE}_generated'
    return {**files, f'{generated}/constants.h': c_source.constants_header(),
            f'{generated}/formulas.h': c_source.formulas(),
            f'{generated}/steps.h': c_source.steps()}


def own_sources() -> dict[str, str]:
    """Return {path in the export: text} of the files that do not depend on the vehicle."""
    return {name: (_OWN / name).read_text(encoding='utf-8') for name in OWN_FILES}


def _core_folders() -> tuple[Path, Path]:
    """Return the folders of the core's public headers and of its sources."""
    core = CHECKOUT / 'core'
    if (core / 'src').is_dir():
        return core / 'include', core / 'src'
    prefix = installed_prefix(CORE)
    if prefix is None:
        raise InvalidInput(f'the sources of {CORE} are missing: the package is not installed; build it from a '
                           'checkout: colcon build --base-paths . core msg_defs')
    return prefix / 'include', prefix / 'share' / CORE / 'src'
