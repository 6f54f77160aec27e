# SPDX-License-Identifier: Apache-2.0
"""`preheat vehicle`: makes a vehicle file from a data sheet, and shows the key figures of a vehicle file."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
import shlex

from bev_preheat.charging.published_time import describe_timed_car, USUAL_WARM_C, warm_session
from bev_preheat.charging.session import Session
from bev_preheat.commands.charge import time_text
from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_results
from bev_preheat.commands.parser import completed_by, option_group, Subparsers
from bev_preheat.commands.situation import LESS_COMMON
from bev_preheat.commands.terminal import print_figures, print_records, result_console, ResultConsole
from bev_preheat.drawing.vehicle_figure import make_vehicle_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.files.output_files import AnyPath, check_outputs, existing_file, OutputFile, write_whole
from bev_preheat.numerics import S_PER_MIN
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file
from bev_preheat.vehicle.charging_curve import (
    ChargingCurve,
    ChargingLimit,
    curves_at,
    HEADER,
    LIMIT_HEADER,
    read_charging_curve,
)
from bev_preheat.vehicle.chemistry import CHEMISTRIES
from bev_preheat.vehicle.data_sheet import DataSheet, QUANTITIES
from bev_preheat.vehicle.plausibility import key_in_words, Meaning, meaning_of
from bev_preheat.vehicle.writing import assumed_keys, vehicle_text

SUFFIXES = ('.yaml',)
# Name of the curve in --source.
CURVE = 'charging_curve'
# Help of the figures of a data sheet below the headings of the help, those that most data sheets have first; the
# ranges are those of data_sheet.QUANTITIES.
FIGURES = {
    '': {
        'charging_power_kw': 'maximum power at a fast charger, direct current [kW]',
        'usable_energy_kwh': 'usable energy [kWh], "net"',
        'gross_energy_kwh': 'energy of all cells [kWh]; both, if the data sheet has both',
        'nominal_voltage_v': 'nominal voltage of the pack [V]',
        'cells_in_series': 'number of cells in series (of 96s3p: 96)',
        'battery_mass_kg': 'mass of the whole pack [kg] (default: assumed from its energy)'},
    'published charging': {
        'charging_time_10_80_min': 'published charging time from 10 to 80 %% with a warm battery [min] (default: '
                                   "that of the curve, or of the class's curve)"},
    'heater, drivetrain, cabin': {
        'heater_power_kw': 'power of the coolant heater (HVCH) [kW], 0: none (default: assumed 6)',
        'drive_power_kw': 'maximum power of the drivetrain [kW] (default: assumed 2 kW for each kWh)',
        'regeneration_power_kw': 'maximum power of regeneration [kW] (default: assumed 60 %% of the power for '
                                 'driving)',
        'cabin_heating_power_kw': 'heater power for the cabin [kW] (default: assumed)',
        'auxiliary_power_kw': 'power of lights, pumps, computers [kW] (default: assumed 0.4)',
        'target_temperature_c': 'target battery temperature at the charger [degC] (default: 25)'},
    'road load, for routes without powers': {
        'vehicle_mass_kg': 'mass of the car as driven, battery included [kg]; for routes given as legs of road',
        'drag_coefficient': 'drag coefficient (default: assumed 0.29)',
        'frontal_area_m2': 'frontal area [m2] (default: assumed 2.4)',
        'rolling_resistance': 'rolling resistance over weight (default: assumed 0.010)'}}
HELP = {name: words for figures in FIGURES.values() for name, words in figures.items()}


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand to those of `preheat`."""
    parser = subparsers.add_parser(
        'vehicle', help='make a vehicle file from a data sheet, or show its key figures',
        description='Make a vehicle file from a data sheet, or show the key figures of a vehicle file.')
    actions = parser.add_subparsers(required=True, metavar='ACTION')
    _add_new(actions)
    check = actions.add_parser(
        'check', help='show the key figures of a vehicle file',
        description='Print the key figures of a vehicle file, with warnings about unusual ones. Exit '
                    'status 0, also with warnings; 2 if the file is refused.')
    completed_by('vehicles', check.add_argument(
        'vehicle', metavar='NAME|FILE',
        help='a name in config/vehicles or a YAML file'))
    add_output_arguments(check)
    check.set_defaults(run=run_check)
    actions.add_parser(
        'list', help='the cars that come with the package',
        description='List the cars that come with the package.').set_defaults(run=run_list)


