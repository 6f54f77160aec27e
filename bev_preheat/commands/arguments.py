# SPDX-License-Identifier: Apache-2.0
"""The parser of `preheat`: its subcommands, the version, shell completion."""

from __future__ import annotations

import argparse
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from bev_preheat.commands.completion import complete
from bev_preheat.commands.parser import GroupedHelp, OneLineParser, VersionAction
from bev_preheat.errors import InvalidInput

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]
    # A group that requires exactly one argument.
    Alternatives = argparse._MutuallyExclusiveGroup

NOT_INSTALLED = ('the studies, which measure the planner, are not installed; build bev_preheat without '
                 'BEV_PREHEAT_WITHOUT_STUDIES')


def make_parser(subcommands: Mapping[str, str], groups: Mapping[str, Iterable[str]]) -> OneLineParser:
    """
    Return the parser of subcommands {name: module}; a module has add_parser(subparsers).

    `groups` are the headings in the help, with the names below each.
    """
    parser = OneLineParser(
        prog='preheat', formatter_class=partial(GroupedHelp, groups=groups),
        description='When to warm the battery of an electric vehicle before fast charging.')
    parser.add_argument('--version', action=VersionAction, nargs=0, help='print the version and exit')
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND', title='commands',
                                       parser_class=OneLineParser)
    for name, module in subcommands.items():
        if find_spec(module.partition('.')[0]) is None:
            _add_missing(subparsers, name)
        else:
            import_module(module).add_parser(subparsers)
    complete(parser)
    return parser


def _add_missing(subparsers: argparse._SubParsersAction[OneLineParser], name: str) -> None:
    """Add a subcommand whose package is not installed; it is refused with any arguments."""
    # No argument begins with a NUL, so argparse treats none as an option.
    parser = subparsers.add_parser(name, help='a study; not installed', add_help=False, prefix_chars='\0')
    parser.add_argument('arguments', nargs='*')
    parser.set_defaults(run=lambda _: _refuse(name))


def _refuse(name: str) -> int:
    raise InvalidInput(f'{name}: {NOT_INSTALLED}')
