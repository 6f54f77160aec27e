# SPDX-License-Identifier: Apache-2.0
"""
Shell completion, by argcomplete where it is installed.

The shell runs `preheat` with a variable set; argcomplete then writes what the word may become, and ends
the process. An argument that takes a name of config/ has a NameCompleter as its `completer`.
"""

import os

from bev_preheat.configuration import configuration_folder

ASKED = '_ARGCOMPLETE'


class NameCompleter:
    """Completes a name of config/, and the paths of files of the same kind."""

    def __init__(self, kind, suffix='.yaml'):
        """`kind` is the folder below config/."""
        self._kind = kind
        self._suffix = suffix

    def __call__(self, prefix, **_):
        """Return the names and paths that begin with a prefix."""
        names = [path.stem for path in configuration_folder(self._kind).glob(f'*{self._suffix}')]
        return sorted(name for name in names if name.startswith(prefix)) + self._files(prefix)

    def _files(self, prefix):
        from argcomplete.completers import FilesCompleter
        return FilesCompleter(allowednames=(self._suffix,))(prefix)


VEHICLES = NameCompleter('vehicles')
ROUTES = NameCompleter('routes', '.csv')


def complete(parser):
    """Answer the shell and end the process, if it was the shell that asked."""
    if ASKED not in os.environ:
        return
    try:
        import argcomplete
    except ModuleNotFoundError:
        raise SystemExit(1) from None
    argcomplete.autocomplete(parser)
