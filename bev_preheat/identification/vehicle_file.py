# SPDX-License-Identifier: Apache-2.0
"""The identified car: as a Vehicle, and as a vehicle file with a comment at each identified value."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.errors import figure
from bev_preheat.identification.curves import CorrectedVoltage, resistance_table, voltage_table
from bev_preheat.identification.parameters import NAMES
from bev_preheat.vehicle.description import Leakage
from bev_preheat.vehicle.writing import file_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.identification.fit import Fitter, ThermalFit
    from bev_preheat.identification.result import Estimated, Identification
    from bev_preheat.numerics.arithmetic import Curve
    from bev_preheat.vehicle.curves import Table
    from bev_preheat.vehicle.description import Vehicle

# Only the lag of the coolant can be identified. If START has no coolant, it gets a heat capacity with which the
# heater's full power makes it this much warmer than the battery [K].
COOLANT_EXCESS_K = 60.0
LEAST_LAG_S = 1.0


def values_of(fitter: Fitter, fit: ThermalFit) -> dict[str, float]:
    """Return the thermal parameters' values by name."""
    return {name: float(fitter.parameters[name].value(coordinate))
            for name, coordinate in zip(NAMES, fit.theta.tolist())}


def identified_vehicle(fitter: Fitter, fit: ThermalFit) -> Vehicle:
    """Return START with the values of a fit, as a vehicle file with them would be loaded."""
    vehicle, values, electrical = fitter.vehicle, values_of(fitter, fit), fit.electrical
    battery = vehicle.battery
    voltage: Curve = battery.open_circuit_voltage
    if electrical.used:
        voltage = voltage_table(CorrectedVoltage(voltage, *map(float, electrical.voltage_v)), battery.soc_range)
    path = vehicle.heat_path
    if _is_free(fit, 'heat_lag'):
        coolant = path.coolant_heat_capacity_j_per_k or (
            vehicle.hvch.efficiency * vehicle.hvch.maximum_power_w * values['heat_lag'] / COOLANT_EXCESS_K)
        path = replace(path, coolant_heat_capacity_j_per_k=coolant,
                       coolant_conductance_w_per_k=coolant / max(values['heat_lag'], LEAST_LAG_S))
    if _is_free(fit, 'sensor_lag'):
        path = replace(path, sensor_lag_s=values['sensor_lag'])
    losses = 1.0 - vehicle.drivetrain.efficiency
    share = min(values['drivetrain_heat'] / losses, 1.0) if losses > 0.0 else 0.0
    return replace(
        vehicle, heat_path=path, hvch=replace(vehicle.hvch, efficiency=values['heater_efficiency']),
        drivetrain=replace(vehicle.drivetrain, heat_recovery_efficiency=share),
        battery=replace(
            battery, capacity_ah=electrical.capacity_ah,
            heat_capacity_j_per_k=values['heat_capacity'] - path.coolant_heat_capacity_j_per_k,
            open_circuit_voltage=voltage, resistance=resistance_table(
                battery, fit.theta[len(NAMES):], electrical.soc_factors),
            leakage=Leakage(values['leakage'], values['leakage_with_speed'])))


def _is_free(fit: ThermalFit, name: str) -> bool:
    return bool(fit.free[NAMES.index(name)])


def identified_text(start: dict[str, FileData], vehicle: Vehicle, name: str, notes: Mapping[str, str],
                    identified: frozenset[str], head: str) -> str:
    """
    Return the text of a vehicle file: the contents of START's with the values of the identified `vehicle`.

    `notes` are comments by dotted key; keys that are `identified` leave the list `assumed`; `head` is the first
    comment.
    """
    contents = deepcopy(start)
    battery, path = vehicle.battery, vehicle.heat_path
    contents['name'] = name
    own = contents['battery']
    own['capacity_ah'] = _rounded(battery.capacity_ah)
    own['heat_capacity_j_per_k'] = _rounded(battery.heat_capacity_j_per_k)
    if 'battery.open_circuit_voltage' in notes:
        own['open_circuit_voltage'] = {'table': _table(battery.open_circuit_voltage)}
    # The identified resistance is that of the whole pack.
    own['resistance'] = {'table': _table(battery.resistance)}
    own.pop('connection_resistance_ohm', None)
    own['leakage'] = {'gamma_0_w_per_k': _rounded(battery.leakage.gamma_0_w_per_k),
                      'gamma_v_w_per_k_per_mps': _rounded(battery.leakage.gamma_v_w_per_k_per_mps)}
    contents['hvch']['efficiency'] = _rounded(vehicle.hvch.efficiency)
    contents['drivetrain']['heat_recovery_efficiency'] = _rounded(vehicle.drivetrain.heat_recovery_efficiency)
    lags = {key: _rounded(value) for key, value in vars(path).items() if value > 0.0}
    if lags:
        contents['heat_path'] = lags
    deviations = {key: value for key, value in vars(vehicle.uncertainty).items() if value is not None}
    contents.pop('uncertainty', None)
    if deviations:
        contents['uncertainty'] = deviations
    assumed = [key for key in contents.pop('assumed', [])
               if key != 'battery.connection_resistance_ohm'
               and not any(key == done or key.startswith(f'{done}.') for done in identified)]
    if assumed:
        contents['assumed'] = assumed
    return file_text(contents, notes, head)


