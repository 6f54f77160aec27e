# SPDX-License-Identifier: Apache-2.0
"""`preheat worth`: whether heating before the charger pays, to which temperature, and at which charger."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
import math

from bev_preheat.charging.ageing import outside_in_words
from bev_preheat.charging.chargers import CandidateWorth, load_chargers, rank_chargers, ranking_verdict
from bev_preheat.charging.expectation import time_deviation, TimeDeviation
from bev_preheat.charging.stop import ChargingProspect, check_stop, stop_after, USUAL_DEPARTURE_SOC
from bev_preheat.charging.target_range import by_session, by_table, COLUMNS, read_charging_times, targets_in_range
from bev_preheat.charging.target_worth import check_prices, Prices, TargetWorth, Worth
from bev_preheat.charging.worth_search import find_worth, goal_of
from bev_preheat.commands.charge import add_charger_arguments, add_price_arguments
from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_json, write_results
from bev_preheat.commands.parser import completed_by, given_options, option_group, option_of, Subparsers
from bev_preheat.commands.situation import (
    add_drive_arguments,
    add_prospect_arguments,
    PROSPECT_OPTIONS,
    read_prospect,
    read_situation,
)
from bev_preheat.commands.terminal import print_records, result_console, ResultConsole
from bev_preheat.drawing.charging_figure import make_chargers_figure, make_worth_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import S_PER_MIN, W_PER_KW, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.sensitivity import find_sensitivity

# The table shows targets at this spacing; the JSON has all.
SHOWN_EACH_K = 5.0
# Arguments for one charger, and for several.
OF_ONE = ('charger_power', 'departure_soc')
OF_SEVERAL = ('end_soc', 'only')
# Arguments for a range of targets.
OF_RANGE = ('target_range', 'charging_times')


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'worth', help='whether heating before the charger pays, and to which temperature',
        description='The target with the least cost of energy and time, and the value of time from which heating '
        'pays. With --chargers: the cheapest charger along the route, each with its best target.')
    add_drive_arguments(parser)
    add_charger_arguments(parser, required=False)
    several = option_group(parser, 'several chargers')
    completed_by('chargers', several.add_argument(
        '--chargers', metavar='NAME|FILE',
        help='compare several chargers: a name in config/chargers or a YAML file; replaces '
        '--charger-power and --departure-soc'))
    several.add_argument('--end-soc', type=float, metavar='0..1',
                         help='with --chargers: state of charge at the end of the route')
    several.add_argument('--only', action='extend', nargs='+', metavar='CHARGER',
                         help='with --chargers: compare only these, by name')
    within = option_group(parser, 'a range of targets')
    within.add_argument('--target-range', nargs=2, type=float, metavar='degC',
                        help='lowest and highest target [degC]: the best one in between')
    within.add_argument('--charging-times', metavar='FILE',
                        help=f'with --target-range: charging times of a table ({",".join(COLUMNS)}) instead of '
                        '--charger-power')
    add_price_arguments(parser, '; with --chargers for chargers without their own price')
    add_prospect_arguments(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Find the best target, print, and write the requested files; returns the exit status."""
    check_charger_arguments(arguments)
    if arguments.chargers is not None:
        return run_chargers(arguments)
    if arguments.departure_soc is None:
        arguments.departure_soc = USUAL_DEPARTURE_SOC
    if arguments.target_range is not None:
        return run_range(arguments)
    prospect = read_prospect(arguments)
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    prices = Prices(arguments.energy_price, arguments.value_of_time)
    inputs, goal = situation.inputs[:3], situation.goal
    charger = arguments.charger_power, arguments.departure_soc
    worth = find_worth(*inputs, goal, *charger, prices, prospect=prospect, with_rules=True)
    shown = worth.fixed if worth.best is worth.without_heating else worth.best
    goal = replace(goal_of(goal, shown.target_c, -math.inf if shown is worth.fixed else
                           worth.without_heating.arrival_temperature_c),
                   heats_until_arrival=prospect.heats_until_arrival)
    deviation = time_deviation(*inputs, goal, *charger, prices)
    sensitivity = None
    if worth.best is not worth.without_heating:
        sensitivity = find_sensitivity(*inputs, goal, plan_preheating(*inputs, goal))
    title = (f'{situation.title}, charger '
             f'{arguments.charger_power / W_PER_KW:g} kW to {100.0 * arguments.departure_soc:g} %\n'
             f'{prices.energy_per_kwh:g} per kWh, {prices.time_per_h:g} per h{_prospect_text(prospect)}')
    console = write_results(arguments, lambda: {
        **worth.as_dictionary(), 'energy_price_per_kwh': prices.energy_per_kwh,
        'value_of_time_per_h': prices.time_per_h, 'charger_power_w': arguments.charger_power,
        'departure_soc': arguments.departure_soc,
        **({} if prospect.is_certain else {
            'charging_probability': prospect.probability,
            'arrival_deviation_s': prospect.arrival_deviation_s,
            'charging_known_before_s': prospect.known_before_arrival_s}),
        'sensitivity': sensitivity and sensitivity.as_dictionary(),
        'charging_time_deviation_s': {'target_c': shown.target_c, **vars(deviation)},
        **situation.as_dictionary()}, lambda: make_worth_figure(worth, title))
    _print_targets(console, title.replace('\n', ', '), [
        *((target, _names(worth, target)) for target in _shown(worth)),
        *((item, name) for name, item in worth.by_rule.items())])
    console.say(worth.verdict, worth.bounds_in_words(), worth.step and worth.step.in_words(),
                None if sensitivity is None else sensitivity.in_words(worth.unheated_in_words()),
                worth.best_choice.sentence(), _deviation_sentence(worth, shown, deviation),
                outside_in_words(situation.vehicle, {
                    'unheated': worth.without_heating.ageing_outside_share,
                    'with the best target': worth.best.ageing_outside_share}))
    return 0


