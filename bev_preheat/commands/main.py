# SPDX-License-Identifier: Apache-2.0
"""`preheat`: the offline command line. Each subcommand is a module of this folder."""

from __future__ import annotations

from bev_preheat.console.program import loading, run_program

# As in typing, which takes a while to load.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

# Modules, with an underscore for a hyphen, with add_parser(subparsers), which sets `run`, a function of
# the parsed arguments that returns the exit status.
SUBCOMMANDS = ('plan', 'charge', 'worth', 'optimum', 'compare', 'reproduce', 'sweep', 'robustness',
               'scenario', 'route', 'vehicle', 'export-ecu', 'monitor', 'prepare')


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run one subcommand and return its exit status: 0, or 2 where input was refused.

    `arguments` None: those of the process, which is to end then.
    """
    if arguments is None:
        loading('preheat')
    return run_program('preheat', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    # Loading takes so long that it may be interrupted, so nothing of it comes before `main`.
    from bev_preheat.commands.arguments import make_parser
    parsed = make_parser(SUBCOMMANDS).parse_args(arguments)
    return lambda: parsed.run(parsed)
