# SPDX-License-Identifier: Apache-2.0
"""`preheat charge`: the charging session after a drive, with preheating and without."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from bev_preheat.charging.ageing import outside_in_words
from bev_preheat.charging.heating_choice import ChargerHeating, HeatingChoice
from bev_preheat.charging.session import Session
from bev_preheat.charging.stop import (
    ChargingStop,
    refuse_stranded,
    stop_after,
    USUAL_DEPARTURE_SOC,
)
from bev_preheat.charging.target_worth import check_prices, ENERGY_PRICE_PER_KWH, Prices, VALUE_OF_TIME_PER_H
from bev_preheat.charging.verdict import too_warm, TooWarm
from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_results
from bev_preheat.commands.parser import given_options, option_group, option_of, Subparsers
from bev_preheat.commands.situation import add_drive_arguments, load_planned_vehicle, read_situation, ROUTE_OPTIONS
from bev_preheat.commands.terminal import print_figures
from bev_preheat.drawing.charging_figure import make_session_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import W_PER_KW, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import Vehicle, vehicle_file

MOST_TEMPERATURES = 2
PREHEATED, UNHEATED = 'preheated', 'without preheating'
# Arguments for each of the two ways to give the state on arrival.
OF_A_DRIVE = ('temperature', 'soc', 'target', 'min_soc', 'step',
              *(name for name in ROUTE_OPTIONS if name != 'ambient'))
OF_AN_ARRIVAL = ('arrival_soc', 'cabin_heating_power', 'auxiliary_power')


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'charge', help='the charging session after a drive',
        description='Charging time and bought energy after a drive, with preheating and without, or after '
        'arriving with one or two given temperatures. A car that can heat its battery at the charger does so as '
        'far as it pays.')
    group = parser.add_mutually_exclusive_group(required=True)
    add_drive_arguments(parser, group, needs_state=False, ambient_help=(
        'no drive: ambient temperature at the charger [degC]; after a drive that of its last segment, or of all '
        'segments if the file of the route has none'))
    group.add_argument('--arrival-temperature', type=float, action='extend', nargs='+', metavar='DEGC',
                       help='no drive: one or two battery temperatures on arrival [degC]')
    more = option_group(parser, 'an arrival without a drive')
    more.add_argument('--arrival-soc', type=float, metavar='0..1', help='no drive: state of charge on arrival')
    more.add_argument('--cabin-heating-power', type=float, metavar='W',
                      help="no drive: heater power for the cabin [W] (default: the vehicle's)")
    more.add_argument('--auxiliary-power', type=float, metavar='W',
                      help="no drive: lights, pumps, computers [W] (default: the vehicle's)")
    add_charger_arguments(parser)
    add_price_arguments(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def add_charger_arguments(parser: ArgumentParser, required: bool = True) -> None:
    """Add `--charger-power` and `--departure-soc`; without `required` the default of the latter is None."""
    parser.add_argument('--charger-power', required=required, type=float, metavar='W',
                        help="maximum power of the charger, at the vehicle's inlet [W]")
    parser.add_argument('--departure-soc', type=float, metavar='0..1',
                        default=USUAL_DEPARTURE_SOC if required else None,
                        help=f"state of charge to leave with (default: the planner's, {USUAL_DEPARTURE_SOC:g})")


def add_price_arguments(parser: ArgumentParser, of_energy: str = '') -> None:
    """Add `--energy-price`, whose help goes on with `of_energy`, and `--value-of-time`."""
    parser.add_argument('--energy-price', type=float, default=ENERGY_PRICE_PER_KWH, metavar='PER_KWH',
                        help=f'price of energy at the charger, per kWh{of_energy} (default: %(default)s)')
    parser.add_argument('--value-of-time', type=float, default=VALUE_OF_TIME_PER_H, metavar='PER_H',
                        help='value of an hour at the charger to the driver (default: %(default)s)')


def run(arguments: Namespace) -> int:
    """Simulate, print, and write the requested files; returns the exit status."""
    after_drive = arguments.route is not None
    _refuse_other_arguments(arguments, after_drive)
    prices = Prices(arguments.energy_price, arguments.value_of_time)
    check_prices(prices)
    vehicle, stop, arrivals, more = (_after_drive if after_drive else _after_arrival)(arguments)
    heating = ChargerHeating(vehicle, stop, prices)
    choices = {name: heating.compare(arrival) for name, arrival in arrivals.items()}
    sessions = {name: choice.session for name, choice in choices.items()}
    title = (f'vehicle {vehicle.name}, charger {arguments.charger_power / W_PER_KW:g} kW, ambient '
             f'{stop.ambient_c:g} degC, to {100.0 * stop.departure_soc:g} %')
    warm = {name: too_warm(vehicle, stop, session) for name, session in sessions.items()}
    console = write_results(arguments, lambda: {
        **asdict(stop), 'energy_price_per_kwh': prices.energy_per_kwh, 'value_of_time_per_h': prices.time_per_h,
        'sessions': [{'name': name, **choice.session.as_dictionary(),
                      'charger_heating': choice.as_dictionary()} for name, choice in choices.items()],
        **more}, lambda: make_session_figure(vehicle, stop, sessions, title))
    rows: tuple[tuple[str, Callable[[Session], str]], ...] = (
        ('Arrival temp. [degC]', lambda session: f'{session.battery_temperature_c[0]:.2f}'),
        ('Arrival SoC [%]', lambda session: f'{100 * session.soc[0]:.2f}'),
        ('Charging time', time_text),
        ('Bought energy [kWh]', _energy_text),
        ('… by the heater', lambda session: f'{session.energy_wh.hvch_electric / WH_PER_KWH:.2f}'),
        *([('… by the cooling', lambda session: f'{session.energy_wh.cooling_electric / WH_PER_KWH:.2f}')]
          if any(session.energy_wh.cooling_electric > 0.0 for session in sessions.values()) else ()),
        ('… by cabin and auxiliaries', lambda session: (
            f'{(session.energy_wh.cabin + session.energy_wh.auxiliary) / WH_PER_KWH:.2f}')),
        *([('Ageing [cost]', lambda session: f'{session.ageing_cost:.2f}')]
          if any(session.ageing_cost for session in sessions.values()) else ()),
        ('Joule heat [kWh]', lambda session: f'{session.energy_wh.joule / WH_PER_KWH:.2f}'),
        ('Highest power [kW]', lambda session: (
            f'{max(session.charging_power_w, default=0.0) / W_PER_KW:.1f}')),
        ('Departure temp. [degC]', lambda session: f'{session.battery_temperature_c[-1]:.2f}'),
        ('Departure SoC [%]', lambda session: f'{100 * session.soc[-1]:.2f}'))
    print_figures(console, title, ['', *sessions], [
        (heading, *map(figure, sessions.values())) for heading, figure in rows])
    console.say(*_sentences(sessions), *_heating_sentences(choices), *_warm_sentences(warm), outside_in_words(
        vehicle, {name: session.ageing.outside_share for name, session in sessions.items() if session.ageing}))
    return 0


def _warm_sentences(warm: dict[str, TooWarm | None]) -> list[str]:
    """Return a sentence for each session in which heat lowers the power; with the name if there are two."""
    return [f'{name[0].upper()}{name[1:]}: {each.sentence}' if len(warm) > 1 else each.sentence
            for name, each in warm.items() if each is not None]


def _refuse_other_arguments(arguments: Namespace, after_drive: bool) -> None:
    given, other, mine, needed = (
        ('--route', '--arrival-temperature', OF_AN_ARRIVAL, ('temperature', 'soc')) if after_drive
        else ('--arrival-temperature', '--route', OF_A_DRIVE, ('arrival_soc', 'ambient')))
    problems = [f'{option}: not allowed with {given}, only with {other}'
                for option in given_options(arguments, mine)]
    problems += [f'{option_of(name)}: needed with {given}' for name in needed if getattr(arguments, name) is None]
    if not after_drive:
        if len(arguments.arrival_temperature) > MOST_TEMPERATURES:
            problems.append(f'--arrival-temperature: {len(arguments.arrival_temperature)} values are given; at '
                            f'most {MOST_TEMPERATURES} are allowed')
    if problems:
        raise InvalidInput(problems)


def _after_drive(
        arguments: Namespace) -> tuple[Vehicle, ChargingStop, dict[str, BatteryState], dict[str, Any]]:
    """Return vehicle, stop, states on arrival by name, and further JSON contents."""
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    unheated = plan_unheated(*situation.inputs)
    refuse_stranded(unheated)
    plan = plan_preheating(*situation.inputs)
    stop = stop_after(situation.route, arguments.charger_power, arguments.departure_soc)
    return situation.vehicle, stop, {
        name: drive.arrival_state for name, drive in ((PREHEATED, plan), (UNHEATED, unheated))}, {
            'plan': plan.as_dictionary(), **situation.as_dictionary()}


def _after_arrival(
        arguments: Namespace) -> tuple[Vehicle, ChargingStop, dict[str, BatteryState], dict[str, Any]]:
    vehicle = load_planned_vehicle(arguments.vehicle)
    check_output_arguments(arguments, [vehicle_file(arguments.vehicle)])
    cabin_w, auxiliary_w = arguments.cabin_heating_power, arguments.auxiliary_power
    stop = ChargingStop(
        arguments.charger_power, arguments.departure_soc, arguments.ambient,
        vehicle.defaults.cabin_heating_power_w if cabin_w is None else cabin_w,
        vehicle.defaults.auxiliary_power_w if auxiliary_w is None else auxiliary_w)
    return vehicle, stop, {
        f'from {at_c:g} degC': BatteryState(at_c, arguments.arrival_soc)
        for at_c in arguments.arrival_temperature}, {'vehicle_assumed': list(vehicle.assumed)}


def time_text(session: Session) -> str:
    """Return the charging time of a Session as text."""
    return 'never' if session.problem else duration_text(session.charging_time_s)


def _energy_text(session: Session) -> str:
    return '–' if session.problem else f'{session.bought_energy_wh / WH_PER_KWH:.2f}'


def _sentences(sessions: dict[str, Session]) -> list[str]:
    """Return sentences on the sessions: incomplete charging, and the faster of two."""
    sentences = [f'{name[0].upper()}{name[1:]}: not charged to the end: {session.problem}.'
                 for name, session in sessions.items() if session.problem]
    if len(sessions) == MOST_TEMPERATURES and not sentences:
        (name, one), (other_name, other) = sessions.items()
        saved_s = other.charging_time_s - one.charging_time_s
        more_kwh = (one.bought_energy_wh - other.bought_energy_wh) / WH_PER_KWH
        sentences.append(
            f'{name[0].upper()}{name[1:]}, charging takes {time_text(one)}, '
            f'{duration_text(abs(saved_s))} {"less" if saved_s >= 0.0 else "more"} than {other_name}, '
            f'and buys {abs(more_kwh):.2f} kWh {"more" if more_kwh >= 0.0 else "less"}.')
    return sentences


def _heating_sentences(choices: dict[str, HeatingChoice]) -> list[str]:
    """Return the sentence on the heating at the charger of each session; one for all if they are the same."""
    sentences = {name: choice.sentence() for name, choice in choices.items()}
    if len(set(sentences.values())) == 1:
        return [sentence for sentence in list(sentences.values())[:1] if sentence]
    return [f'{name[0].upper()}{name[1:]}: {sentence[0].lower()}{sentence[1:]}'
            for name, sentence in sentences.items() if sentence]
