# SPDX-License-Identifier: Apache-2.0
"""
A car from its data sheet: each value of a vehicle file, with its source.

Values missing from the data sheet come from `chemistry.yaml` or are assumed here, and marked so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bev_preheat.files.checked_yaml import FileData
from bev_preheat.numerics import FloatArray, W_PER_KW, WH_PER_KWH
from bev_preheat.vehicle.charging_curve import (
    charging_map,
    ChargingCurve,
    class_curve,
    CURVE_TEMPERATURES_C,
    HIGH_VOLTAGE_V,
    WARM_CURVE_C,
)
from bev_preheat.vehicle.chemistry import Chemistry, load_chemistry
from bev_preheat.vehicle.data_sheet import check_data_sheet, DataSheet, energy_of

# A pack is cells, housing, wiring and coolant; the rest is mostly aluminium.
CELL_SHARE_OF_PACK_MASS = 0.7
HOUSING_HEAT_CAPACITY_J_PER_KG_K = 900.0
# A flat pack under the floor: 1.82 m x 1.45 m x 0.14 m at about 500 kg; its area is proportional to its mass.
SURFACE_M2_PER_KG = 6.2 / 493.0
# Parked packs are insulated; while driving, coolant and air carry heat away (docs/reference/vehicles.md).
LEAKAGE_AT_REST_W_PER_M2_K = 1.8
LEAKAGE_PER_SPEED_W_PER_M2_K_PER_MPS = 0.33
LEAKAGE_SOURCE = (
    'parked packs keep warm: a compact car over a night 1.4 to 2.6 W/(m2 K), a large saloon below 1 (both '
    'measured; docs/reference/vehicles.md), a saloon 12 K above the air after 10 h at -32 degC, about 2 '
    '(insideevs.com, "A Tesla Model 3 Sat Overnight At -33F"); while driving, the warming that owners '
    'report means 9 W/(m2 K) at 80 km/h (python3 -m bev_preheat_studies published)')
DRIVE_KW_PER_KWH = 2.0
REGENERATION_SHARE = 0.6
# Battery power over drivetrain power; heater and auxiliaries are added.
DISCHARGE_RESERVE = 1.1
HEATER_KW = 6.0
MOST_CABIN_KW, CABIN_SHARE = 1.5, 0.3
AUXILIARY_KW = 0.4
USUAL_TARGET_C = 25.0
DRIVETRAIN_EFFICIENCY, HEAT_RECOVERY, HEATER_EFFICIENCY = 0.9, 0.5, 0.87
FRONTAL_AREA_M2, DRAG_COEFFICIENT, ROLLING_RESISTANCE = 2.4, 0.29, 0.010
# Resistance of busbars, contactors and connectors over that of the cells at 25 degC.
CONNECTION_SHARE = 0.1
# Displayed states of charge in the tables.
VOLTAGE_SOC = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
RESISTANCE_SOC = (0.0, 0.05, 0.1, 0.2, 0.5, 1.0)


@dataclass(frozen=True)
class Entry:
    """A value of a vehicle file, its source, and whether it is assumed."""

    value: FileData
    note: str
    assumed: bool = False


@dataclass(frozen=True)
class Pack:
    """Battery figures derived from the data sheet."""

    cells_in_series: int
    gross_energy_kwh: float
    mass_kg: float
    # Cell state of charge at a displayed state of charge of 0 and 1.
    cell_soc: tuple[float, float]
    capacity_ah: float

    @property
    def cell_capacity_ah(self) -> float:
        """Capacity of all cells in parallel [Ah], from empty to full."""
        return self.capacity_ah / (self.cell_soc[1] - self.cell_soc[0])

    def cell_soc_at(self, soc: Sequence[float]) -> FloatArray:
        """Return the cell state of charge at a displayed one; shape follows the input."""
        low, high = self.cell_soc
        return low + (high - low) * np.asarray(soc)


def describe_car(sheet: DataSheet, curve_fit: float = 1.0) -> dict[str, Entry]:
    """
    Return the entries of a vehicle file by key, for a DataSheet.

    `curve_fit` fits the charging curve to the published time; `charging.published_time` finds it, because only a
    session gives the time of a curve. Raises InvalidInput if the data sheet is implausible.
    """
    check_data_sheet(sheet)
    return {**_battery(sheet), **_drivetrain(sheet), **_heater(sheet), **_charging(sheet, curve_fit),
            **_road_load(sheet)}


def curves_of(sheet: DataSheet, curve_fit: float = 1.0) -> tuple[ChargingCurve, ...]:
    """Return the curves of a checked DataSheet times `curve_fit`, else that of the car's class with that fit."""
    if sheet.charging_curves:
        return tuple(replace(curve, power_kw=tuple(curve_fit * power_kw for power_kw in curve.power_kw))
                     for curve in sheet.charging_curves)
    chemistry = load_chemistry(sheet.chemistry)
    pack, _ = _pack(sheet, chemistry)
    return (class_curve(chemistry, pack.cells_in_series * chemistry.nominal_cell_voltage_v, pack.gross_energy_kwh,
                        sheet.charging_power_kw, curve_fit),)


