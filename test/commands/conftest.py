# SPDX-License-Identifier: Apache-2.0
"""Fixtures that run a command as a user does: status, output, errors."""

import pytest

from bev_preheat.commands.main import main


@pytest.fixture
def said(capsys, tmp_path, monkeypatch):
    """Return (exit status, standard output, standard error) of a command in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '200')

    def run(*arguments):
        try:
            status = main(list(arguments))
        except SystemExit as end:
            # Of argparse.
            status = end.code
        return status, *capsys.readouterr()
    return run


@pytest.fixture
def refused(said):
    """Return the problem that a command is refused for, in a single line and without any output."""
    def run(*arguments):
        status, output, errors = said(*arguments)
        assert (status, output, errors.count('\n')) == (2, '', 1), errors
        assert errors.startswith('preheat: error: ')
        return errors.removeprefix('preheat: error: ').rstrip('\n')
    return run
