# SPDX-License-Identifier: Apache-2.0
"""`preheat worth --chargers`: comparison of several chargers along a route, each with its best target."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.charging.chargers import load_chargers, rank_chargers, ranking_verdict
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import check_prices
from bev_preheat.commands.output import check_output_arguments, write_json
from bev_preheat.commands.prospect import OPTIONS
from bev_preheat.commands.situation import read_situation
from bev_preheat.commands.terminal import print_records, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import S_PER_MIN, W_PER_KW, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from argparse import Namespace

    from bev_preheat.charging.chargers import CandidateWorth

# Arguments for one charger, and for several.
OF_ONE = ('charger_power', 'departure_soc')
OF_SEVERAL = ('end_soc', 'only')


def check_charger_arguments(arguments: Namespace) -> None:
    """Raise InvalidInput if an argument belongs to the other way, or one is missing."""
    several = arguments.chargers is not None
    others, needed = ((*OF_ONE, *OPTIONS), ('end_soc',)) if several else (OF_SEVERAL, OF_ONE[:1])
    problems = [f'{_option(name)}: {"not allowed with" if several else "only with"} --chargers'
                for name in others if getattr(arguments, name) is not None]
    problems += [f'{_option(name)}: needed with{"" if several else "out"} --chargers' for name in needed
                 if getattr(arguments, name) is None]
    if problems:
        raise InvalidInput(problems)


def _option(name: str) -> str:
    return f'--{name.replace("_", "-")}'


def run_chargers(arguments: Namespace) -> int:
    """Rank the chargers of a file, print, and write the requested files; returns the exit status."""
    situation = read_situation(arguments)
    check_prices(Prices(arguments.energy_price, arguments.value_of_time))
    chargers = load_chargers(arguments.chargers, situation.route, arguments.energy_price,
                             arguments.only or ())
    check_output_arguments(arguments, (*situation.files, chargers.file))
    ranked = rank_chargers(situation.vehicle, situation.route, situation.state, situation.goal,
                           chargers.candidates, arguments.end_soc, arguments.value_of_time)
    able = [item for item in ranked if item.problem is None]
    verdict = ranking_verdict(ranked)
    title = (f'vehicle {situation.vehicle.name}, route {arguments.route}, '
             f'{100.0 * arguments.end_soc:g} % at its end\n{arguments.value_of_time:g} per h')
    if arguments.json:
        write_json(arguments.json, {
            'chargers': [item.as_dictionary() for item in ranked],
            'best': able[0].candidate.name if able else None, 'verdict': verdict,
            'end_soc': arguments.end_soc, 'value_of_time_per_h': arguments.value_of_time,
            **situation.as_dictionary()})
    if arguments.plot:
        from bev_preheat.drawing.chargers_figure import draw_chargers
        draw_chargers(arguments.plot, ranked, title)
    console = result_console(arguments.json)
    print_records(
        console, title.replace('\n', ', '),
        ('charger', 'after [min]', 'power [kW]', 'arrives [%]', 'leaves [%]', 'target [degC]',
         'bought [kWh]', 'charging [min]', 'energy', 'charging', 'detour', 'wait', 'total'),
        [_row(item) for item in ranked], ('left', *('right',) * 12))
    console.say(verdict)
    for item in ranked:
        if item.problem is not None:
            console.say(f'{item.candidate.name}: {item.problem}.')
        elif item is not able[0]:
            console.say(f'{item.candidate.name}: {_sentence(item, able[0])}')
    return 0


def _row(item: CandidateWorth) -> tuple[str, ...]:
    candidate = item.candidate
    place = (candidate.name, f'{candidate.instant_s / S_PER_MIN:.1f}',
             f'{candidate.charger_power_w / W_PER_KW:g}')
    if item.problem is not None or item.worth is None:
        return (*place, *('–',) * 10)
    best = item.worth.best
    return (*place, f'{100.0 * best.arrival_soc:.1f}', f'{100.0 * item.departure_soc:.1f}',
            'none' if best is item.worth.without_heating else f'{best.target_c:.1f}',
            f'{best.bought_energy_wh / WH_PER_KWH:.2f}', f'{best.charging_time_s / S_PER_MIN:.1f}',
            *(f'{cost:.2f}' for cost in (item.energy_cost, item.charging_cost, item.detour_cost,
                                         item.wait_cost, item.total_cost)))


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