def _add_new(actions: Subparsers) -> None:
    parser = actions.add_parser(
        'new', help='make a vehicle file from a data sheet',
        description='Make a complete vehicle file, with a comment at each value, from a data '
                    'sheet. Required: an energy, a voltage or a number of cells, chemistry and '
                    'charging power; other missing values are assumed, and marked so.')
    parser.add_argument('--output', required=True, metavar='FILE', help='file to write (YAML)')
    parser.add_argument('--chemistry', required=True, metavar='|'.join(CHEMISTRIES),
                        help='cathode of the cells: nmc (also for NCA) or lfp')
    groups = {title: parser if not title else option_group(parser, title) for title in FIGURES}
    for title, figures in FIGURES.items():
        for name, words in figures.items():
            groups[title].add_argument(f'--{name.replace("_", "-")}', help=words,
                                       type=int if name == 'cells_in_series' else float,
                                       metavar=QUANTITIES[name].unit or 'NUMBER',
                                       required=name == 'charging_power_kw')
    parser.add_argument('--name', help="name of the car (default: the file's)")
    parser.add_argument('--force', action='store_true', help='replace an existing file')
    curve = groups['published charging']
    curve.add_argument('--charging-curve', metavar='FILE', action='extend', nargs='+',
                       help='published power over the state of charge, at one or more battery temperatures (CSV: '
                            f'{",".join(HEADER)}), and the most power over the battery temperature (CSV: '
                            f'{",".join(LIMIT_HEADER)}); one or both')
    curve.add_argument('--charging-curve-temperature-c', type=float, metavar='degC', action='extend', nargs='+',
                       default=[],
                       help='battery temperature of each curve over the state of charge [degC], in their '
                            'order; magazines mostly measure with a battery of 25 ... 35 degC')
    option_group(parser, LESS_COMMON).add_argument(
        '--source', action='append', default=[], metavar='OPTION=TEXT',
        help='source of a given figure, for its comment: --source battery-mass-kg="press kit 2021"; a text that '
             'begins with "assumed" marks it as assumed')
    parser.set_defaults(run=run_new)


def run_new(arguments: Namespace) -> int:
    """Write a vehicle file, list its assumed values, and return the exit status."""
    output = arguments.output
    check_outputs([OutputFile('--output', output, SUFFIXES)])
    if existing_file(output) is not None and not arguments.force:
        raise InvalidInput(f'--output: {output}: exists; --force replaces it')
    name = Path(output).stem if arguments.name is None else arguments.name
    sources = _sources(arguments.source)
    curves, limit = _charging(arguments, dict(sources))
    sheet = DataSheet(name, arguments.chemistry.lower(), charging_curves=curves, charging_limit=limit,
                      sources=tuple((figure, text) for figure, text in sources if figure != CURVE),
                      **{quantity: getattr(arguments, quantity) for quantity in HELP})
    entries = describe_timed_car(sheet)
    write_whole(output, vehicle_text(name, entries, _command(arguments)))
    vehicle = load_vehicle(_as_file(output))
    meaning = meaning_of(vehicle)
    console = result_console(soft_wrap=True)
    console.say(f'written: {output}')
    console.say(f'assumed: {", ".join(map(key_in_words, assumed_keys(entries)))}')
    console.say(f'10 ... 80 % at a fast charger: {time_text(warm_session(vehicle))} from {USUAL_WARM_C:g} degC')
    _print_warnings(console, meaning)
    console.say(f'show its key figures: preheat vehicle check {shlex.quote(_as_file(output))}')
    return 0


