# SPDX-License-Identifier: Apache-2.0
"""Loads a Vehicle from a YAML file, and refuses implausible files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path

import numpy as np

from bev_preheat.errors import figure, figure_beyond, InvalidInput, quoted
from bev_preheat.files.checked_yaml import check_yaml, FileData, load_checked_yaml
from bev_preheat.files.input_files import find_configuration
from bev_preheat.numerics import ARRAYS, Curve, FloatArray
from bev_preheat.vehicle.charging import read_charging
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, with_connections
from bev_preheat.vehicle.description import (
    Battery,
    Defaults,
    Drivetrain,
    gate_problems,
    HeatingGates,
    HeatPath,
    Hvch,
    Leakage,
    RoadLoad,
    Uncertainty,
    Vehicle,
)
from bev_preheat.vehicle.heat_sources import arguments_of, heat_source_problems, read_heat_source, read_table
from bev_preheat.vehicle.variants import with_shell

SCHEMA = Path(__file__).with_name('schema.yaml')
BATTERY_NUMBERS = ('capacity_ah', 'heat_capacity_j_per_k', 'soc_range', 'temperature_range_c')

# Least plausible thermal time constant of a battery, and the speed it is checked at: below it some value is
# wrong by a power of ten.
LEAST_TIME_CONSTANT_S = 20.0
FAST_MPS = 40.0
# A coolant lag above this is also wrong by a power of ten.
MOST_COOLANT_LAG_S = 3600.0
# Valid range of a curve's values: (low, high, unit).
VOLTAGE_RANGE_V = (10.0, 2000.0)
RESISTANCE_RANGE_OHM = (1e-6, 100.0)
DISCHARGE_RANGE_W = (0.0, 2e6)
CHARGE_RANGE_W = (-2e6, 0.0)


def load_vehicle(name_or_file: str | Path) -> Vehicle:
    """Return the Vehicle of config/vehicles or of a YAML file; raise InvalidInput naming file, key and range."""
    path = vehicle_file(name_or_file)
    return _vehicle(load_checked_yaml(path, SCHEMA), path)


def vehicle_of_text(text: str, name: str) -> Vehicle:
    """Return the Vehicle of the text of a vehicle file; `name` names the text in InvalidInput."""
    return _vehicle(check_yaml(text, name, SCHEMA), name)


def _vehicle(contents: dict[str, FileData], path: str | Path) -> Vehicle:
    """Return the Vehicle of a checked file; raises InvalidInput that names the file."""
    battery = contents['battery']
    problems = []
    for key in ('soc_range', 'temperature_range_c'):
        low, high = battery[key]
        if not low < high:
            problems.append(f'battery.{key}: [{low}, {high}] must rise')
    target_c = contents['defaults']['target_battery_temperature_c']
    lowest_c, highest_c = battery['temperature_range_c']
    if not lowest_c <= target_c <= highest_c:
        problems.append(
            f'defaults.target_battery_temperature_c: {target_c} is outside '
            f'battery.temperature_range_c {lowest_c} ... {highest_c}')

    drivetrain = {'maximum_regeneration_power_w': contents['drivetrain']['maximum_power_w'],
                  **contents['drivetrain']}
    if drivetrain['maximum_regeneration_power_w'] > drivetrain['maximum_power_w']:
        problems.append(
            'drivetrain.maximum_regeneration_power_w: '
            f'{drivetrain["maximum_regeneration_power_w"]} is above drivetrain.maximum_power_w, '
            f'{drivetrain["maximum_power_w"]}')

    problems += _keys_that_are_not_there(contents)
    path_of_heat = HeatPath(**arguments_of(contents.get('heat_path', {})))
    problems += heat_path_problems(path_of_heat)
    if 'thermal' in contents:
        problems += thermal_problems(contents['thermal'], battery['heat_capacity_j_per_k'], path_of_heat)
    gates = HeatingGates(**arguments_of(contents.get('heating_gates', {})))
    problems += gate_problems(gates, contents['hvch']['maximum_power_w'], lowest_c)
    heat_sources = tuple(read_heat_source(str(name), node, float(contents['hvch']['efficiency']), problems)
                         for name, node in contents.get('heat_sources', {}).items())
    problems += heat_source_problems(heat_sources, path_of_heat)
    leakage = Leakage(**arguments_of(battery['leakage']))
    time_constant_s = battery['heat_capacity_j_per_k'] / max(leakage.coefficient_w_per_k(FAST_MPS), 1e-9)
    if time_constant_s < LEAST_TIME_CONSTANT_S:
        problems.append(
            f'battery.heat_capacity_j_per_k: {battery["heat_capacity_j_per_k"]:g} J/K with a leakage '
            f'of {leakage.coefficient_w_per_k(FAST_MPS):g} W/K at {FAST_MPS:g} m/s is a battery that '
            f'cools within {time_constant_s:.1f} s; it must be at least '
            f'{LEAST_TIME_CONSTANT_S:g} s')

    def curve(key: str, formula: Callable[..., Curve]) -> Curve:
        node = battery[key]
        if 'formula' in node:
            return formula(**arguments_of(node['formula']))
        return read_table(f'battery.{key}.table', node['table'], problems)

    limits = battery['power_limits']
    open_circuit_voltage = curve('open_circuit_voltage', PolynomialVoltage)
    connection_ohm = float(battery.get('connection_resistance_ohm', 0.0))
    resistance = with_connections(curve('resistance', InverseTemperatureResistance), connection_ohm)
    discharge = read_table('battery.power_limits.discharge', limits['discharge'], problems)
    charge = read_table('battery.power_limits.charge', limits['charge'], problems)
    charging = read_charging(contents, charge, {source.name: source for source in heat_sources}, problems)
    if not problems:
        curves = [('battery.open_circuit_voltage', open_circuit_voltage, VOLTAGE_RANGE_V, 'V'),
                  ('battery.resistance', resistance, RESISTANCE_RANGE_OHM, 'ohm'),
                  ('battery.power_limits.discharge', discharge, DISCHARGE_RANGE_W, 'W'),
                  ('battery.power_limits.charge', charge, CHARGE_RANGE_W, 'W')]
        if charging is not None:
            curves.append(('charging.power_limit', charging.power_limit, CHARGE_RANGE_W, 'W'))
        for key, function, allowed, unit in curves:
            problems += _values_outside(key, function, _grid(battery, function), allowed, unit)
        problems += _voltage_that_falls(open_circuit_voltage, _grid(battery, open_circuit_voltage))
    if problems:
        raise InvalidInput([f'{path}: {problem}' for problem in problems])

    vehicle = Vehicle(
        name=contents['name'],
        battery=Battery(
            open_circuit_voltage=open_circuit_voltage,
            resistance=resistance,
            discharge_power_limit=discharge,
            charge_power_limit=charge,
            leakage=leakage,
            cells_in_series=battery.get('cells_in_series'),
            connection_resistance_ohm=connection_ohm,
            **arguments_of({key: battery[key] for key in BATTERY_NUMBERS})),
        drivetrain=Drivetrain(**arguments_of(drivetrain)),
        hvch=Hvch(**arguments_of(contents['hvch'])),
        defaults=Defaults(**arguments_of(contents['defaults'])),
        road_load=RoadLoad(**arguments_of(contents['road_load'])) if 'road_load' in contents else None,
        assumed=tuple(contents.get('assumed', ())),
        heat_path=path_of_heat,
        charging=charging,
        uncertainty=Uncertainty(**arguments_of(contents.get('uncertainty', {}))),
        heating_gates=gates,
        heat_sources=heat_sources)
    return with_shell(vehicle, **contents['thermal']) if 'thermal' in contents else vehicle


def heat_path_problems(path: HeatPath) -> Iterator[str]:
    """Yield a sentence for each implausible value of a HeatPath from a file."""
    if path.has_coolant == (path.coolant_conductance_w_per_k == 0.0):
        yield (f'heat_path: coolant_heat_capacity_j_per_k {path.coolant_heat_capacity_j_per_k:g} beside '
               f'coolant_conductance_w_per_k {path.coolant_conductance_w_per_k:g} is not allowed; both must be '
               'above 0, or both 0')
    elif path.coolant_lag_s > MOST_COOLANT_LAG_S:
        yield (f'heat_path.coolant_conductance_w_per_k: {path.coolant_conductance_w_per_k:g} W/K '
               f'take {path.coolant_lag_s:.0f} s for the heat of '
               f'{path.coolant_heat_capacity_j_per_k:g} J/K; it must be at most '
               f'{MOST_COOLANT_LAG_S:g} s')


def thermal_problems(thermal: dict[str, FileData], pack_j_per_k: float, path: HeatPath) -> Iterator[str]:
    """Yield a sentence for each implausible value of `thermal` from a file, for a pack [J/K] and a HeatPath."""
    if path.has_coolant:
        yield (f'heat_path.coolant_heat_capacity_j_per_k: {path.coolant_heat_capacity_j_per_k:g} J/K are not '
               'allowed beside thermal, whose shell includes the coolant; leave out both values of the coolant')
    share = thermal['shell_share']
    least_w_per_k = share * (1.0 - share) * pack_j_per_k / MOST_COOLANT_LAG_S
    if thermal['conductance_w_per_k'] < least_w_per_k:
        yield (f'thermal.conductance_w_per_k: {thermal["conductance_w_per_k"]:g} W/K is not allowed; it must be '
               f'at least {figure(least_w_per_k, 3)} W/K, for a time constant between shell and core of at most '
               f'{MOST_COOLANT_LAG_S:g} s')


def vehicle_file(name_or_file: str | Path) -> Path:
    """Return the path of a vehicle file; raise InvalidInput if it does not exist."""
    return find_configuration('vehicles', name_or_file, '.yaml')


def vehicle_contents(name_or_file: str | Path) -> bytes:
    """Return the bytes of the file of a loaded vehicle."""
    return vehicle_file(name_or_file).read_bytes()


def vehicle_fingerprint(contents: bytes) -> str:
    """Return the SHA-256 of a vehicle file's bytes, as text."""
    return sha256(contents).hexdigest()


