# SPDX-License-Identifier: Apache-2.0
"""A command line parser with one-line errors, and the option --version."""

from __future__ import annotations

import argparse
from difflib import get_close_matches
import re
from typing import TYPE_CHECKING

from bev_preheat.console.program import REFUSED, say, write_output
from bev_preheat.errors import quoted

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any, NoReturn


# Negative numbers, which are never options. argparse's own pattern misses -7. and -1e1, and takes "-7C" for a
# missing value.
NEGATIVE_NUMBER = re.compile(r'-(\.?\d|inf|nan)', re.IGNORECASE)


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line, with a suggestion for a mistyped option."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Take the same arguments as argparse; invalid numbers are refused with the allowed form."""
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE_NUMBER
        self.register('type', float, _number)
        self.register('type', int, _whole_number)

    def parse_known_args(  # type: ignore[override]  # argparse has three forms for this one
            self, args: Sequence[str] | None = None,
            namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse as argparse does, but report a mistyped option before missing arguments."""
        known = [option for action in self._actions for option in action.option_strings]
        if known and args is not None and self._subparsers is None:
            for argument in args:
                if argument == '--':
                    break
                option, _, value = argument.partition('=')
                if option.startswith('--') and value == '--':
                    # argparse would take it for no value at all.
                    self.error(f"argument {option}: '--' is not allowed")
                # A unique prefix of an option is enough.
                if option.startswith('--') and not any(
                        name.startswith(option) for name in known):
                    near = get_close_matches(option, known, n=1)
                    if near:
                        self.error(f'unrecognized arguments: {option}; did you mean {near[0]}?')
        parsed, beyond = super().parse_known_args(args, namespace)
        if beyond:
            # argparse leaves that to the main parser, whose help does not list a subcommand's options.
            self.error(f'unrecognized arguments: {" ".join(beyond)}')
        return parsed, beyond

    def print_help(self, file: Any = None) -> None:
        """Print the help; unlike argparse, report a full output."""
        write_output(self.format_help())

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and exit with status 2."""
        say(f'{self.prog}: error: {message}; see {self.prog} --help')
        self.exit(REFUSED)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{quoted(text)} is not a number; give it without a unit and with a decimal point') from None


def _whole_number(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{quoted(text)} is not a whole number; use digits only') from None


class VersionAction(argparse.Action):
    """Prints the version of the package and ends the process."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: object, option_string: str | None = None) -> None:
        """Print the version and exit."""
        from bev_preheat.files.version import version
        write_output(f'{parser.prog} {version()}\n')
        parser.exit()