def _battery(sheet: DataSheet) -> dict[str, Entry]:
    chemistry = load_chemistry(sheet.chemistry)
    pack, notes = _pack(sheet, chemistry)
    heat_capacity = (CELL_SHARE_OF_PACK_MASS * chemistry.cell_heat_capacity_j_per_kg_k
                     + (1.0 - CELL_SHARE_OF_PACK_MASS) * HOUSING_HEAT_CAPACITY_J_PER_KG_K)
    surface_m2 = SURFACE_M2_PER_KG * pack.mass_kg
    return {
        'battery.capacity_ah': Entry(
            pack.capacity_ah, f'{notes["energy"]}, over the mean open-circuit voltage below',
            assumed=sheet.usable_energy_kwh is None or _is_guessed(sheet, 'usable_energy_kwh')),
        'battery.cells_in_series': Entry(
            pack.cells_in_series, notes['cells'],
            assumed=_is_guessed(sheet, 'cells_in_series') or _is_guessed(sheet, 'nominal_voltage_v')),
        'battery.heat_capacity_j_per_k': _assumed(
            round(heat_capacity * pack.mass_kg, -2),
            f'{heat_capacity:.0f} J/(kg K) times {notes["mass"]}; cells '
            f'{chemistry.cell_heat_capacity_j_per_kg_k:g} J/(kg K) (source: {chemistry.cell_heat_capacity_source})'
            f', {CELL_SHARE_OF_PACK_MASS:.0%} of the mass (assumed), the rest like aluminium, 900 J/(kg K)'),
        'battery.open_circuit_voltage': _assumed(
            {'table': _voltage_table(pack, chemistry)},
            f'{pack.cells_in_series} times a typical {sheet.chemistry.upper()} cell, from '
            f'{pack.cell_soc[0]:.1%} to {pack.cell_soc[1]:.1%} of its charge (buffers of equal size '
            f'assumed). source: {chemistry.open_circuit_voltage.source}'),
        'battery.resistance': _assumed(
            {'table': _resistance_table(pack, chemistry)},
            f'{pack.cells_in_series} typical cells of {pack.cell_capacity_ah:.0f} Ah, '
            f'{chemistry.resistance.specific_resistance_ohm_ah:g} ohm Ah each at 25 degC and half '
            f'charge. source: {chemistry.resistance.source}. Over temperature, source: '
            f'{chemistry.resistance.temperature_source}. Over the state of charge, source: '
            f'{chemistry.resistance.soc_source}'),
        'battery.connection_resistance_ohm': _assumed(
            round(CONNECTION_SHARE * _cells_ohm(pack, chemistry), 5),
            f'{CONNECTION_SHARE:.0%} of the resistance of the cells at 25 degC; busbars, contactors and '
            'connectors inside the pack, whose heat stays in it'),
        'battery.power_limits.discharge': Entry(
            _power_table(pack, chemistry.discharge_share, W_PER_KW * _discharge_kw(sheet)),
            f'W, at most what drivetrain ({DISCHARGE_RESERVE:g} times its power), heater and '
            f'auxiliaries can take together. {chemistry.discharge_share.source}', assumed=True),
        'battery.power_limits.charge': Entry(
            _power_table(pack, chemistry.charge_share, -W_PER_KW * sheet.charging_power_kw),
            f'W, at most {sheet.charging_power_kw:g} kW ({_origin(sheet, "charging_power_kw")}). '
            f'{chemistry.charge_share.source}', assumed=True),
        'battery.leakage': _assumed(
            {'gamma_0_w_per_k': round(LEAKAGE_AT_REST_W_PER_M2_K * surface_m2, 1),
             'gamma_v_w_per_k_per_mps': round(LEAKAGE_PER_SPEED_W_PER_M2_K_PER_MPS * surface_m2, 3)},
            f'{LEAKAGE_AT_REST_W_PER_M2_K:g} W/(m2 K) at rest and '
            f'{LEAKAGE_PER_SPEED_W_PER_M2_K_PER_MPS:g} W/(m2 K) more for each m/s, over '
            f'{surface_m2:.1f} m2 (area in proportion to the mass: 6.2 m2 at 493 kg, '
            'source: 182 cm x 145 cm x 14 cm, topauto.co.za, "The impressive batteries in VW '
            f'electric cars"). source: {LEAKAGE_SOURCE}'),
        'battery.soc_range': Entry([0.0, 1.0], '0 and 100 % as the car displays them'),
        'battery.temperature_range_c': _assumed(
            [-40.0, 60.0], 'as the car of the paper, config/vehicles/reference.yaml'),
    }


