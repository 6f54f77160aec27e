# SPDX-License-Identifier: Apache-2.0
"""Key figures of a vehicle file, for comparison with a real car, and warnings about unusual and assumed ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
from pathlib import Path
import re
import shlex
from types import SimpleNamespace
from typing import Any

import numpy as np

from bev_preheat.numerics import ARRAYS, FLOATS, S_PER_H, W_PER_KW, WH_PER_KWH
from bev_preheat.vehicle.charging import charging_in_words, session_charging
from bev_preheat.vehicle.description import Battery, Vehicle

JOULES_PER_KJ = 1000.0
KMH_100_MPS = 100.0 / 3.6
TEN_MINUTES_S = 600.0
COLD_C, WARM_C = -20.0, 25.0
RESISTANCE_TEMPERATURES_C = (COLD_C, 0.0, WARM_C)
CHARGING_TEMPERATURES_C = (-10.0, 0.0, 10.0, 25.0, 40.0)
CHARGING_SOCS = (0.2, 0.5, 0.8)
# Charging powers of warm and cold batteries are compared at these.
COMPARED_SOCS = (0.2, 0.5)
VOLTAGE_SOCS = (0.0, 0.1, 0.2, 0.5, 0.8, 0.9, 1.0)
# The situation for the heating figures: a cold battery on a cold day.
HEATED_FROM_C, AMBIENT_C = 0.0, -10.0

# Usual ranges for electric cars, vans, trucks and buses (low, high).
ENERGY_KWH = (5.0, 1000.0)
CELL_VOLTAGE_V = (2.5, 4.3)
HEAT_CAPACITY_KJ_PER_K_KWH = (3.0, 13.0)
TIME_CONSTANT_H = (0.5, 40.0)
HEATING_K_PER_10_MIN = (1.0, 40.0)
# Voltage drop at the one-hour current, as a share of the voltage.
ONE_HOUR_DROP = (0.005, 0.10)
COLD_RESISTANCE_RATIO = (1.3, 15.0)
CHARGING_PER_H = (0.15, 6.0)
# At -10 degC a battery accepts and delivers clearly less than at 25 degC.
MOST_COLD_CHARGING_SHARE = 0.5
LEAST_DISCHARGE_SHARE = 0.8
FAST_LEAKAGE_RATIO = 8.0


class Meaning(SimpleNamespace):
    """
    Key figures of one car, as attributes; resistance at half charge, heating from 0 degC at -10 degC outside.

    `resistance_ohm` is by temperature [degC], `charging_power_kw` (of the map that charging sessions use) by
    temperature, then by state of charge; `discharging_power_kw` at half charge by temperature,
    `open_circuit_voltage_v` at 25 degC by state of charge. `heating_…` are K in the first 10 min: full heater
    power at rest and at 100 km/h, and the heater power left by the vehicle's default cabin heating.
    `heat_path` and `charging` describe the arrival of heat and the car at a charger as text, `warnings` has a
    sentence for each unusual figure.
    """

    def as_dictionary(self) -> dict[str, Any]:
        """Return the figures in JSON form: text keys, lists."""
        return {name: _in_json(value) for name, value in vars(self).items()}


def _in_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {f'{key:g}': _in_json(item) for key, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def meaning_of(vehicle: Vehicle) -> Meaning:
    """Return the Meaning of a Vehicle."""
    battery, heater = vehicle.battery, vehicle.hvch
    energy_kwh = energy_between_kwh(vehicle, *battery.soc_range)
    # Mean voltage (energy over charge) over the usable range.
    nominal_v = WH_PER_KWH * energy_kwh / (battery.capacity_ah * (battery.soc_range[1] - battery.soc_range[0]))
    resistance = battery.resistance.function(FLOATS)
    # A formula may be invalid outside the file's range.
    low_c, high_c = battery.temperature_range_c
    warm_c = min(max(WARM_C, low_c), high_c)
    fast_limit = session_charging(vehicle).power_limit
    grid = np.meshgrid(np.linspace(*battery.soc_range, 41), np.linspace(*battery.temperature_range_c, 41))
    charging = fast_limit.function(FLOATS)
    discharging = battery.discharge_power_limit.function(FLOATS)
    voltage_v = battery.open_circuit_voltage.function(FLOATS)
    at_rest, fast = (battery.leakage.coefficient_w_per_k(speed) for speed in (0.0, KMH_100_MPS))
    all_w, left_w = heater.maximum_power_w, max(
        heater.maximum_power_w - vehicle.defaults.cabin_heating_power_w, 0.0)
    heat_capacity_kj = vehicle.pack_heat_capacity_j_per_k / JOULES_PER_KJ
    meaning = Meaning(
        name=vehicle.name,
        energy_kwh=energy_kwh,
        nominal_voltage_v=nominal_v,
        cells_in_series=battery.cells_in_series,
        capacity_ah=battery.capacity_ah,
        heat_capacity_kj_per_k=heat_capacity_kj,
        heat_capacity_kj_per_k_kwh=heat_capacity_kj / energy_kwh,
        resistance_ohm={
            at_c: resistance(0.5, at_c) for at_c in RESISTANCE_TEMPERATURES_C if low_c <= at_c <= high_c},
        one_hour_drop=resistance(0.5, warm_c) * battery.capacity_ah / nominal_v,
        time_constant_h=_time_constant_h(vehicle, 0.0),
        time_constant_at_100_kmh_h=_time_constant_h(vehicle, KMH_100_MPS),
        heater_power_kw=all_w / W_PER_KW,
        heating_at_rest_k_per_10_min=warmed_by_k(vehicle, all_w, at_rest),
        heating_at_100_kmh_k_per_10_min=warmed_by_k(vehicle, all_w, fast),
        heating_beside_cabin_k_per_10_min=warmed_by_k(vehicle, left_w, fast),
        charging_power_kw={
            at_c: {soc: abs(charging(soc, at_c)) / W_PER_KW for soc in CHARGING_SOCS}
            for at_c in CHARGING_TEMPERATURES_C},
        most_charging_power_kw=-float(fast_limit.function(ARRAYS)(*grid).min()) / W_PER_KW,
        discharging_power_kw={at_c: discharging(0.5, at_c) / W_PER_KW for at_c in CHARGING_TEMPERATURES_C},
        open_circuit_voltage_v={soc: voltage_v(soc, warm_c) for soc in VOLTAGE_SOCS},
        heat_path=heat_path_in_words(vehicle),
        charging=charging_in_words(vehicle),
        assumed=vehicle.assumed)
    meaning.warnings = tuple(_unusual(vehicle, meaning))
    return meaning


def heat_path_in_words(vehicle: Vehicle) -> str:
    """Return a sentence on the lags of heat and sensor, and on the heat lost after arrival."""
    path = vehicle.heat_path
    if path.is_direct and path.sensor_lag_s == 0.0:
        return 'The heat of the heater arrives at once, and the sensor shows it.'
    parts = []
    if path.is_direct:
        parts.append('the heat of the heater arrives at once')
    if path.heater_lag_s > 0.0:
        parts.append(f'the heater follows its command with a time constant of {path.heater_lag_s:.0f} s')
    heat_w = vehicle.hvch.efficiency * vehicle.hvch.maximum_power_w
    if path.is_shell:
        excess_k = (1.0 - path.shell_share) * heat_w / path.coolant_conductance_w_per_k
        parts.append(
            f'the shell, with {100.0 * path.shell_share:.0f} % of the heat capacity, gets {excess_k:.1f} K warmer '
            f'than the core at full heater power, with a time constant of {path.coolant_lag_s:.0f} s; plans are '
            'for the core')
    elif path.has_coolant:
        parts.append(
            f'the coolant passes its heat on with a time constant of {path.coolant_lag_s:.0f} s and gets '
            f'{heat_w / path.coolant_conductance_w_per_k:.0f} K warmer than the battery at full '
            'heater power')
    if not path.is_direct:
        late_wh = path.heat_lag_s * vehicle.hvch.maximum_power_w / S_PER_H
        parts.append(f'{late_wh:.0f} Wh are still under way when the heater is switched off at full '
                     'power; heat that arrives after the drive is lost')
    if path.sensor_lag_s > 0.0:
        parts.append(f'the sensor follows the battery with a time constant of {path.sensor_lag_s:.0f} s')
    text = '; '.join(parts)
    return f'{text[0].upper()}{text[1:]}.'


def energy_between_kwh(vehicle: Vehicle, low_soc: float, high_soc: float, temperature_c: float = 25.0) -> float:
    """Energy of the open-circuit voltage [kWh] between two states of charge: integral of U dQ."""
    battery = vehicle.battery
    # Midpoints of a fine grid: relative error 1e-5 for tables and formulas alike.
    edges = np.linspace(low_soc, high_soc, 4001)
    middles = 0.5 * (edges[1:] + edges[:-1])
    voltage_v = battery.open_circuit_voltage.function(ARRAYS)(
        middles, np.full_like(middles, temperature_c)) + np.zeros_like(middles)
    return float(voltage_v.mean() * battery.capacity_ah * (high_soc - low_soc) / WH_PER_KWH)


def warmed_by_k(vehicle: Vehicle, heater_w: float, leakage_w_per_k: float, from_c: float = HEATED_FROM_C,
                duration_s: float = TEN_MINUTES_S) -> float:
    """
    Return the temperature rise of the battery [K] at constant heater power [W] and leakage [W/K], at AMBIENT_C.

    Eq. (3) without Joule and drivetrain heat, in closed form: an exponential approach to the temperature at
    which the leakage equals the heat.
    """
    capacity = vehicle.pack_heat_capacity_j_per_k
    heat_w = vehicle.hvch.efficiency * heater_w
    initial_w = heat_w - leakage_w_per_k * (from_c - AMBIENT_C)
    decays = leakage_w_per_k * duration_s / capacity
    # The smallest leakages are 0 here.
    return initial_w * duration_s / capacity * (-math.expm1(-decays) / decays if decays else 1.0)


def _time_constant_h(vehicle: Vehicle, speed_mps: float) -> float:
    """Return the thermal time constant [h]; infinite without leakage."""
    leakage = vehicle.battery.leakage.coefficient_w_per_k(speed_mps)
    return math.inf if leakage == 0.0 else (vehicle.pack_heat_capacity_j_per_k / leakage / S_PER_H)


def _unusual(vehicle: Vehicle, meaning: Meaning) -> Iterator[str]:
    """Yield a sentence for each unusual figure."""
    battery, energy_kwh = vehicle.battery, meaning.energy_kwh
    yield from _outside('energy', energy_kwh, 'kWh', ENERGY_KWH, 'capacity_ah times the open-circuit voltage')
    yield from _cell_voltages(battery)
    yield from _outside('heat capacity', meaning.heat_capacity_kj_per_k_kwh, 'kJ/K for each kWh',
                        HEAT_CAPACITY_KJ_PER_K_KWH, 'about 1 kJ/(kg K) times the mass of the pack')
    yield from _outside('voltage drop at the one-hour current', 100.0 * meaning.one_hour_drop,
                        '% at 25 degC', tuple(100.0 * share for share in ONE_HOUR_DROP),
                        'resistance in ohm, of the whole pack')
    yield from _resistance_over_temperature(battery, meaning)
    yield from _outside('thermal time constant at rest', meaning.time_constant_h, 'h',
                        TIME_CONSTANT_H, 'heat capacity over leakage')
    at_rest, fast = (battery.leakage.coefficient_w_per_k(speed) for speed in (0.0, KMH_100_MPS))
    if fast > FAST_LEAKAGE_RATIO * at_rest:
        yield (f'leakage: {fast:.0f} W/K at 100 km/h is more than {FAST_LEAKAGE_RATIO:g} times '
               f'the {at_rest:.0f} W/K at rest; is gamma_v_w_per_k_per_mps per km/h?')
    if vehicle.hvch.maximum_power_w > 0.0:
        yield from _outside('heating', meaning.heating_at_rest_k_per_10_min,
                            'K in 10 min at full heater power', HEATING_K_PER_10_MIN,
                            'heater power in W over heat capacity')
    yield from _charging(meaning)
    yield from _discharging(vehicle)


def _outside(what: str, value: float, unit: str, usual: Sequence[float], hint: str) -> Iterator[str]:
    low, high = usual
    if not low <= value <= high:
        yield f'{what}: {value:.3g} {unit}; the usual range is {low:g} ... {high:g} ({hint})'


def _cell_voltages(battery: Battery) -> Iterator[str]:
    if battery.cells_in_series is None:
        return
    low, high = CELL_VOLTAGE_V
    for soc in battery.soc_range:
        cell_v = (battery.open_circuit_voltage.function(FLOATS)(soc, 25.0) / battery.cells_in_series)
        if not low <= cell_v <= high:
            yield (f'open-circuit voltage: {cell_v:.2f} V a cell at soc {soc:g} with '
                   f'{battery.cells_in_series} cells in series; the usual range is {low:g} ... {high:g} V')


def _resistance_over_temperature(battery: Battery, meaning: Meaning) -> Iterator[str]:
    temperatures_c = np.linspace(max(-30.0, battery.temperature_range_c[0]),
                                 min(40.0, battery.temperature_range_c[1]), 71)
    resistances = battery.resistance.function(ARRAYS)(
        np.full_like(temperatures_c, 0.5), temperatures_c) + np.zeros_like(temperatures_c)
    rising = np.diff(resistances) > 1e-9 * resistances[:-1]
    if rising.any():
        at = int(np.argmax(rising))
        yield (f'resistance: rises from {resistances[at]:.3g} ohm at {temperatures_c[at]:.0f} degC '
               f'to {resistances[at + 1]:.3g} ohm at {temperatures_c[at + 1]:.0f} degC; battery '
               'resistance falls with temperature')
        return
    by_temperature = meaning.resistance_ohm
    if COLD_C in by_temperature and WARM_C in by_temperature:
        yield from _outside('resistance at -20 degC',
                            by_temperature[COLD_C] / by_temperature[WARM_C],
                            'times that at 25 degC', COLD_RESISTANCE_RATIO,
                            'cold batteries have several times that value')


def _charging(meaning: Meaning) -> Iterator[str]:
    most_kw, energy_kwh = meaning.most_charging_power_kw, meaning.energy_kwh
    yield from _outside('charge limit', most_kw / energy_kwh,
                        f'kW for each kWh (at most {most_kw:.0f} kW)', CHARGING_PER_H,
                        'power in W, negative')
    charging = meaning.charging_power_kw
    for soc in COMPARED_SOCS:
        cold_kw, warm_kw = charging[-10.0][soc], charging[25.0][soc]
        if cold_kw > MOST_COLD_CHARGING_SHARE * warm_kw:
            yield (f'charge limit: {cold_kw:.0f} kW at -10 degC and soc {soc:g}, but '
                   f'{warm_kw:.0f} kW at 25 degC; cold batteries usually accept less than '
                   f'{100 * MOST_COLD_CHARGING_SHARE:.0f} %; otherwise preheating gains little')


def _discharging(vehicle: Vehicle) -> Iterator[str]:
    limit_w = vehicle.battery.discharge_power_limit.function(FLOATS)(0.8, 25.0)
    if limit_w < LEAST_DISCHARGE_SHARE * vehicle.drivetrain.maximum_power_w:
        yield (f'discharge limit: {limit_w / W_PER_KW:.0f} kW at 25 degC and soc 0.8 for a '
               f'drivetrain of {vehicle.drivetrain.maximum_power_w / W_PER_KW:.0f} kW; a warm '
               'battery usually delivers the full drivetrain power')


# Unit suffixes of keys, left out in sentences.
_UNIT = re.compile(r'_(ah|j_per_k|ohm|w|c|kg|m2)$')
_WORDS = {'hvch': 'HVCH', 'soc': 'state-of-charge', 'defaults': 'default'}


def key_in_words(key: str) -> str:
    """Return a vehicle file's key as text: battery.heat_capacity_j_per_k becomes battery heat capacity."""
    words = ' '.join(_UNIT.sub('', part) for part in key.split('.')).replace('_', ' ')
    return ' '.join(_WORDS.get(word, word) for word in words.split(' '))


def assumed_in_words(vehicle: Vehicle) -> str:
    """Return the assumed keys of a Vehicle as one text, '' without any."""
    return ', '.join(map(key_in_words, vehicle.assumed))


def assumption_warning(vehicle: Vehicle, file: str | Path) -> str | None:
    """Return the warning about plans with assumed values, None without any."""
    count = len(vehicle.assumed)
    if not count:
        return None
    values = 'value is' if count == 1 else 'values are'
    return (f'vehicle {vehicle.name}: {count} {values} assumed, not measured; preheat vehicle check '
            f'{shlex.quote(str(file))} lists them')