def _prospect_text(prospect: ChargingProspect) -> str:
    """Return the prospect of charging for the title; '' if charging is certain."""
    known_s = prospect.known_before_arrival_s
    return ''.join(text for is_given, text in (
        (prospect.probability < 1.0, f', {prospect.in_words} chance of charging'),
        (prospect.probability < 1.0 and known_s > 0.0, f', known {known_s:g} s before arrival'),
        (prospect.arrival_deviation_s > 0.0, f', arrival +-{prospect.arrival_deviation_s:g} s')) if is_given)


def _shown(worth: Worth) -> list[TargetWorth]:
    """Return the targets for the table: every fifth degree that is reached, and the named ones."""
    named = (worth.without_heating, worth.best, worth.fixed)
    shown, warmest_c = [], -math.inf
    for target in worth.targets:
        is_round = target.target_c % SHOWN_EACH_K == 0.0
        if target in named or (is_round and target.arrival_temperature_c > warmest_c):
            shown.append(target)
            warmest_c = target.arrival_temperature_c
    return shown


def _names(worth: Worth, target: TargetWorth) -> str:
    return ', '.join(name for name, other in (('unheated', worth.without_heating), ('best', worth.best),
                                              ('fixed', worth.fixed)) if target == other)


def _print_targets(console: ResultConsole, title: str, targets: list[tuple[TargetWorth, str]]) -> None:
    """Print targets with their names; the cost of ageing, if it has a price, instead of the state of charge."""
    headings = ['target [degC]', 'arrival [degC]', 'SoC [%]', 'heater [Wh]', 'charging [min]', 'bought [kWh]',
                'ageing', 'cost', '']
    left_out = headings.index('SoC [%]' if any(target.ageing_cost for target, _ in targets) else 'ageing')
    rows = [headings, *([*_row(*item)] for item in targets)]
    for row in rows:
        del row[left_out]
    print_records(console, title, headings, rows[1:], (*('right',) * 7, 'left'))


