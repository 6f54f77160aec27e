# SPDX-License-Identifier: Apache-2.0
"""`python3 -m bev_preheat_studies STUDY`: the studies that measure the planner, and the benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys

from bev_preheat.commands.program import loading, run_program

# Each module has add_parser(subparsers), which sets `run`. `preheat` has the first three, too.
STUDIES = {
    'robustness': 'robustness.command', 'sweep': 'optimality.sweep', 'reproduce': 'table_two',
    'best_target': 'optimality.best_target', 'arrival_range': 'optimality.arrival_range',
    'uncertain_charging': 'optimality.uncertain_charging', 'heat_sources': 'optimality.heat_sources',
    'summer': 'optimality.summer',
    'fleet': 'fleet.study', 'identification': 'identification.study', 'tunables': 'tunables',
    'value_picture': 'value_picture', 'published': 'published', 'cost': 'cost.benchmark', 'soak': 'soak.command'}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a study; returns the exit status. `arguments` None: those of the process, which then ends."""
    if arguments is None:
        loading('studies')
    return run_program('studies', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    # Loading is slow enough to be interrupted, so it happens within `main`.
    from importlib import import_module

    from bev_preheat.commands.parser import OneLineParser
    first = (sys.argv[1:] if arguments is None else arguments)[:1]
    parser = OneLineParser(prog='python3 -m bev_preheat_studies', description='Studies that measure the planner.')
    subparsers = parser.add_subparsers(required=True, metavar='STUDY', title='studies', parser_class=OneLineParser)
    # A known study imports only its own module; the help and an unknown study import all.
    for name in [name for name in first if name in STUDIES] or STUDIES:
        import_module(f'bev_preheat_studies.{STUDIES[name]}').add_parser(subparsers)
    parsed = parser.parse_args(arguments)
    return lambda: parsed.run(parsed)


if __name__ == '__main__':
    sys.exit(main())
