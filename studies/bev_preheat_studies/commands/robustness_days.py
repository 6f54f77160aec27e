# SPDX-License-Identifier: Apache-2.0
"""`preheat robustness --days`: chains of trips, charging and parking in a single process of the planner."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import write_json
from bev_preheat.console.terminal import (
    print_figures,
    print_records,
    progress_bar,
    progress_console,
    result_console,
)
from bev_preheat.errors import InvalidInput
from bev_preheat_studies.commands.study_arguments import study_executor
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.robustness.day_drives import day_from, drive_day, run_days
from bev_preheat_studies.robustness.day_figures import summarise_days

if TYPE_CHECKING:
    from argparse import Namespace
    from typing import Any

    from rich.console import Console

    from bev_preheat_studies.robustness.car_figures import Figures
    from bev_preheat_studies.robustness.day_drives import DayResult
    from bev_preheat_studies.robustness.drawn_cars import Conditions

# Routes on which each climb and each descent has its own heating interval.
HILLY = ('alpine_pass',)
# Most lines printed for false verdicts; the file of --json has all.
MOST_LINES = 10


def run_days_study(arguments: Namespace, conditions: Conditions, described: dict[str, Any],
                   study: dict[str, Any]) -> int:
    """Run the study of `arguments.trips` days, or a single day; returns 0."""
    if arguments.only is not None:
        if arguments.results is not None or arguments.cluster is not None:
            raise InvalidInput('--results and --cluster are for a whole study; --only runs a single day here')
        return _run_one(arguments, conditions, described)
    results: list[DayResult] = []
    with (keeping_what_is_finished() as ending,
          kept_results(arguments.results, {**study, 'study': 'days'}, day_from) as kept,
          study_executor(arguments) as executor,
          progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                       TimeElapsedColumn()) as progress):
        task = progress.add_task('days', total=arguments.trips)

        def report(result: DayResult) -> None:
            results.append(result)
            progress.update(task, advance=1)

        run_days(conditions, arguments.trips, arguments.seed, executor, report, kept.finished, kept.keep)
    if results:
        hilly = [number for number, name in enumerate(arguments.route) if Path(name).stem in HILLY]
        summary = summarise_days(results, conditions.fault != 'none', hilly)
        if arguments.json:
            write_json(arguments.json, {**described, 'days': arguments.trips, 'complete': ending.is_complete,
                                        'summary': summary, 'results': [asdict(result) for result in results]})
        console = result_console(arguments.json)
        if not ending.is_complete:
            console.print('Interrupted: only part of the study has run, '
                          f'{len(results)} of {arguments.trips} days.')
        print_days(console, summary, conditions.fault != 'none')
    ending.tell(len(results), arguments.trips, 'days', (arguments.json,), arguments.results)
    return 0


def _run_one(arguments: Namespace, conditions: Conditions, described: dict[str, Any]) -> int:
    with progress_console().status('driving …'):
        result = drive_day(conditions, arguments.seed, arguments.only)
    if arguments.json:
        write_json(arguments.json, {**described, 'result': asdict(result)})
    console = result_console(arguments.json)
    known = 'known' if result.knows_power else 'not known'
    console.print(f'day {result.number}: {result.hours:.1f} h, voltage and current {known}', soft_wrap=True)
    print_records(console, 'Trips', ('trip', 'route', "duration / route's", 'position known',
                                     'arrival error [K]', 'switch-ons'), [
        (str(trip.position + 1), arguments.route[trip.route], f'{trip.pace:.3f}', 'yes' if trip.is_told else 'no',
         '–' if trip.arrival_error_k is None else f'{trip.arrival_error_k:+.2f}', str(trip.switch_ons))
        for trip in result.trips], ('right', 'left', 'right', 'left', 'right', 'right'))
    for what, named in (('heater', result.heater_verdicts), ('signals', result.signal_verdicts)):
        console.print(f'{what}: {"; ".join(named) or "nothing was found"}', markup=False, soft_wrap=True)
    console.print(f'heated beyond the stated times: {result.heated_charging_s:.0f} s while charging, '
                  f'{result.heated_parked_s:.0f} s while parked', soft_wrap=True)
    return 0


def print_days(console: Console, summary: Figures, has_fault: bool) -> None:
    """Print the tables of a summary."""
    console.print(f'{summary["days"]} days with {summary["trips"]} trips, {summary["hours"]:.0f} h; '
                  f'{summary["cpu_s"]:.0f} s of processor time.', soft_wrap=True)
    groups = summary['arrival_error_k']
    print_figures(console, 'Arrival error [K]', ('trips', *groups), [
        (name, *(_text(group[key], form) for group in groups.values()))
        for name, key, form in (('number', 'trips', 'd'), ('5 %', '5 %', '+.2f'), ('median', 'median', '+.2f'),
                                ('95 %', '95 %', '+.2f'), ('worst', 'worst', '+.2f'))])
    charging, parked, switch_ons = (summary[key] for key in ('heated_charging_s', 'heated_parked_s', 'switch_ons'))
    rows = [(f'Heating {what}, beyond the stated time, {which} [s]', f'{times[key]["total"]:.0f}',
             f'{times[key]["most"]:.0f}')
            for what, times in (('while charging', charging), ('while parked', parked))
            for which, key in (('voltage and current known', 'with power'), ('not known', 'without'))]
    rows.append(('Switch-ons per trip, except over hills', f'mean {switch_ons["mean"]:.2f}',
                 str(switch_ons['most'])))
    rows.append(('Switch-ons per trip, over hills', '', str(switch_ons['most over hills'])))
    print_figures(console, 'In all days', ('', 'all', 'most in one'), rows)
    if has_fault:
        fault = summary['fault']
        found = None if fault['found'] is None else 100.0 * fault['found']
        console.print(
            f'Heater fault: has an effect on {fault["shown"]} days, found on {_text(found, ".0f")} % of '
            f'them, after {_text(fault["median_s"], ".0f")} s of driving (median), '
            f'{_text(fault["most_s"], ".0f")} s (maximum).',
            soft_wrap=True)
    print_records(console, 'Requirements', ('', 'bound', ''), [
        (each['name'], each['bound'], _judged(each)) for each in summary['requirements']],
        ('left', 'left', 'right'))
    for what, key in (('heater', 'heater_accused'), ('signals', 'signals_accused')):
        lines = summary[key]
        for line in lines[:MOST_LINES]:
            console.print(f'{what}: {line}', markup=False, soft_wrap=True)
        if len(lines) > MOST_LINES:
            console.print(f'{what}: … {len(lines) - MOST_LINES} more')


def _judged(requirement: Figures) -> Text:
    value = requirement['value']
    if requirement['met'] is None:
        return Text('no trip to compare')
    colour, verdict = ('green', 'met') if requirement['met'] else ('red', 'not met')
    text = _text(value, 'd' if isinstance(value, int) else '+.2f' if requirement['unit'] == 'K' else '.0f')
    return Text.assemble(f'{text} {requirement["unit"]}'.rstrip(), ' ', (verdict, colour))


def _text(value: float | None, form: str) -> str:
    return '–' if value is None else format(value, form)
