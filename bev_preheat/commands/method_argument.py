# SPDX-License-Identifier: Apache-2.0
"""Options that name planning methods, built-in ones and those of installed packages."""

from __future__ import annotations

from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

from bev_preheat.commands.parser import option_group
from bev_preheat.commands.program import say
from bev_preheat.commands.situation import LESS_COMMON
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import (
    check_method,
    DEFAULT_METHOD,
    method_names,
    METHODS,
    REPLACED,
    replaced_in_words,
)

if TYPE_CHECKING:
    from argparse import ArgumentParser
    from collections.abc import Iterator


class MethodNames:
    """The names of all methods for argparse; installed packages are searched only if a name is not built in."""

    def __init__(self, *more: str) -> None:
        """Allow `more` names than those of methods."""
        self._more = more

    def __contains__(self, name: object) -> bool:
        """Return whether a name is allowed."""
        return name in self._more or name in METHODS or name in method_names()

    def __iter__(self) -> Iterator[str]:
        """Iterate over all names, as help and completion do."""
        return iter((*self._more, *method_names()))

    def checked(self, name: str) -> str:
        """
        Return an allowed name, as the `type` of an option; a method of a package is loaded.

        For a method of earlier versions, say what took its place, and return that.
        """
        if name in REPLACED:
            say(f'preheat: {replaced_in_words(name)}')
            return REPLACED[name]
        if name not in self._more:
            try:
                check_method(name)
            except InvalidInput as error:
                also = f'; also allowed: {", ".join(self._more)}' if self._more else ''
                raise ArgumentTypeError(f'{str(error).removeprefix("method: ")}{also}') from None
        return name


def add_method_argument(parser: ArgumentParser) -> None:
    """Add `--method`."""
    names = MethodNames()
    option_group(parser, LESS_COMMON).add_argument(
        '--method', choices=names, type=names.checked, default=DEFAULT_METHOD, metavar='NAME',
        help='planning method: %(choices)s (default: %(default)s)')


def add_methods_argument(parser: ArgumentParser, default: str) -> None:
    """Add `--methods`, None by default; `default` is the help's word for None."""
    names = MethodNames()
    parser.add_argument('--methods', nargs='+', choices=names, type=names.checked, metavar='NAME',
                        help=f'planning methods, of %(choices)s (default: {default})')
