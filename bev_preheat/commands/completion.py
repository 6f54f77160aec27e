# SPDX-License-Identifier: Apache-2.0
"""
Shell completion with argcomplete, if it is installed.

The shell runs `preheat` with a variable set; argcomplete then writes the possible completions and exits
the process. An argument that takes a name of config/ is completed_by() a NameCompleter.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from bev_preheat.commands.parser import COMPLETING
from bev_preheat.files.configuration import configuration_folder

if TYPE_CHECKING:
    from argparse import Action, ArgumentParser


class NameCompleter:
    """Completes a name of config/, and the paths of files of the same kind."""

    def __init__(self, kind: str, suffix: str = '.yaml') -> None:
        """Complete names of the folder `kind` below config/."""
        self._kind = kind
        self._suffix = suffix

    def __call__(self, prefix: str, **_: object) -> list[str]:
        """Return the names and paths that begin with a prefix."""
        names = [path.stem for path in configuration_folder(self._kind).glob(f'*{self._suffix}')]
        return sorted(name for name in names if name.startswith(prefix)) + self._files(prefix)

    def _files(self, prefix: str) -> list[str]:
        from argcomplete.completers import FilesCompleter
        paths: list[str] = FilesCompleter(allowednames=(self._suffix,))(prefix)
        return paths


VEHICLES = NameCompleter('vehicles')
ROUTES = NameCompleter('routes', '.csv')


def completed_by(completer: NameCompleter, argument: Action) -> None:
    """Attach a completer to an argument of the command line."""
    argument.completer = completer  # type: ignore[attr-defined]  # argcomplete looks for it there


def complete(parser: ArgumentParser) -> None:
    """Answer a completion request of the shell and exit; otherwise return."""
    if COMPLETING not in os.environ:
        return
    try:
        import argcomplete
    except ModuleNotFoundError:
        raise SystemExit(1) from None
    argcomplete.autocomplete(parser)