def _charging(arguments: Namespace,
              sources: dict[str, str]) -> tuple[tuple[ChargingCurve, ...], ChargingLimit | None]:
    """Return the given charging curves from the coldest on, and the given limit over the battery temperature."""
    paths, temperatures_c = arguments.charging_curve or (), arguments.charging_curve_temperature_c
    if not paths and CURVE in sources:
        raise InvalidInput('--source: --charging-curve is not given')
    text = sources.get(CURVE, 'given')
    read = [read_charging_curve(path, text if text == 'given' else f'source: {text}') for path in paths]
    curves = [each for each in read if isinstance(each, ChargingCurve)]
    limits = [each for each in read if isinstance(each, ChargingLimit)]
    if len(limits) > 1:
        raise InvalidInput(f'--charging-curve: {len(limits)} files with {LIMIT_HEADER[0]}; at most one is allowed')
    return curves_at(curves, temperatures_c), next(iter(limits), None)


def run_check(arguments: Namespace) -> int:
    """Print the key figures of a vehicle file, write the requested files, and return the exit status."""
    file = vehicle_file(arguments.vehicle)
    check_output_arguments(arguments, [file])
    vehicle = load_vehicle(arguments.vehicle)
    meaning = meaning_of(vehicle)
    sessions = {at_c: warm_session(vehicle, battery_c=at_c) for at_c in meaning.charging_power_kw}
    console = write_results(arguments, lambda: {**meaning.as_dictionary(), 'charging_time_10_80_s': {
        f'{at_c:g}': session.charging_time_s for at_c, session in sessions.items()}},
        lambda: make_vehicle_figure(vehicle))
    _print_meaning(console, meaning, sessions)
    console.say(meaning.heat_path, meaning.charging)
    _print_assumed(console, vehicle)
    _print_warnings(console, meaning)
    return 0


def _print_assumed(console: ResultConsole, vehicle: Vehicle) -> None:
    """Print the keys of the values that were neither measured nor stated for this car."""
    if not vehicle.assumed:
        console.say(f'vehicle {vehicle.name}: nothing is marked as assumed')
        return
    print_records(console, 'Assumed, not measured', ('quantity', 'key in the file'),
                  [(key_in_words(key), key) for key in vehicle.assumed], ('left', 'left'))


def run_list(arguments: Namespace) -> int:
    """Print the cars that come with the package; returns the exit status."""
    rows = []
    for file in sorted(configuration_folder('vehicles').glob('*.yaml')):
        vehicle = load_vehicle(file.stem)
        meaning = meaning_of(vehicle)
        rows.append((file.stem, f'{meaning.energy_kwh:.1f} kWh',
                     f'{meaning.most_charging_power_kw:.0f} kW', f'{meaning.heater_power_kw:.1f} kW',
                     f'{len(vehicle.assumed)} values' if vehicle.assumed else '-'))
    print_records(result_console(), 'Vehicles',
                  ('name', 'energy', 'charging', 'heater', 'assumed'), rows,
                  ('left', 'right', 'right', 'right', 'left'))
    return 0


def _as_file(path: AnyPath) -> str:
    """Return a path as text that cannot be mistaken for a name of config/vehicles."""
    text = str(path)
    return text if '/' in text else f'./{text}'