def _keys_that_are_not_there(contents: dict[str, FileData]) -> Iterator[str]:
    """Yield a sentence for each entry of `assumed` that names no value of the file."""
    keys = _keys({name: node for name, node in contents.items() if name != 'assumed'})
    for index, key in enumerate(contents.get('assumed', ())):
        if key in keys:
            continue
        near = get_close_matches(key, keys, n=1)
        hint = f'did you mean {near[0]!r}?' if near else 'such as battery.resistance'
        yield f'assumed[{index}]: {quoted(key)} is not a key of this file; {hint}'


def _keys(node: dict[str, FileData], above: str = '') -> list[str]:
    """Return all keys of nested mappings, dotted, in order, including tables and formulas."""
    found = []
    for name, item in node.items():
        found.append(f'{above}{name}')
        if isinstance(item, dict):
            found += _keys(item, f'{above}{name}.')
    return found


def _grid(battery: dict[str, FileData], curve: Curve) -> tuple[FloatArray, FloatArray]:
    """Return points (soc, temperature) over the model's whole range, shape (n, m) each."""
    return np.meshgrid(_points(battery['soc_range'], getattr(curve, 'soc', ())),
                       _points(battery['temperature_range_c'],
                               getattr(curve, 'temperature_c', ())), indexing='ij')