def _row(target: TargetWorth, names: str) -> tuple[str, ...]:
    ends = math.isfinite(target.cost)
    return ('–' if names.startswith('unheated') else f'{target.target_c:.2f}',
            f'{target.arrival_temperature_c:.2f}', f'{100.0 * target.arrival_soc:.2f}',
            f'{target.hvch_electric_wh:.0f}',
            f'{target.charging_time_s / S_PER_MIN:.1f}' if ends else 'never',
            f'{target.bought_energy_wh / WH_PER_KWH:.2f}' if ends else '–',
            f'{target.ageing_cost:.2f}' if ends else '–', f'{target.cost:.2f}' if ends else '–', names)


def _deviation_sentence(worth: Worth, shown: TargetWorth, deviation: TimeDeviation) -> str | None:
    """Return a sentence on the uncertainty of the charging times, or None."""
    without = worth.without_heating
    if shown is without or not all(map(math.isfinite, (
            shown.charging_time_s, without.charging_time_s, deviation.saved_s))):
        return None
    saved_s = without.charging_time_s - shown.charging_time_s
    return (f'Uncertainty of the model (1 sigma): {duration_text(without.charging_time_s)} '
            f'+-{duration_text(deviation.without_heating_s)} without {worth.way}, '
            f'{duration_text(shown.charging_time_s)} +-{duration_text(deviation.heated_s)} with '
            f'{shown.target_c:.1f} degC; {"saved" if saved_s >= 0.0 else "lost"} '
            f'{duration_text(abs(saved_s))} +-{duration_text(deviation.saved_s)}.')


def check_charger_arguments(arguments: Namespace) -> None:
    """Raise InvalidInput if an argument belongs to the other way, or one is missing."""
    several = arguments.chargers is not None
    others, needed = ((*OF_ONE, 'target', *PROSPECT_OPTIONS, *OF_RANGE), ('end_soc',)) if several else (
        OF_SEVERAL, OF_ONE[:1] if arguments.charging_times is None else ())
    problems = [f'{option}: {"not allowed with" if several else "only with"} --chargers'
                for option in given_options(arguments, others)]
    if arguments.target_range is not None:
        problems += [f'{option}: not allowed with --target-range' for option in given_options(
            arguments, ('target', *PROSPECT_OPTIONS, 'plot'))]
        problems += ['--charger-power: not allowed with --charging-times'] * (
            None not in (arguments.charger_power, arguments.charging_times))
    elif arguments.charging_times is not None:
        problems.append('--charging-times: only with --target-range')
    problems += [f'{option_of(name)}: needed with{"" if several else "out"} --chargers' for name in needed
                 if getattr(arguments, name) is None]
    if problems:
        raise InvalidInput(problems)


def run_range(arguments: Namespace) -> int:
    """Find the best target within a range, print, and write the requested files; returns the exit status."""
    situation = read_situation(arguments)
    prices = Prices(arguments.energy_price, arguments.value_of_time)
    files = [*situation.files, *([] if arguments.charging_times is None else [arguments.charging_times])]
    check_output_arguments(arguments, files)
    vehicle, route = situation.inputs[:2]
    if arguments.charging_times is None:
        stop = stop_after(route, arguments.charger_power, arguments.departure_soc)
        check_stop(vehicle, stop)
        after = by_session(vehicle, stop, prices)
    else:
        after = by_table(vehicle, read_charging_times(arguments.charging_times), arguments.departure_soc)
    found = targets_in_range(*situation.inputs, arguments.target_range, after, prices)
    best = found[0]
    if arguments.json:
        write_json(arguments.json, {
            'targets': [item.as_dictionary() for item in sorted(found, key=lambda item: item.target_c)],
            'best': best.as_dictionary(), 'target_range_c': arguments.target_range, **situation.as_dictionary()})
    low_c, high_c = arguments.target_range
    console = result_console(arguments.json)
    title = f'{situation.title}, {low_c:g} ... {high_c:g} degC on arrival'
    _print_targets(console, title, [(item, 'best' if item is best else '') for item in sorted(
        found, key=lambda item: item.target_c) if item is best or item.target_c % 1.0 == 0.0])
    told = (f'Best target: {best.target_c:.2f} degC' if best.target_c <= high_c else
            f'Unheated, the battery arrives above the range: at {best.target_c:.2f} degC')
    console.say('No target within the range is reached with the reserve of charge and charged to the end.'
                if math.isinf(best.cost) else
                f'{told}, {duration_text(best.charging_time_s)} at the charger, '
                f'{best.hvch_electric_wh:.0f} Wh for heat.',
                outside_in_words(vehicle, {'with the best target': best.ageing_outside_share}))
    return 0