def _pack(sheet: DataSheet, chemistry: Chemistry) -> tuple[Pack, dict[str, str]]:
    """Return (Pack, notes: sources of its energy, cells and mass)."""
    usable_kwh, gross_kwh, notes = sheet.usable_energy_kwh, sheet.gross_energy_kwh, {}
    share = f'{chemistry.usable_share:.0%} usable ({chemistry.usable_share_source})'
    # check_data_sheet made sure that an energy is given, and voltage or number of cells.
    if usable_kwh is None:
        assert gross_kwh is not None
        usable_kwh = chemistry.usable_share * gross_kwh
        notes['energy'] = (f'{usable_kwh:.1f} kWh usable: {gross_kwh:g} kWh gross '
                           f'({_origin(sheet, "gross_energy_kwh")}), {share}')
    elif gross_kwh is None:
        gross_kwh = usable_kwh / chemistry.usable_share
        notes['energy'] = (f'{usable_kwh:g} kWh usable ({_origin(sheet, "usable_energy_kwh")}; '
                           f'{gross_kwh:.1f} kWh gross from {share})')
    else:
        notes['energy'] = (f'{usable_kwh:g} kWh usable ({_origin(sheet, "usable_energy_kwh")}), '
                           f'{gross_kwh:g} kWh gross ({_origin(sheet, "gross_energy_kwh")})')
    cells, notes['cells'] = sheet.cells_in_series, _origin(sheet, 'cells_in_series')
    if cells is None:
        assert sheet.nominal_voltage_v is not None
        cells = round(sheet.nominal_voltage_v / chemistry.nominal_cell_voltage_v)
        notes['cells'] = (f'{sheet.nominal_voltage_v:g} V ({_origin(sheet, "nominal_voltage_v")}) at '
                          f'{chemistry.nominal_cell_voltage_v:g} V a cell')
    mass_kg = sheet.battery_mass_kg
    if mass_kg is not None:
        notes['mass'] = f'{mass_kg:g} kg ({_origin(sheet, "battery_mass_kg")})'
    else:
        mass_kg = WH_PER_KWH * gross_kwh / chemistry.energy_density_wh_per_kg
        notes['mass'] = (f'{mass_kg:.0f} kg ({chemistry.energy_density_wh_per_kg:g} Wh/kg gross, '
                         f'{chemistry.energy_density_source})')
    buffer = 1.0 - usable_kwh / gross_kwh
    pack = Pack(cells, gross_kwh, mass_kg, (0.5 * buffer, 1.0 - 0.5 * buffer), capacity_ah=0.0)
    table = _voltage_table(pack, chemistry)
    # The charge that gives exactly this energy with the table as written to the file.
    mean_v = float(np.dot(np.add(table['values'][1:], table['values'][:-1]) / 2.0, np.diff(table['soc'])))
    return Pack(cells, gross_kwh, mass_kg, pack.cell_soc, round(WH_PER_KWH * usable_kwh / mean_v, 3)), notes


def _voltage_table(pack: Pack, chemistry: Chemistry) -> dict[str, FileData]:
    curve = chemistry.open_circuit_voltage
    cell_v = np.interp(pack.cell_soc_at(VOLTAGE_SOC), curve.soc, curve.voltage_v)
    return {'soc': list(VOLTAGE_SOC),
            'values': [round(float(pack.cells_in_series * value), 2) for value in cell_v]}


