# SPDX-License-Identifier: Apache-2.0
"""The parser of `preheat`: one-line errors, suggestions, grouped commands, and completion by argcomplete."""

from __future__ import annotations

import argparse
from argparse import Action, ArgumentParser
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from importlib.util import find_spec
import os
import re
import sys
from typing import Any, NoReturn, TypeAlias

from bev_preheat.commands.program import REFUSED, say, write_output
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import configuration_folder

Subparsers: TypeAlias = 'argparse._SubParsersAction[argparse.ArgumentParser]'
# A group that requires exactly one argument.
Alternatives = argparse._MutuallyExclusiveGroup

# Negative numbers, which are never options. argparse's own pattern misses -7. and -1e1, and takes "-7C" for a
# missing value.
NEGATIVE_NUMBER = re.compile(r'-(\.?\d|inf|nan)', re.IGNORECASE)
# Set while the shell asks for completions; argcomplete then parses the typed words.
COMPLETING = '_ARGCOMPLETE'
# Options by other words that people try.
OTHER_WORDS = {
    '--car': '--vehicle', '--model': '--vehicle', '--battery': '--temperature',
    '--battery-temperature': '--temperature', '--start-temperature': '--temperature',
    '--state-of-charge': '--soc', '--charge': '--soc', '--start-soc': '--soc',
    '--track': '--route', '--gpx': '--route', '--trip': '--route', '--file': '--route', '--csv': '--route',
    '--outside-temperature': '--ambient', '--outside': '--ambient', '--weather': '--ambient',
    '--target-temperature': '--target', '--power': '--charger-power', '--price': '--energy-price',
    '--out': '--output', '--save': '--output', '--picture': '--plot', '--figure': '--plot', '--image': '--plot',
    '--map': '--signals', '--fix': '--repair', '--target-soc': '--departure-soc', '--until': '--departure-soc'}
NOT_INSTALLED = ('the studies, which measure the planner, are not installed; build bev_preheat without '
                 'BEV_PREHEAT_WITHOUT_STUDIES')


def option_group(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """Return the group of options with a title, which the help shows below the common ones."""
    return next((group for group in parser._action_groups if group.title == title),
                None) or parser.add_argument_group(title)


def given_options(arguments: argparse.Namespace, names: Iterable[str]) -> list[str]:
    """Return the options of the attributes that are given, as they are typed."""
    return [option_of(name) for name in names
            if getattr(arguments, name) is not None and getattr(arguments, name) is not False]


def option_of(name: str) -> str:
    """Return the option of an attribute of parsed arguments, as it is typed."""
    return f'--{name.replace("_", "-")}'


class GroupedHelp(argparse.HelpFormatter):
    """Shows subcommands below headings; `groups` maps each heading to the names below it."""

    def __init__(self, prog: str, groups: Mapping[str, Iterable[str]]) -> None:
        """Format the help of a program."""
        super().__init__(prog, max_help_position=16)
        self._groups = groups

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        below = {each.dest: each for each in action._get_subactions()}
        lines = []
        for title, names in self._groups.items():
            lines.append(f'{" " * self._current_indent}{title}:\n')
            self._indent()
            lines += [super(GroupedHelp, self)._format_action(below[name]) for name in names if name in below]
            self._dedent()
        return ''.join(lines)


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line, with a suggestion for a mistyped option or command."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Take the same arguments as argparse; invalid numbers are refused with the allowed form."""
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE_NUMBER
        self.register('type', float, partial(
            _number, float, 'is not a number; give it without a unit and with a decimal point'))
        self.register('type', int, partial(_number, int, 'is not a whole number; use digits only'))

    def parse_known_args(  # type: ignore[override]  # argparse has three forms for this one
            self, args: Sequence[str] | None = None,
            namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse as argparse does, but report a mistyped option before missing arguments."""
        given = sys.argv[1:] if args is None else args
        if self._subparsers is not None and COMPLETING not in os.environ:
            self._check_command(given)
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
                    near = [word for word in (OTHER_WORDS.get(option),) if word in known] or get_close_matches(
                        option, known, n=1)
                    if near:
                        self.error(f'unrecognized arguments: {option}; did you mean {near[0]}?')
        parsed, beyond = super().parse_known_args(args, namespace)
        if beyond:
            # argparse leaves that to the main parser, whose help does not list a subcommand's options.
            self.error(f'unrecognized arguments: {" ".join(beyond)}')
        return parsed, beyond

    def _check_command(self, given: Sequence[str]) -> None:
        """Print the help without any command, and refuse an unknown command, with the nearest."""
        if not given:
            self.print_help()
            self.exit()
        commands = next(action.choices for action in self._actions if isinstance(
            action, argparse._SubParsersAction))
        name = next((argument for argument in given if not argument.startswith('-')), None)
        if name is not None and name not in commands:
            near = get_close_matches(name, commands, n=1)
            hint = f'did you mean {self.prog} {near[0]}? ' if near else ''
            self.error(f'{quoted(name)} is no command; {hint}there are: {", ".join(commands)}')

    def print_help(self, file: Any = None) -> None:
        """Print the help; unlike argparse, report a full output."""
        write_output(self.format_help())

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and exit with status 2."""
        say(f'{self.prog}: error: {message}; see {self.prog} --help')
        self.exit(REFUSED)


def _number(kind: Callable[[str], float], problem: str, text: str) -> float:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{quoted(text)} {problem}') from None


class VersionAction(argparse.Action):
    """Prints the version of the package and ends the process."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: object, option_string: str | None = None) -> None:
        """Print the version and exit."""
        from bev_preheat.files.input_files import version
        write_output(f'{parser.prog} {version()}\n')
        parser.exit()


def completed_by(kind: str, argument: Action, suffix: str = '.yaml') -> None:
    """Complete an argument with the names in the folder `kind` of config/ and the paths of such files."""
    def complete(prefix: str, **_: object) -> list[str]:
        from argcomplete.completers import FilesCompleter
        names = [path.stem for path in configuration_folder(kind).glob(f'*{suffix}')]
        paths: list[str] = FilesCompleter(allowednames=(suffix,))(prefix)
        return sorted(name for name in names if name.startswith(prefix)) + paths

    argument.completer = complete  # type: ignore[attr-defined]  # argcomplete looks for it there


def complete(parser: ArgumentParser) -> None:
    """Answer a completion request of the shell and exit; otherwise return."""
    if COMPLETING not in os.environ:
        return
    try:
        import argcomplete
    except ModuleNotFoundError:
        raise SystemExit(1) from None
    argcomplete.autocomplete(parser)


def make_parser(subcommands: Mapping[str, str], groups: Mapping[str, Iterable[str]]) -> OneLineParser:
    """Return the parser of subcommands {name: module with add_parser(subparsers)}, below headings in the help."""
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

    def refuse(_: argparse.Namespace) -> NoReturn:
        raise InvalidInput(f'{name}: {NOT_INSTALLED}')

    parser.set_defaults(run=refuse)
