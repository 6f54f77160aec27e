# SPDX-License-Identifier: Apache-2.0
"""`preheat sweep --fleet`: the savings of preheating at the charger for a winter fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import write_json
from bev_preheat.console.terminal import print_figures, print_records, progress_bar, result_console
from bev_preheat_studies.commands.study_arguments import check_study_arguments, study_executor
from bev_preheat_studies.sources import digest_of

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from rich.console import Console

    from bev_preheat.console.finished import InterruptedEnding
    from bev_preheat_studies.fleet.fleet_figures import Figures
    from bev_preheat_studies.fleet.fleet_study import TripBlock
    from bev_preheat_studies.fleet.tally import Tally

# Rows of the table: heading, value from a way's figures, format.
ROWS = (
    ('Heater before arrival [kWh]', lambda figures: figures['heater_kwh'], '.2f'),
    ('Battery on arrival [degC]', lambda figures: figures['arrival_c'], '.1f'),
    ('Target reached [%]', lambda figures: _percent(figures['reached']), '.0f'),
    ('At the charger [min]', lambda figures: figures['charging_min'], '.1f'),
    ('… saved, mean', lambda figures: figures['saved_min']['mean'], '+.1f'),
    ('… 5 %', lambda figures: figures['saved_min'].get('5 %'), '+.1f'),
    ('… median', lambda figures: figures['saved_min'].get('median'), '+.1f'),
    ('… 95 %', lambda figures: figures['saved_min'].get('95 %'), '+.1f'),
    ('Energy bought [kWh]', lambda figures: figures['bought_kwh'], '.2f'),
    ('… more, mean', lambda figures: figures['more_kwh']['mean'], '+.2f'),
    ('… 5 %', lambda figures: figures['more_kwh'].get('5 %'), '+.2f'),
    ('… median', lambda figures: figures['more_kwh'].get('median'), '+.2f'),
    ('… 95 %', lambda figures: figures['more_kwh'].get('95 %'), '+.2f'),
)


def run_fleet_sweep(arguments: Namespace) -> int:
    """Run a fleet; returns 0. An interrupted run is summarised up to that point."""
    from bev_preheat_studies.fleet.drawn_fleet import BLOCK, CARS, vehicle_of
    from bev_preheat_studies.fleet.fleet_figures import drawn
    from bev_preheat_studies.fleet.fleet_study import kept_fleet, run_fleet
    from bev_preheat_studies.fleet.tally import Tally
    check_study_arguments(arguments, ())
    study = {'study': 'fleet', 'seed': arguments.seed, 'block': BLOCK, 'drawn': digest_of(drawn()),
             'vehicles': digest_of([vehicle_of(car) for car in CARS])}
    tally = Tally()
    with (keeping_what_is_finished() as ending,
          kept_fleet(arguments.results, study, arguments.fleet) as kept,
          study_executor(arguments) as executor,
          progress_bar(TextColumn('trips'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                       TimeRemainingColumn()) as progress):
        tally = kept.tally
        task = progress.add_task('trips', total=arguments.fleet, completed=tally.counted)

        def report(block: TripBlock) -> None:
            nonlocal tally
            # An interruption never leaves a block half counted.
            tally = tally.with_other(block.tally)
            progress.update(task, completed=tally.counted)

        run_fleet(arguments.fleet, arguments.seed, executor, report, kept.finished, kept.keep)
    finished = tally.counted
    if finished:
        _give_out(arguments, tally, finished, ending)
    ending.tell(finished, arguments.fleet, 'trips', (arguments.json, arguments.plot), arguments.results)
    return 0


def _give_out(arguments: Namespace, tally: Tally, finished: int, ending: InterruptedEnding) -> None:
    from bev_preheat_studies.fleet.fleet_figures import drawn, summarise_fleet
    summary = summarise_fleet(tally)
    if arguments.json:
        write_json(arguments.json, {'fleet': arguments.fleet, 'seed': arguments.seed,
                                    'complete': ending.is_complete, 'drawn': drawn(),
                                    'summary': summary})
    if arguments.plot:
        from bev_preheat_studies.drawing.fleet_figure import draw_fleet
        draw_fleet(arguments.plot, summary)
    console = result_console(arguments.json)
    if not ending.is_complete:
        console.print(f'Interrupted: only part of the study has run, {finished} of {arguments.fleet} trips.')
    print_fleet(console, summary)


def print_fleet(console: Console, summary: Figures) -> None:
    """Print the tables of a fleet's summary."""
    from bev_preheat_studies.fleet.drawn_fleet import CARS
    from bev_preheat_studies.fleet.tally import ALL, AMBIENTS, LENGTHS
    from bev_preheat_studies.fleet.ways import NONE, WAYS
    groups = summary['groups']
    left_out = ''.join(f', {count} left out: {reason}' for reason, count in summary['left_out'].items())
    console.print(f'{summary["trips"]} trips{left_out}', soft_wrap=True)
    print_figures(console, 'A winter fleet at the charger; saved and more: relative to no heating', ('', *WAYS), [
        (heading, *(_text(figure(groups[ALL]['ways'][way]), form) for way in WAYS))
        for heading, figure, form in ROWS])
    heated = [way for way in WAYS if way != NONE]
    for title, names in (('By air temperature', AMBIENTS), ('By driving time to the charger', LENGTHS),
                         ('By car', list(CARS))):
        print_records(
            console, f'{title}: mean minutes saved/additional kWh bought',
            ('', 'trips [%]', 'none [degC]', 'none [min]', *heated),
            [_row(name, groups[name], summary['trips'], heated) for name in names if groups[name]['trips']],
            ('left', *['right'] * (3 + len(heated))))


def _row(name: str, group: Figures, trips: int, heated: Sequence[str]) -> list[str]:
    ways = group['ways']
    unheated = next(iter(ways.values()))
    return [name, f'{100.0 * group["trips"] / trips:.1f}', f'{unheated["arrival_c"]:.1f}',
            f'{unheated["charging_min"]:.1f}',
            *(f'{ways[way]["saved_min"]["mean"]:+.1f}/{ways[way]["more_kwh"]["mean"]:+.2f}'
              for way in heated)]


def _text(value: float | None, form: str) -> str:
    return '–' if value is None else format(value, form)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share