def _sources(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
    sources = []
    for text in texts:
        option, sign, source = text.partition('=')
        if not sign:
            raise InvalidInput(f'--source: {text!r} is not OPTION=TEXT, such as battery-mass-kg="press kit 2021"')
        sources.append((option.strip().lstrip('-').replace('-', '_'), source.strip()))
    return tuple(sources)


def _command(arguments: Namespace) -> str:
    """Return the command that reproduces these values, without the sources given for them."""
    words = ['preheat', 'vehicle', 'new', '--output', arguments.output]
    if arguments.name is not None:
        words += ['--name', arguments.name]
    words += ['--chemistry', arguments.chemistry.lower()]
    for field in fields(DataSheet):
        value = getattr(arguments, field.name, None)
        if field.name in HELP and value is not None:
            words += [f'--{field.name.replace("_", "-")}', f'{value:.10g}']
    if arguments.charging_curve is not None:
        words += ['--charging-curve', *arguments.charging_curve]
    if arguments.charging_curve_temperature_c:
        words += ['--charging-curve-temperature-c', *(
            f'{at_c:.10g}' for at_c in arguments.charging_curve_temperature_c)]
    return shlex.join(words)


def _print_warnings(console: ResultConsole, meaning: Meaning) -> None:
    console.say(*(f'warning: {warning}' for warning in meaning.warnings))


def _print_meaning(console: ResultConsole, meaning: Meaning, sessions: dict[float, Session]) -> None:
    """Print the figures of a car, its open-circuit voltage, and its power limits and times by temperature."""
    cells = f', {meaning.cells_in_series} cells in series' if meaning.cells_in_series else ''
    resistances = ' / '.join(f'{1e3 * ohm:.0f}' for ohm in meaning.resistance_ohm.values())
    at = ' / '.join(f'{at_c:g}' for at_c in meaning.resistance_ohm)
    print_records(console, f'Vehicle {meaning.name}', ('quantity', 'value'), [
        ('energy', f'{meaning.energy_kwh:.1f} kWh'),
        ('mean open-circuit voltage', f'{meaning.nominal_voltage_v:.0f} V{cells}'),
        ('capacity', f'{meaning.capacity_ah:.1f} Ah'),
        (f'resistance at {at} degC', f'{resistances} mohm'),
        ('voltage drop at the one-hour current', f'{100 * meaning.one_hour_drop:.1f} %'),
        ('heat capacity', f'{meaning.heat_capacity_kj_per_k:.0f} kJ/K, '
                          f'{meaning.heat_capacity_kj_per_k_kwh:.1f} for each kWh'),
        ('thermal time constant at rest / 100 km/h',
         f'{meaning.time_constant_h:.1f} / {meaning.time_constant_at_100_kmh_h:.1f} h'),
        ('heated 10 min from 0 degC, outside -10 degC:', ''),
        (f'  with {meaning.heater_power_kw:.1f} kW at rest / 100 km/h',
         f'{meaning.heating_at_rest_k_per_10_min:+.1f} / {meaning.heating_at_100_kmh_k_per_10_min:+.1f} K'),
        ('  net of cabin heating, 100 km/h',
         f'{meaning.heating_beside_cabin_k_per_10_min:+.1f} K'),
        ('maximum charging power', f'{meaning.most_charging_power_kw:.0f} kW'),
        (f'10 ... 80 % from {USUAL_WARM_C:g} degC', time_text(sessions[USUAL_WARM_C]))], ('left', 'right'))
    voltages_v = meaning.open_circuit_voltage_v
    print_figures(console, 'Open-circuit voltage at 25 degC',
                  ('charged', *(f'{100 * soc:.0f} %' for soc in voltages_v)),
                  [('V', *(f'{value:.0f}' for value in voltages_v.values()))])
    charging = meaning.charging_power_kw
    print_figures(
        console, 'Power limits and charging times', ('battery at', *(f'{at_c:g} degC' for at_c in charging)),
        [(f'charging at {100 * soc:.0f} % in kW',
          *(f'{row[soc]:.0f}' for row in charging.values()))
         for soc in next(iter(charging.values()))]
        + [('discharging at 50 % in kW',
            *(f'{power_kw:.0f}' for power_kw in meaning.discharging_power_kw.values())),
           ('10 ... 80 % in min', *(
               'never' if session.problem else f'{session.charging_time_s / S_PER_MIN:.1f}'
               for session in sessions.values()))])