def _cells_ohm(pack: Pack, chemistry: Chemistry) -> float:
    """Return the resistance of all cells at 25 degC and half charge [ohm]."""
    specific_ohm_ah: float = chemistry.resistance.specific_resistance_ohm_ah
    return pack.cells_in_series * specific_ohm_ah / pack.cell_capacity_ah


def _resistance_table(pack: Pack, chemistry: Chemistry) -> dict[str, FileData]:
    cell, half_ohm = chemistry.resistance, _cells_ohm(pack, chemistry)
    factors = np.interp(pack.cell_soc_at(RESISTANCE_SOC), cell.soc, cell.soc_factor)
    return {'soc': list(RESISTANCE_SOC), 'temperature_c': list(map(float, cell.temperature_c)),
            'values': [[round(float(half_ohm * soc_factor * factor), 5)
                        for factor in cell.temperature_factor] for soc_factor in factors]}


def _power_table(pack: Pack, shares: Chemistry, most_w: float) -> dict[str, FileData]:
    return {'soc': list(map(float, shares.soc)),
            'temperature_c': list(map(float, shares.temperature_c)),
            # + 0.0 avoids -0 in the file.
            'values': [[round(most_w * soc_share * share) + 0 for share in shares.temperature_share]
                       for soc_share in shares.soc_share]}


def _usual(sheet: DataSheet) -> dict[str, tuple[float, str]]:
    """Return the usual value of each figure that a data sheet may omit, and its reason."""
    drive_kw, heater_kw = sheet.drive_power_kw, sheet.heater_power_kw
    if drive_kw is None:
        # Regeneration never exceeds the drivetrain's power.
        drive_kw = max(round(DRIVE_KW_PER_KWH * energy_of(sheet)[0]), sheet.regeneration_power_kw or 0.0)
    cabin_kw = min(MOST_CABIN_KW, round(CABIN_SHARE * (HEATER_KW if heater_kw is None else heater_kw), 2))
    return {
        'drive_power_kw': (drive_kw, f'{DRIVE_KW_PER_KWH:g} kW for each kWh of the battery'),
        'regeneration_power_kw': (round(REGENERATION_SHARE * drive_kw),
                                  f'{REGENERATION_SHARE:.0%} of the power for driving'),
        'heater_power_kw': (HEATER_KW, 'coolant heaters have 3 ... 10 kW (source: BorgWarner, '
                            'OEM & Lieferant 2/2018, p. 115)'),
        'cabin_heating_power_kw': (cabin_kw, 'a cold day, cabin already warm'),
        'auxiliary_power_kw': (AUXILIARY_KW, 'lights, pumps, computers'),
        'frontal_area_m2': (FRONTAL_AREA_M2, 'a car of middle size; 0.85 times width times height is a good '
                            'estimate'),
        'drag_coefficient': (DRAG_COEFFICIENT, 'usual for an electric car'),
        'rolling_resistance': (ROLLING_RESISTANCE, 'usual for a car tyre on asphalt')}


def _discharge_kw(sheet: DataSheet) -> float:
    drive_kw, heater_kw, auxiliary_kw = (
        _usual(sheet)[name][0] if getattr(sheet, name) is None else getattr(sheet, name)
        for name in ('drive_power_kw', 'heater_power_kw', 'auxiliary_power_kw'))
    return DISCHARGE_RESERVE * drive_kw + heater_kw + auxiliary_kw


def _drivetrain(sheet: DataSheet) -> dict[str, Entry]:
    return {
        'drivetrain.efficiency': _assumed(
            DRIVETRAIN_EFFICIENCY, 'as in Table I of the paper (docs/explanation/paper.md)'),
        'drivetrain.heat_recovery_efficiency': _assumed(
            HEAT_RECOVERY, 'half of the losses reach the battery; 0 where the coolant of motor and inverter does '
            'not get to the battery, 0.8 in the paper'),
        'drivetrain.maximum_power_w': _given_or_assumed(sheet, 'drive_power_kw', W_PER_KW),
        'drivetrain.maximum_regeneration_power_w': _given_or_assumed(sheet, 'regeneration_power_kw', W_PER_KW),
    }


