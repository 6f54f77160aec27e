# SPDX-License-Identifier: Apache-2.0
"""The identified car, and values that the planner learned on line: as a Vehicle and as a vehicle file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, replace
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.estimation.estimate import nominal_heat_lag_s
from bev_preheat.estimation.prior import Learned, prior_factor_covariance
from bev_preheat.estimation.state_file import LAG_NAMES, load_state, REMEMBERED
from bev_preheat.estimation.state_file import NAMES as FACTOR_NAMES
from bev_preheat.identification.curves import CorrectedVoltage, KNOTS_C, KNOTS_SOC, resistance_table, voltage_table
from bev_preheat.identification.parameters import NAMES, STRUCTURES
from bev_preheat.identification.uncertainty import MOST_OF_PRIOR, QUANTILE, with_deviations
from bev_preheat.tunables import NOMINAL_SENSOR_LAG_S
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import HeatPath, HeatSource, Leakage, Vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, with_heat, with_shell
from bev_preheat.vehicle.writing import file_text

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.identification.fit import Fitter, ThermalFit
    from bev_preheat.identification.result import Estimated, Identification
    from bev_preheat.numerics import Curve

# Only the lag of the coolant can be identified. If START has no coolant, it gets a heat capacity with which the
# heater's full power makes it this much warmer than the battery [K].
COOLANT_EXCESS_K = 60.0
LEAST_LAG_S = 1.0


def identified_vehicle(fitter: Fitter, fit: ThermalFit) -> Vehicle:
    """Return START with the values of a fit, as a vehicle file with them would be loaded."""
    vehicle, battery, electrical = fitter.vehicle, fitter.vehicle.battery, fit.electrical
    values = {name: float(fitter.parameters[name].value(coordinate))
              for name, coordinate in zip(NAMES, fit.theta.tolist())}
    is_free = dict(zip(NAMES, fit.free.tolist()))
    voltage: Curve = battery.open_circuit_voltage
    if electrical.used:
        voltage = voltage_table(CorrectedVoltage(voltage, *map(float, electrical.voltage_v)), battery.soc_range)
    path, structure = vehicle.heat_path, STRUCTURES[fit.structure]
    if path.is_shell or structure.has_shell:
        path = HeatPath(path.heater_lag_s, sensor_lag_s=path.sensor_lag_s)
    if is_free['heat_lag']:
        coolant = path.coolant_heat_capacity_j_per_k or (
            vehicle.hvch.efficiency * vehicle.hvch.maximum_power_w * values['heat_lag'] / COOLANT_EXCESS_K)
        path = replace(path, coolant_heat_capacity_j_per_k=coolant,
                       coolant_conductance_w_per_k=coolant / max(values['heat_lag'], LEAST_LAG_S))
    if is_free['sensor_lag']:
        path = replace(path, sensor_lag_s=values['sensor_lag'])
    losses = 1.0 - vehicle.drivetrain.efficiency
    share = min(values['drivetrain_heat'] / losses, 1.0) if losses > 0.0 else 0.0
    found = replace(
        vehicle, heat_path=path, hvch=replace(vehicle.hvch, efficiency=values['heater_efficiency']),
        # The HVCH's efficiency tells nothing about the heat of others.
        heat_sources=tuple(with_heat(source, vehicle.hvch.efficiency / values['heater_efficiency'])
                           for source in vehicle.heat_sources),
        drivetrain=replace(vehicle.drivetrain, heat_recovery_efficiency=share),
        battery=replace(
            battery, capacity_ah=electrical.capacity_ah,
            heat_capacity_j_per_k=values['heat_capacity'] - path.coolant_heat_capacity_j_per_k,
            open_circuit_voltage=voltage, resistance=resistance_table(
                battery, fit.theta[len(NAMES):], electrical.soc_factors),
            leakage=Leakage(values['leakage'], values['leakage_with_speed'])))
    return found if not structure.has_shell else with_shell(
        found, values['shell_share'], values['shell_conductance'], structure.sensor)


def identified_text(start: dict[str, FileData], vehicle: Vehicle, notes: Mapping[str, str],
                    identified: frozenset[str], head: str) -> str:
    """
    Return the text of a vehicle file: the contents of START's with the values of the identified `vehicle`.

    `notes` are comments by dotted key; keys that are `identified` leave the list `assumed`; `head` is the first
    comment.
    """
    contents = deepcopy(start)
    battery, path = vehicle.battery, vehicle.heat_path
    contents['name'] = vehicle.name
    own = contents['battery']
    own['capacity_ah'] = _rounded(battery.capacity_ah)
    own['heat_capacity_j_per_k'] = _rounded(vehicle.pack_heat_capacity_j_per_k)
    if 'battery.open_circuit_voltage' in notes:
        own['open_circuit_voltage'] = {'table': _table(battery.open_circuit_voltage)}
    # The identified resistance is that of the whole pack.
    own['resistance'] = {'table': _table(battery.resistance)}
    own.pop('connection_resistance_ohm', None)
    own['leakage'] = {'gamma_0_w_per_k': _rounded(battery.leakage.gamma_0_w_per_k),
                      'gamma_v_w_per_k_per_mps': _rounded(battery.leakage.gamma_v_w_per_k_per_mps)}
    contents['hvch']['efficiency'] = _rounded(vehicle.hvch.efficiency)
    for source in vehicle.heat_sources:
        contents['heat_sources'][source.name]['heat_per_watt'] = _heat_per_watt(source, vehicle.hvch.efficiency)
    contents['drivetrain']['heat_recovery_efficiency'] = _rounded(vehicle.drivetrain.heat_recovery_efficiency)
    lags = {key: _rounded(value) for key, value in asdict(path).items()
            if value > 0.0 and (not path.is_shell or key in ('heater_lag_s', 'sensor_lag_s'))}
    thermal = {} if not path.is_shell else {
        'shell_share': _rounded(path.shell_share),
        'conductance_w_per_k': _rounded(path.coolant_conductance_w_per_k), 'sensor': path.sensor_place}
    deviations = {key: value for key, value in vars(vehicle.uncertainty).items() if value is not None}
    for key, values in (('heat_path', lags), ('thermal', thermal), ('uncertainty', deviations)):
        contents.pop(key, None)
        if values:
            contents[key] = values
    assumed = [key for key in contents.pop('assumed', [])
               if key != 'battery.connection_resistance_ohm'
               and not any(key == done or key.startswith(f'{done}.') for done in identified)]
    if path.is_shell and 'thermal' not in start:
        assumed += sorted(key for key in notes if key.startswith('thermal.') and key not in identified)
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


def _heat_per_watt(source: HeatSource, efficiency: float) -> FileData:
    """Return the heat per watt of a HeatSource beside an HVCH with an efficiency, as a vehicle file has it."""
    assert isinstance(source.hvch_watts, Table)
    heat = source.hvch_watts.changed(lambda hvch_watts: _rounded(efficiency * hvch_watts))
    return heat.values[0][0] if len(heat.soc) == len(heat.temperature_c) == 1 else {
        'ambient_c' if key == 'soc' else key: value for key, value in _table(heat).items()}


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
    path = vehicle.heat_path
    coolant_j_per_k = 0.0 if path.is_shell else path.coolant_heat_capacity_j_per_k
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
        return "the logs do not tell it: START's value, or the prior's"
    return f'identified, 90 % interval {figure(low, 4)} ... {figure(high, 4)} {unit}'.rstrip()


# Keys of the vehicle file that each learned factor changes, in the order of `estimation.state_file.NAMES`.
KEYS = ('battery.heat_capacity_j_per_k', 'battery.leakage', 'battery.resistance', 'hvch.efficiency',
        'heat_sources')


class LearnedVehicle(NamedTuple):
    """A Vehicle with learned values, rows (name, factor, low, high) of 90 % intervals, comments by dotted key."""

    vehicle: Vehicle
    rows: tuple[tuple[str, float, float, float], ...]
    notes: dict[str, str]


def learned_vehicle(vehicle: Vehicle, fingerprint: str, state_file: AnyPath, name: str) -> LearnedVehicle:
    """Return the LearnedVehicle of a state file for a vehicle file; raise InvalidInput if it learned nothing."""
    recalled = load_state(state_file, fingerprint)
    learned = recalled.learned
    if learned is None:
        raise InvalidInput(f'--state-file: {state_file}: nothing learned about this vehicle file'
                           + (f' ({recalled.damage})' if recalled.damage else '')
                           + '; name the file with which the planner ran')
    own = REMEMBERED if vehicle.heat_sources else REMEMBERED[:-1]
    factors = np.exp(learned.factors[own]).tolist()
    spreads = np.exp(QUANTILE * np.sqrt(np.diag(learned.covariance)[own])).tolist()
    rows = [(factor_name.replace('_', ' '), factor, factor / spread, factor * spread)
            for factor_name, factor, spread in zip(FACTOR_NAMES, factors, spreads)]
    notes = {key: f"learned on line: {figure(factor, 4)} times START's, 90 % interval "
                  f'{figure(low, 4)} ... {figure(high, 4)}{", beside hvch.efficiency" * (key == KEYS[-1])}'
             for key, (_, factor, low, high) in zip(KEYS, rows)}
    if learned.lags is not None:
        nominal_s = np.array([nominal_heat_lag_s(vehicle.heat_path), NOMINAL_SENSOR_LAG_S])
        lags_s = (nominal_s * np.exp(learned.lags.logs)).tolist()
        spreads_s = np.exp(QUANTILE * np.sqrt(learned.lags.variances)).tolist()
        rows += [(f'{lag_name} lag [s]', lag_s, lag_s / spread, lag_s * spread)
                 for lag_name, lag_s, spread in zip(LAG_NAMES, lags_s, spreads_s)]
    car = corrected_vehicle(vehicle, Corrections(*factors))
    log_resistance = np.full(len(KNOTS_C), math.log(factors[2]))
    efficiency = min(car.hvch.efficiency, 1.0)
    car = replace(car, name=name, battery=replace(
        car.battery, resistance=resistance_table(vehicle.battery, log_resistance, np.zeros(len(KNOTS_SOC)))),
        hvch=replace(car.hvch, efficiency=efficiency),
        heat_sources=tuple(with_heat(each, car.hvch.efficiency / efficiency) for each in car.heat_sources),
        uncertainty=with_deviations(vehicle.uncertainty, _narrower(learned, own)))
    notes['uncertainty'] = UNCERTAINTY_NOTE
    return LearnedVehicle(car, tuple(rows), notes)


def _narrower(learned: Learned, own: Sequence[int]) -> dict[str, float]:
    """Return the standard deviations by factor that are narrower than without any drive; `own` are the car's."""
    variances, prior = (np.diag(each)[own] for each in (learned.covariance, prior_factor_covariance()))
    return {name: math.sqrt(variance) for name, variance, most in zip(FACTOR_NAMES, variances, prior)
            if variance < MOST_OF_PRIOR**2 * most}
