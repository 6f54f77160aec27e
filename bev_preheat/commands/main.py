# SPDX-License-Identifier: Apache-2.0
"""`preheat`: the offline command line. Each subcommand is a module of this folder or of the studies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys

from bev_preheat.commands.program import loading, run_program

# The subcommands, grouped by what people do.
GROUPS = {
    'plan a drive': ('plan', 'worth', 'charge', 'route', 'compare', 'optimum'),
    'your car': ('vehicle', 'identify', 'export-ecu'),
    'your drives': ('log', 'check'),
    'a running planner': ('prepare', 'replay'),
    'studies': ('scenario', 'sweep', 'robustness', 'reproduce')}
# The studies are a separate, optional package.
STUDIES = {
    'sweep': 'bev_preheat_studies.optimality.sweep',
    'robustness': 'bev_preheat_studies.robustness.command',
    'reproduce': 'bev_preheat_studies.table_two'}
# Each module has add_parser(subparsers), which sets `run`, a function of the parsed arguments that returns the
# exit status.
SUBCOMMANDS = {name: STUDIES.get(name, f'bev_preheat.commands.{name.replace("-", "_")}')
               for names in GROUPS.values() for name in names}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit status: 0, or 2 for refused input; None: the process's arguments."""
    if arguments is None:
        loading('preheat')
    return run_program('preheat', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    # Loading is slow enough to be interrupted, so it happens within `main`.
    from bev_preheat.commands.parser import make_parser
    first = (sys.argv[1:] if arguments is None else arguments)[:1]
    # A known command imports only its own module; the help, completion and an unknown command import all.
    wanted = {name: SUBCOMMANDS[name] for name in first if name in SUBCOMMANDS} or SUBCOMMANDS
    parsed = make_parser(wanted, GROUPS).parse_args(arguments)
    return lambda: parsed.run(parsed)
