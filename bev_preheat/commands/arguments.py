# SPDX-License-Identifier: Apache-2.0
"""The parser of `preheat`: its subcommands, the version, shell completion."""

from __future__ import annotations

import argparse
from importlib import import_module
from typing import TYPE_CHECKING

from bev_preheat.commands.completion import complete
from bev_preheat.console.parser import OneLineParser, VersionAction

if TYPE_CHECKING:
    from collections.abc import Iterable

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]
    # Of which one argument must be given.
    Alternatives = argparse._MutuallyExclusiveGroup


def make_parser(subcommands: Iterable[str]) -> OneLineParser:
    """Return the parser; each subcommand is a module beside this one with add_parser(subparsers)."""
    parser = OneLineParser(
        prog='preheat',
        description='When to warm the battery of an electric vehicle before fast charging.')
    parser.add_argument('--version', action=VersionAction, nargs=0, help='print the version and exit')
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    for name in subcommands:
        import_module(f'bev_preheat.commands.{name.replace("-", "_")}').add_parser(subparsers)
    complete(parser)
    return parser
