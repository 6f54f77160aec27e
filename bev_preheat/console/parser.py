# SPDX-License-Identifier: Apache-2.0
"""A parser of command lines that refuses in one line, and the option --version."""

import argparse
from difflib import get_close_matches

from bev_preheat.console.program import REFUSED, say, write_output


class OneLineParser(argparse.ArgumentParser):
    """A parser that refuses in one line, and names the option that was probably meant."""

    def parse_known_args(self, args=None, namespace=None):
        """Parse as argparse does, but refuse a mistyped option before what is missing without it."""
        known = [option for action in self._actions for option in action.option_strings]
        if known and args is not None and self._subparsers is None:
            for argument in args:
                if argument == '--':
                    break
                option = argument.partition('=')[0]
                # The beginning of an option is enough, where there is only one.
                if option.startswith('--') and not any(
                        name.startswith(option) for name in known):
                    near = get_close_matches(option, known, n=1)
                    if near:
                        self.error(f'unrecognized arguments: {option}; did you mean {near[0]}?')
        return super().parse_known_args(args, namespace)

    def print_help(self, file=None):
        """Print the help; argparse would keep it to itself that the output is full."""
        write_output(self.format_help())

    def error(self, message):
        """Print one line on standard error and exit with status 2."""
        say(f'{self.prog}: error: {message}; see {self.prog} --help')
        self.exit(REFUSED)


class VersionAction(argparse.Action):
    """Prints the version of the package and ends the process."""

    def __call__(self, parser, namespace, values, option_string=None):
        """Print it."""
        from bev_preheat.version import version
        write_output(f'{parser.prog} {version()}\n')
        parser.exit()