def _table(curve: Table | Curve) -> dict[str, FileData]:
    """Return the Table as a vehicle file has it: axes of one point are left out."""
    soc, temperature_c, values = curve.soc, curve.temperature_c, curve.values  # type: ignore[union-attr]
    if len(soc) == 1:
        return {'temperature_c': list(temperature_c), 'values': list(values[0])}
    if len(temperature_c) == 1:
        return {'soc': list(soc), 'values': [row[0] for row in values]}
    return {'soc': list(soc), 'temperature_c': list(temperature_c), 'values': [list(row) for row in values]}


def _rounded(value: float) -> float:
    return float(f'{value:.5g}')


UNCERTAINTY_NOTE = 'relative standard deviations of the values above, from which the estimation starts'


def notes_of(result: Identification) -> dict[str, str]:
    """Return the comments of the identified file by dotted key."""
    notes = {item.key: _note(item, *_in_the_file(item, result.vehicle)) for item in result.estimates if item.key}
    low_c, high_c = result.coverage.resistance_from_c, result.coverage.resistance_to_c
    if result.electrical.used:
        notes['battery.open_circuit_voltage'] = (
            f'identified between soc {result.coverage.soc[0]:.2f} and {result.coverage.soc[1]:.2f}; '
            f'extrapolated beyond')
        notes['battery.resistance'] = ('identified on one log' if low_c is None or high_c is None else
                                       f'identified between {low_c:g} and {high_c:g} degC; extrapolated beyond')
    leakage = [notes.pop(key) for key in (
        'battery.leakage.gamma_0_w_per_k', 'battery.leakage.gamma_v_w_per_k_per_mps') if key in notes]
    notes['battery.leakage'] = '; with speed: '.join(leakage)
    notes['uncertainty'] = UNCERTAINTY_NOTE
    return notes


def identified_keys(result: Identification) -> frozenset[str]:
    """Return the dotted keys of the file whose values were identified."""
    keys = {item.key for item in result.estimates if item.is_identified and item.key}
    if result.electrical.used:
        keys |= {'battery.open_circuit_voltage', 'battery.resistance'}
    if 'battery.leakage.gamma_0_w_per_k' in keys:
        keys.add('battery.leakage')
    return frozenset(keys)


def _in_the_file(item: Estimated, vehicle: Vehicle) -> tuple[float, float, str]:
    """Return the interval of an estimate as that of the file's value at its key, and the unit."""
    coolant_j_per_k = vehicle.heat_path.coolant_heat_capacity_j_per_k
    losses = 1.0 - vehicle.drivetrain.efficiency
    if item.name == 'heat_capacity':
        return item.low - coolant_j_per_k, item.high - coolant_j_per_k, item.unit
    if item.name == 'drivetrain_heat' and losses > 0.0:
        return min(item.low / losses, 1.0), min(item.high / losses, 1.0), ''
    if item.name == 'heat_lag':
        low, high = (coolant_j_per_k / max(lag_s, LEAST_LAG_S) for lag_s in (item.high, item.low))
        return low, high, 'W/K'
    return item.low, item.high, item.unit


def _note(item: Estimated, low: float, high: float, unit: str) -> str:
    if not item.is_identified:
        return "START's value: the logs do not tell it"
    return f'identified, 90 % interval {figure(low, 4)} ... {figure(high, 4)} {unit}'.rstrip()