def run_chargers(arguments: Namespace) -> int:
    """Rank the chargers of a file, print, and write the requested files; returns the exit status."""
    situation = read_situation(arguments)
    check_prices(Prices(arguments.energy_price, arguments.value_of_time))
    candidates, file = load_chargers(arguments.chargers, situation.route, arguments.energy_price,
                                     arguments.only or ())
    check_output_arguments(arguments, (*situation.files, file))
    ranked = rank_chargers(*situation.inputs, candidates, arguments.end_soc, arguments.value_of_time)
    able = [item for item in ranked if item.problem is None]
    verdict = ranking_verdict(ranked)
    title = (f'{situation.title}, {100.0 * arguments.end_soc:g} % at its end\n'
             f'{arguments.value_of_time:g} per h')
    console = write_results(arguments, lambda: {
        'chargers': [item.as_dictionary() for item in ranked],
        'best': able[0].candidate.name if able else None, 'verdict': verdict,
        'end_soc': arguments.end_soc, 'value_of_time_per_h': arguments.value_of_time,
        **situation.as_dictionary()}, lambda: make_chargers_figure(ranked, title))
    costs = ('energy', 'charging', 'detour', 'wait',
             *(('ageing',) if any(item.ageing_cost for item in ranked) else ()), 'total')
    print_records(
        console, title.replace('\n', ', '),
        ('charger', 'after [min]', 'power [kW]', 'arrives [%]', 'leaves [%]', 'target [degC]',
         'bought [kWh]', 'charging [min]', *costs),
        [_charger_row(item, costs) for item in ranked], ('left', *('right',) * (7 + len(costs))))
    console.say(verdict, outside_in_words(situation.vehicle, {
        f'at {item.candidate.name}': item.worth.best.ageing_outside_share for item in ranked if item.worth}))
    for item in ranked:
        if item.problem is not None:
            console.say(f'{item.candidate.name}: {item.problem}.')
        elif item is not able[0]:
            console.say(f'{item.candidate.name}: {_sentence(item, able[0])}')
    return 0


def _charger_row(item: CandidateWorth, costs: tuple[str, ...]) -> tuple[str, ...]:
    candidate = item.candidate
    place = (candidate.name, f'{candidate.instant_s / S_PER_MIN:.1f}',
             f'{candidate.charger_power_w / W_PER_KW:g}')
    if item.problem is not None or item.worth is None:
        return (*place, *('–',) * (5 + len(costs)))
    best = item.worth.best
    return (*place, f'{100.0 * best.arrival_soc:.1f}', f'{100.0 * item.departure_soc:.1f}',
            'none' if best is item.worth.without_heating else f'{best.target_c:.1f}',
            f'{best.bought_energy_wh / WH_PER_KWH:.2f}', f'{best.charging_time_s / S_PER_MIN:.1f}',
            *(f'{getattr(item, f"{name}_cost"):.2f}' for name in costs))


def _sentence(item: CandidateWorth, best: CandidateWorth) -> str:
    """Return a sentence that compares its costs with the best charger's."""
    assert item.worth is not None and best.worth is not None
    later_s = (item.worth.best.charging_time_s + item.candidate.detour_s + item.candidate.expected_wait_s
               - best.worth.best.charging_time_s - best.candidate.detour_s
               - best.candidate.expected_wait_s)
    energy = item.energy_cost - best.energy_cost
    return (f'{item.total_cost - best.total_cost:.2f} more in total than {best.candidate.name}: '
            f'{duration_text(abs(later_s))} {"more" if later_s >= 0.0 else "less"} time, '
            f'{abs(energy):.2f} {"more" if energy >= 0.0 else "less"} for energy.')
