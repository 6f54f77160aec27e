# SPDX-License-Identifier: Apache-2.0
"""
Figures of a data sheet, and whether they are plausible.

Wrong units are the main risk, so each refusal states the value given, the plausible range and, if a
power of ten explains the error, the likely unit.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from difflib import get_close_matches

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.vehicle.charging_curve import ChargingCurve, ChargingLimit
from bev_preheat.vehicle.chemistry import CHEMISTRIES, load_chemistry

# Least usable energy as a share of the gross energy; below it the two belong to different batteries.
LEAST_USABLE_SHARE = 0.75
# Charging power over gross energy [1/h]: the slowest trucks and the fastest cars.
CHARGING_RATE_RANGE_PER_H = (0.15, 6.0)
# Powers of a charging curve above the maximum of the data sheet by less than this share are reading errors.
CURVE_TOLERANCE = 0.1
# From 10 to 80 %.
TEN_TO_EIGHTY = 0.7
# A usable share that is assumed may be wrong by this much.
LEAST_TIME_SHARE = 0.9
MINUTES_PER_H = 60.0
# Largest share of the battery in its car's mass.
MOST_BATTERY_SHARE = 0.55


@dataclass(frozen=True)
class DataSheetQuantity:
    """Plausible range of a figure whose name ends with its unit; `confusions` are (factor, unit)."""

    name: str
    plausible: tuple[float, float]
    confusions: tuple[tuple[float, str], ...]

    @property
    def option(self) -> str:
        """The option of the command line."""
        return f'--{self.name.replace("_", "-")}'

    @property
    def unit(self) -> str:
        """The unit in a message, '' for a number."""
        return UNITS.get(self.name.rpartition('_')[2], '')

    def problems_with(self, value: float) -> Iterator[str]:
        """Yield a sentence on an implausible value."""
        low, high = self.plausible
        if not low <= value <= high:
            hint = next((f'; {value:g} {unit} would be {value * factor:g} {self.unit}'.rstrip()
                         for factor, unit in self.confusions if low <= value * factor <= high), '')
            yield (f'{self.option}: {value:g} {self.unit}'.rstrip()
                   + f' is implausible; it must be {low:g} ... {high:g} {self.unit}'.rstrip() + hint)


UNITS = {'kwh': 'kWh', 'kg': 'kg', 'v': 'V', 'kw': 'kW', 'min': 'min', 'c': 'degC', 'm2': 'm2'}
IN_WH, IN_W, IN_T = ((1e-3, 'Wh'),), ((1e-3, 'W'),), ((1e3, 't'),)
# Cars, vans, trucks and buses.
QUANTITIES = {name: DataSheetQuantity(name, plausible, confusions) for name, plausible, confusions in (
    ('usable_energy_kwh', (5, 1000), IN_WH), ('gross_energy_kwh', (5, 1000), IN_WH),
    ('battery_mass_kg', (40, 8000), ((1e-3, 'g'), *IN_T)), ('nominal_voltage_v', (80, 1250), ((1e3, 'kV'),)),
    ('cells_in_series', (24, 400), ()), ('heater_power_kw', (0, 50), IN_W),
    ('charging_power_kw', (5, 2000), IN_W),
    ('charging_time_10_80_min', (4, 240), ((60.0, 'h'), (1.0 / 60.0, 's'))),
    ('drive_power_kw', (10, 1500), IN_W), ('regeneration_power_kw', (0, 1000), IN_W),
    ('cabin_heating_power_kw', (0, 40), IN_W), ('auxiliary_power_kw', (0, 20), IN_W),
    ('target_temperature_c', (0, 45), ((1, 'K'),)), ('vehicle_mass_kg', (400, 60000), IN_T),
    ('drag_coefficient', (0.15, 1.2), ()), ('frontal_area_m2', (1.2, 12), ()),
    ('rolling_resistance', (0.004, 0.03), ((1e-2, '%'), (1e-3, 'kg/t'))))}
# Other words for a cathode.
ALIKE = {'nca': 'nmc', 'ncm': 'nmc', 'ncma': 'nmc', 'lifepo4': 'lfp', 'lfmp': 'lfp', 'lmfp': 'lfp'}
ROAD_LOAD = ('vehicle_mass_kg', 'drag_coefficient', 'frontal_area_m2', 'rolling_resistance')


@dataclass(frozen=True)
class DataSheet:
    """
    Figures of a data sheet; None if not given. Each name ends with its unit.

    Usable energy is the driver's energy between 100 and 0 %, gross energy that of all cells. At least one of the
    two is needed, and nominal voltage or number of cells in series, and the most charging power at a fast charger;
    the rest can be assumed. `charging_time_10_80_min` is the published time from 10 to 80 % with a warm battery,
    `charging_curves` the published curves from the coldest on, `charging_limit` the most power over the
    battery temperature.
    """

    name: str
    chemistry: str
    charging_power_kw: float
    charging_time_10_80_min: float | None = None
    usable_energy_kwh: float | None = None
    gross_energy_kwh: float | None = None
    battery_mass_kg: float | None = None
    nominal_voltage_v: float | None = None
    cells_in_series: int | None = None
    heater_power_kw: float | None = None
    drive_power_kw: float | None = None
    regeneration_power_kw: float | None = None
    cabin_heating_power_kw: float | None = None
    auxiliary_power_kw: float | None = None
    target_temperature_c: float | None = None
    vehicle_mass_kg: float | None = None
    drag_coefficient: float | None = None
    frontal_area_m2: float | None = None
    rolling_resistance: float | None = None
    charging_curves: tuple[ChargingCurve, ...] = ()
    charging_limit: ChargingLimit | None = None
    # (name of a figure, source); a text that begins with "assumed" marks the figure as assumed.
    sources: tuple[tuple[str, str], ...] = ()

    @property
    def tells_road_load(self) -> bool:
        """Whether mass, air or rolling resistance is given."""
        return any(getattr(self, name) is not None for name in ROAD_LOAD)


def check_data_sheet(sheet: DataSheet) -> None:
    """
    Raise InvalidInput, with one sentence per problem, if a DataSheet is implausible.

    Derived figures are compared after rounding, so that a message never states 3.85 V a cell and an allowed
    range of 3.5 ... 3.85 V.
    """
    problems, name = [], sheet.name
    if not (1 <= len(name) <= 100 and name.isprintable() and name.strip() == name):
        problems.append(f'--name: {name[:60]!r} is not allowed; it must have 1 ... 100 printable characters and '
                        'no space at its ends')
    if sheet.chemistry not in CHEMISTRIES:
        alike = ALIKE.get(sheet.chemistry.lower())
        hint = f'; {sheet.chemistry.upper()} is given as {alike}' if alike else ''
        raise InvalidInput([*problems, f'--chemistry: {sheet.chemistry!r} is not one of '
                            f'{", ".join(CHEMISTRIES)}{hint}'])
    problems += [*_missing(sheet), *_sources_of_nothing(sheet)]
    for field in fields(sheet):
        value = getattr(sheet, field.name)
        if field.name in QUANTITIES and value is not None:
            problems += QUANTITIES[field.name].problems_with(value)
    # An implausible figure would also be reported as inconsistent.
    if not problems:
        problems = [*_inconsistent_battery(sheet), *_inconsistent_powers(sheet), *_inconsistent_masses(sheet)]
    if problems:
        raise InvalidInput(problems)


def _missing(sheet: DataSheet) -> Iterator[str]:
    if sheet.usable_energy_kwh is None and sheet.gross_energy_kwh is None:
        yield ('--usable-energy-kwh or --gross-energy-kwh is needed: the energy for driving, or that of '
               'all cells (both, if the data sheet has both)')
    if sheet.nominal_voltage_v is None and sheet.cells_in_series is None:
        yield '--nominal-voltage-v or --cells-in-series is needed'
    if sheet.tells_road_load and sheet.vehicle_mass_kg is None:
        yield '--vehicle-mass-kg is needed with --drag-coefficient, --frontal-area-m2 or --rolling-resistance'


def _sources_of_nothing(sheet: DataSheet) -> Iterator[str]:
    for name, text in sheet.sources:
        option = f'--{name.replace("_", "-")}'
        if name not in QUANTITIES:
            near = get_close_matches(name, QUANTITIES, n=1)
            hint = f'; did you mean {near[0].replace("_", "-")}?' if near else ''
            yield f'--source: {quoted(name.replace("_", "-"))} is not a figure{hint}'
        elif getattr(sheet, name) is None:
            yield f'--source: {option} is not given'
        elif not text.strip():
            yield f'--source: {option} has no text'


def _inconsistent_battery(sheet: DataSheet) -> Iterator[str]:
    usable_kwh, gross_kwh = sheet.usable_energy_kwh, sheet.gross_energy_kwh
    if usable_kwh is not None and gross_kwh is not None:
        if usable_kwh > gross_kwh:
            yield (f'--usable-energy-kwh: {usable_kwh:g} kWh is more than --gross-energy-kwh '
                   f'{gross_kwh:g} kWh; usable is the smaller one')
        elif round(100 * usable_kwh / gross_kwh) < 100 * LEAST_USABLE_SHARE:
            yield (f'--usable-energy-kwh: {usable_kwh:g} kWh is only '
                   f'{100 * usable_kwh / gross_kwh:.0f} % of --gross-energy-kwh {gross_kwh:g} kWh; it '
                   f'must be at least {100 * LEAST_USABLE_SHARE:.0f} %: do both belong to one '
                   'battery?')
    if sheet.nominal_voltage_v is not None and sheet.cells_in_series is not None:
        low_v, high_v = load_chemistry(sheet.chemistry).nominal_cell_voltage_range_v
        per_cell_v = round(sheet.nominal_voltage_v / sheet.cells_in_series, 2)
        if not low_v <= per_cell_v <= high_v:
            yield (f'--nominal-voltage-v: {sheet.nominal_voltage_v:g} V over '
                   f'{sheet.cells_in_series} cells in series are {per_cell_v:.2f} V a cell; '
                   f'{sheet.chemistry.upper()} cells have {low_v:g} ... {high_v:g} V, which is '
                   f'{low_v * sheet.cells_in_series:.0f} ... '
                   f'{high_v * sheet.cells_in_series:.0f} V. Cells in parallel do not count')


def _inconsistent_powers(sheet: DataSheet) -> Iterator[str]:
    energy_kwh, option = energy_of(sheet)
    low, high = (round(rate * energy_kwh) for rate in CHARGING_RATE_RANGE_PER_H)
    if not low <= sheet.charging_power_kw <= high:
        yield (f'--charging-power-kw: {sheet.charging_power_kw:g} kW for {option} {energy_kwh:g} kWh '
               f'is implausible; it must be {low} ... {high} kW: the most at a fast charger '
               '(direct current), not at a wall box')
    time_min = sheet.charging_time_10_80_min
    if time_min is not None:
        least_min = TEN_TO_EIGHTY * (sheet.usable_energy_kwh or sheet.gross_energy_kwh or 0.0) * (
            MINUTES_PER_H / sheet.charging_power_kw)
        if round(time_min, 1) < round(LEAST_TIME_SHARE * least_min, 1):
            yield (f'--charging-time-10-80-min: {time_min:g} min is too short: {TEN_TO_EIGHTY:.0%} of the energy '
                   f'at --charging-power-kw {sheet.charging_power_kw:g} kW take {least_min:.1f} min')
    most_kw = max((max(curve.power_kw) for curve in sheet.charging_curves), default=0.0)
    if most_kw > (1.0 + CURVE_TOLERANCE) * sheet.charging_power_kw:
        yield (f'--charging-curve: its maximum of {most_kw:g} kW exceeds --charging-power-kw '
               f'{sheet.charging_power_kw:g} kW by more than {CURVE_TOLERANCE:.0%}; do both belong to one car?')
    drive_kw, regeneration_kw = sheet.drive_power_kw, sheet.regeneration_power_kw
    if drive_kw is not None and regeneration_kw is not None and regeneration_kw > drive_kw:
        yield (f'--regeneration-power-kw: {regeneration_kw:g} kW is more than --drive-power-kw '
               f'{drive_kw:g} kW')
    heater_kw, cabin_kw = sheet.heater_power_kw, sheet.cabin_heating_power_kw
    if heater_kw and cabin_kw is not None and cabin_kw >= heater_kw:
        yield (f'--cabin-heating-power-kw: {cabin_kw:g} kW uses all of --heater-power-kw '
               f'{heater_kw:g} kW, so none is left for the battery; both draw from one heater')


def _inconsistent_masses(sheet: DataSheet) -> Iterator[str]:
    energy_kwh, option = energy_of(sheet)
    mass_kg = sheet.battery_mass_kg
    if mass_kg is not None:
        low, high = load_chemistry(sheet.chemistry).energy_density_range_wh_per_kg
        density = round(1000.0 * energy_kwh / mass_kg)
        if not low <= density <= high:
            yield (f'--battery-mass-kg: {option} {energy_kwh:g} kWh in {mass_kg:g} kg are '
                   f'{density} Wh/kg; {sheet.chemistry.upper()} packs have {low:g} ... {high:g} '
                   f'Wh/kg, which is {1000 * energy_kwh / high:.0f} ... '
                   f'{1000 * energy_kwh / low:.0f} kg for the whole pack')
    if mass_kg is not None and sheet.vehicle_mass_kg is not None:
        least_kg = round(mass_kg / MOST_BATTERY_SHARE)
        if sheet.vehicle_mass_kg < least_kg:
            yield (f'--vehicle-mass-kg: {sheet.vehicle_mass_kg:g} kg with a battery of {mass_kg:g} kg '
                   f'is implausible; it must be at least {least_kg} kg, battery included')


def energy_of(sheet: DataSheet) -> tuple[float, str]:
    """Return (energy [kWh], option): the gross energy if it is given, else the usable one."""
    if sheet.gross_energy_kwh is not None:
        return sheet.gross_energy_kwh, '--gross-energy-kwh'
    assert sheet.usable_energy_kwh is not None
    return sheet.usable_energy_kwh, '--usable-energy-kwh'
