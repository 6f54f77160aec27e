# SPDX-License-Identifier: Apache-2.0
"""`preheat robustness --signals`: faulty battery states in drawn cars."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import write_json
from bev_preheat.console.terminal import print_records, progress_bar, result_console
from bev_preheat_studies.commands.study_arguments import study_executor
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.robustness.signal_cases import (
    case_from,
    CASES,
    NAMED_WITHIN_S,
    run_cases,
    summarise_cases,
)

if TYPE_CHECKING:
    from argparse import Namespace
    from typing import Any

    from bev_preheat_studies.robustness.drawn_cars import Conditions
    from bev_preheat_studies.robustness.signal_cases import SignalResult

# Simulated part of each route [s].
DRIVEN_S = 1500.0


def run_signals_study(arguments: Namespace, conditions: Conditions, described: dict[str, Any],
                      study: dict[str, Any]) -> int:
    """Run all cases in `arguments.trips` cars; returns 0."""
    conditions = replace(conditions, routes=tuple(
        route.before(min(DRIVEN_S, route.total_duration_s)) for route in conditions.routes))
    results: list[SignalResult] = []
    total = arguments.trips * len(CASES)
    with (keeping_what_is_finished() as ending,
          kept_results(arguments.results, {**study, 'study': 'signals'}, case_from) as kept,
          study_executor(arguments) as executor,
          progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                       TimeElapsedColumn()) as progress):
        task = progress.add_task('drives', total=total)

        def report(result: SignalResult) -> None:
            results.append(result)
            progress.update(task, advance=1)

        run_cases(conditions, arguments.trips, arguments.seed, executor, report, kept.finished, kept.keep)
    if results:
        summary = summarise_cases(results)
        if arguments.json:
            write_json(arguments.json, {**described, 'cars': arguments.trips, 'complete': ending.is_complete,
                                        'summary': summary, 'results': [asdict(result) for result in results]})
        console = result_console(arguments.json)
        print_records(
            console, 'Faulty signals',
            ('case', 'cars', 'reported [%]', f'within {NAMED_WITHIN_S:.0f} s [%]', 'after, median [s]',
             '… most [s]', 'heater blamed', 'others reported', 'most switch-ons'),
            [(name, str(each['cars']), f'{100 * each["named"]:.0f}', f'{100 * each["in_time"]:.0f}',
              _seconds(each['median_s']), _seconds(each['worst_s']), str(each['heater_accused']),
              str(each['others_named']), str(each['most_switch_ons'])) for name, each in summary.items()],
            ('left', *8 * ('right',)))
    ending.tell(len(results), total, 'drives', (arguments.json,), arguments.results)
    return 0


def _seconds(value: float | None) -> str:
    return '–' if value is None else f'{value:.0f}'