def _heater(sheet: DataSheet) -> dict[str, Entry]:
    return {
        'hvch.maximum_power_w': _given_or_assumed(sheet, 'heater_power_kw', W_PER_KW),
        'hvch.efficiency': _assumed(
            HEATER_EFFICIENCY, 'as in Table I of the paper (docs/explanation/paper.md)'),
        'defaults.cabin_heating_power_w': _given_or_assumed(sheet, 'cabin_heating_power_kw', W_PER_KW),
        'defaults.auxiliary_power_w': _given_or_assumed(sheet, 'auxiliary_power_kw', W_PER_KW),
        # A setting, not a measured value.
        'defaults.target_battery_temperature_c': Entry(
            _warm_c(sheet), 'chosen: from here on the charging power above is at its most')
        if sheet.target_temperature_c is None else
        Entry(sheet.target_temperature_c, _origin(sheet, 'target_temperature_c')),
    }


def _warm_c(sheet: DataSheet) -> float:
    """Return the battery temperature [deg C] from which the charging power is at its most."""
    if sheet.charging_limit is None:
        return USUAL_TARGET_C
    return round(min(max(sheet.charging_limit.warm_c(sheet.charging_power_kw), WARM_CURVE_C),
                     CURVE_TEMPERATURES_C[1]), 1)


def _charging(sheet: DataSheet, curve_fit: float) -> dict[str, Entry]:
    chemistry = load_chemistry(sheet.chemistry)
    curves = curves_of(sheet, curve_fit)
    pack, _ = _pack(sheet, chemistry)
    is_high_voltage = pack.cells_in_series * chemistry.nominal_cell_voltage_v >= HIGH_VOLTAGE_V
    polarization = chemistry.polarization_800_v if is_high_voltage else chemistry.polarization_400_v
    table = charging_map(curves, chemistry, sheet.charging_power_kw, sheet.charging_limit)
    time_note = ''
    if sheet.charging_time_10_80_min is not None:
        how = f'its power times {curve_fit:.3f}' if sheet.charging_curves else 'made fuller or steeper'
        time_note = (f', {how} so that 10 to 80 % take {sheet.charging_time_10_80_min:g} min '
                     f'({_origin(sheet, "charging_time_10_80_min")})')
    return {
        'charging.battery_heating': _assumed(
            sheet.heater_power_kw != 0.0,
            'cars that can heat their battery mostly do so at a fast charger as well'),
        'charging.heating_limit_c': _assumed(_warm_c(sheet), 'from here on the charging power is at its most'),
        'charging.maximum_inlet_power_w': _given(sheet, 'charging_power_kw', W_PER_KW),
        'charging.power_limit': Entry(
            {'soc': list(table.soc), 'temperature_c': list(table.temperature_c),
             'values': [list(row) for row in table.values]},
            f'W, curve at {" / ".join(f"{curve.temperature_c:g}" for curve in curves)} degC: '
            f'{"; ".join(dict.fromkeys(curve.note for curve in curves))}{time_note}. '
            + (f'Limit over the temperature: {sheet.charging_limit.note}' if sheet.charging_limit is not None else
               f'In the cold: {chemistry.charge_share.source}. Hot: {chemistry.hot_share.source}'), assumed=True),
        'charging.polarization_factor': Entry(polarization.factor, polarization.source, assumed=True),
    }


def _road_load(sheet: DataSheet) -> dict[str, Entry]:
    if not sheet.tells_road_load:
        return {}
    return {
        'road_load.mass_kg': _given(sheet, 'vehicle_mass_kg'),
        **{f'road_load.{name}': _given_or_assumed(sheet, name)
           for name in ('frontal_area_m2', 'drag_coefficient', 'rolling_resistance')}}


def _origin(sheet: DataSheet, name: str) -> str:
    """Return the source of a given figure, as text."""
    text = dict(sheet.sources).get(name, 'given')
    return text if text == 'given' or _is_guessed(sheet, name) else f'source: {text}'


def _is_guessed(sheet: DataSheet, name: str) -> bool:
    return dict(sheet.sources).get(name, '').startswith('assumed')


def _given(sheet: DataSheet, name: str, scale: float = 1.0) -> Entry:
    return Entry(_plain(scale * getattr(sheet, name)), _origin(sheet, name), _is_guessed(sheet, name))


def _assumed(value: FileData, why: str) -> Entry:
    return Entry(value, f'assumed: {why}', assumed=True)


def _given_or_assumed(sheet: DataSheet, name: str, scale: float = 1.0) -> Entry:
    if getattr(sheet, name) is not None:
        return _given(sheet, name, scale)
    value, why = _usual(sheet)[name]
    return _assumed(_plain(scale * value), why)


def _plain(value: float) -> float:
    """Return a product of decimal figures without the rounding of its last binary digit."""
    return float(f'{value:.10g}')