def _points(limits: tuple[float, float], axis: Sequence[float]) -> FloatArray:
    # A table's extremes lie at its own points, which an even grid can miss.
    low, high = limits
    # A set, because numpy.unique imports numpy.ma, which no planner needs.
    return np.array(sorted({*np.linspace(low, high, 41).tolist(),
                            *(point for point in axis if low < point < high)}))


def _values_outside(key: str, curve: Curve, grid: tuple[FloatArray, FloatArray],
                    allowed: tuple[float, float], unit: str) -> Iterator[str]:
    soc, temperature_c = grid
    with np.errstate(all='ignore'):
        values = curve.function(ARRAYS)(soc, temperature_c) + np.zeros_like(soc)
        bad = ~((values >= allowed[0]) & (values <= allowed[1]))
    if bad.any():
        at = np.argmax(bad)
        yield (f'{key}: {figure_beyond(float(values.flat[at]), *allowed)} {unit} at soc {soc.flat[at]:g} and '
               f'{temperature_c.flat[at]:g} degC; it must be {figure(allowed[0])} ... {figure(allowed[1])} '
               f'{unit} over the whole soc_range and temperature_range_c')


def _voltage_that_falls(curve: Curve, grid: tuple[FloatArray, FloatArray]) -> Iterator[str]:
    soc, temperature_c = grid
    values = curve.function(ARRAYS)(soc, temperature_c) + np.zeros_like(soc)
    falling = np.diff(values, axis=0) < 0.0
    if falling.any():
        i, j = np.argwhere(falling)[0]
        yield (f'battery.open_circuit_voltage: falls from {values[i, j]:g} V at soc {soc[i, j]:g} '
               f'to {values[i + 1, j]:g} V at soc {soc[i + 1, j]:g}; it must not fall with soc')
