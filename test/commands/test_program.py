# SPDX-License-Identifier: Apache-2.0
"""End of the command-line programs: interrupted, with closed or full outputs."""

from importlib import import_module
import os
import re
import resource
import signal
import subprocess
import sys

import pytest

from bev_preheat.commands.program import run_program

PLAN = [sys.executable, '-m', 'bev_preheat', 'plan', '--vehicle', 'reference', '--route', 'reference',
        '--temperature', '-7', '--soc', '0.9']


@pytest.fixture(autouse=True)
def unmeasured(monkeypatch):
    """Switch coverage off, because it would write to the full output, too."""
    monkeypatch.delenv('COVERAGE_PROCESS_CONFIG', raising=False)


def ended(command, **options):
    """Return (exit status, standard output, standard error) of a command, bytes as Latin-1."""
    done = subprocess.run(command, stderr=subprocess.PIPE, timeout=100, check=False,
                          **{'stdout': subprocess.PIPE, **options})
    return done.returncode, (done.stdout or b'').decode('latin-1'), done.stderr.decode('latin-1')


@pytest.mark.costly
def test_nobody_reads_the_output():
    reader, writer = os.pipe()
    os.close(reader)
    assert ended(PLAN, stdout=writer) == (0, '', '')
    os.close(writer)


@pytest.mark.costly
@pytest.mark.parametrize('unbuffered', ['', pytest.param('1', id='unbuffered', marks=pytest.mark.deep)])
@pytest.mark.parametrize('command', [
    pytest.param(PLAN, id='table'), pytest.param([*PLAN, '--json', '-'], id='json'),
    pytest.param([*PLAN[:3], '--help'], id='help', marks=pytest.mark.deep),
    pytest.param([*PLAN[:3], '--version'], id='version', marks=pytest.mark.deep)])
def test_the_output_is_full(tmp_path, command, unbuffered):
    """Write to a file that may not grow, as on a full disk."""
    with open(tmp_path / 'output', 'wb') as file:
        status, _, errors = ended(
            command, stdout=file, env=dict(os.environ, PYTHONUNBUFFERED=unbuffered),
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)))
    assert (status, errors) == (
        1, 'preheat: error: standard output: cannot be written: File too large\n')


@pytest.mark.costly
@pytest.mark.parametrize('redirection, status', [
    pytest.param('>&-', 0, marks=pytest.mark.deep), pytest.param('2>&-', 0, marks=pytest.mark.deep),
    ('>&- 2>&-', 0)])
def test_closed_streams_are_no_error(redirection, status):
    assert ended(['sh', '-c', f'"$@" {redirection}', 'sh', *PLAN])[::2] == (status, '')


def test_interrupted_while_it_is_still_loading():
    """The signal comes with the first module imported after `main` has begun."""
    code = ('import os, signal, sys\n'
            'class Interrupting:\n'
            '    def find_spec(self, name, path=None, target=None):\n'
            '        if name == "bev_preheat.commands.parser":\n'
            '            os.kill(os.getpid(), signal.SIGINT)\n'
            'sys.meta_path.insert(0, Interrupting())\n'
            'from bev_preheat.commands.main import main\n'
            'sys.exit(main())\n')
    assert ended([sys.executable, '-c', code, '--version']) == (130, '', 'preheat: interrupted\n')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_one_line_and_130(capsys, number):
    before = signal.getsignal(number)
    assert run_program('work', lambda: lambda: os.kill(os.getpid(), number), ends_process=False) == 130
    assert capsys.readouterr() == ('', 'work: interrupted\n')
    assert signal.getsignal(number) is before


def test_a_signal_that_is_lost_in_a_callback_comes_again(capsys):
    class Interrupting:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)

    def work():
        thing = Interrupting()
        del thing
        signal.pause()

    assert run_program('work', lambda: work, ends_process=False) == 130
    assert capsys.readouterr().err == 'work: interrupted\n'


def test_it_comes_again_until_it_is_heard(tmp_path):
    """The first alarm comes before a call that waits for the next one, as one in the instant before would."""
    (tmp_path / 'wait.c').write_text(
        '#include <unistd.h>\nvoid wait_on(void);\nvoid wait_on(void) { usleep(60000); pause(); }\n')
    subprocess.run(['cc', '-shared', '-fPIC', '-o', 'wait.so', 'wait.c'], cwd=tmp_path, check=True)
    code = ('import ctypes, os, signal, sys\n'
            'from bev_preheat.commands.program import run_program\n'
            'class Interrupting:\n'
            '    def __del__(self):\n'
            '        os.kill(os.getpid(), signal.SIGINT)\n'
            'def work():\n'
            '    Interrupting()\n'
            f'    ctypes.CDLL({str(tmp_path / "wait.so")!r}).wait_on()\n'
            'sys.exit(run_program("work", lambda: work, ends_process=True))\n')
    assert ended([sys.executable, '-c', code]) == (130, '', 'work: interrupted\n')


def test_an_optional_package_that_is_missing_is_one_line_with_its_installation(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'scipy', None)
    assert run_program('work', lambda: import_module('scipy'), ends_process=False) == 2
    assert re.fullmatch('work: error: the Python package scipy, .* scripts/setup.bash identify installs it; .*\n',
                        capsys.readouterr().err)


def test_what_nobody_foresaw_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run_program('work', lambda: lambda: 1 / 0, ends_process=False)
