# SPDX-License-Identifier: Apache-2.0
"""
Shared by all tests: the number of examples of property tests, the command line, and the marker of tests over DDS.

`make test` draws few examples and the same ones on every run, `make test-deep` many and new ones. A
property test that needs more or fewer than others says so as a multiple:
`@settings(max_examples=4 * settings.default.max_examples)`.

A test over DDS depends on the fixture `dds`, usually through `bench` or `module_bench`, and carries the marker of
that name. Without it ROS 2 does not start in the test nor in its processes, so no test over DDS gets into `make
test-quick` unnoticed. (Only a process that chooses a ROS domain of its own escapes, as the demonstration does:
`pytestmark = pytest.mark.usefixtures('dds')`.) With the fixture `ros`, usually through `rehearsal`, ROS 2 starts
in the test's own process, and its nodes neither find others nor are found.

Each of several workers imports every test file, although it runs only some. So modules that are slow to import and
needed by few tests (SciPy) are imported inside these tests. Objects from importing and collecting live
to the end, so the garbage collector need not search them repeatedly, which would take a twelfth of the run.
"""

import gc
import os
import sys
import threading

from hypothesis import HealthCheck, settings
import left_out
import pytest
import reaping

# Wall-clock limits on examples would make a test depend on the load of the machine.
UNTIMED = {'deadline': None, 'suppress_health_check': [HealthCheck.too_slow]}
settings.register_profile('daily', max_examples=16, derandomize=True, **UNTIMED)
settings.register_profile(
    'deep', max_examples=int(os.environ.get('BEV_PREHEAT_EXAMPLES', '1000')), print_blob=True,
    **UNTIMED)
settings.load_profile('daily')

NO_DOMAIN = 'none without the fixture dds'
# Beyond those of tests over DDS (bev_preheat.nodes.installed_drive.DOMAIN_IDS).
SILENT_DOMAIN = '101'

gc.disable()


def pytest_configure(config):
    """Skip the tests of optional packages that are not installed."""
    config.pluginmanager.register(left_out)


@pytest.fixture(scope='session', autouse=True)
def reaped():
    """Have the processes killed that tests leave behind, also if this process is killed."""
    guard = reaping.begin()
    yield
    guard.kill()
    guard.wait()
    # One that goes on keeps this process from ending: pytest-xdist kills it, and its coverage is lost.
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and not thread.daemon:
            thread.join(10.0)
            assert not thread.is_alive(), thread


@pytest.fixture
def said(capsys, tmp_path, monkeypatch):
    """Return (exit status, standard output, standard error) of `preheat` in a folder of its own."""
    from bev_preheat.commands.main import main
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '200')

    def run(*arguments):
        try:
            status = main([*map(str, arguments)])
        except SystemExit as end:
            # Of argparse.
            status = end.code
        return status, *capsys.readouterr()
    return run


@pytest.fixture
def refused(said):
    """Return the problem that `preheat` is refused for, in a single line, without output or a new file."""
    def run(*arguments):
        before = sorted(os.listdir())
        status, output, errors = said(*arguments)
        assert (status, output, errors.count('\n'), sorted(os.listdir())) == (2, '', 1, before), errors
        assert errors.startswith('preheat: error: ')
        return errors.removeprefix('preheat: error: ').rstrip('\n')
    return run


@pytest.fixture(scope='session')
def dds():
    """Mark every test that depends on this fixture as one over DDS."""


@pytest.fixture(scope='session')
def ros():
    """Let ROS 2 start in this process, without discovery."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Set the marker `dds` before pytest selects by markers."""
    for item in items:
        if 'dds' in item.fixturenames:
            item.add_marker(pytest.mark.dds)


def pytest_collection_finish():
    """Exempt all objects created so far from garbage collection."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Keep ROS 2 from starting in a test without the marker."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        if item.get_closest_marker('dds') is not None:
            pass
        elif 'ros' in item.fixturenames:
            monkeypatch.setenv('ROS_DOMAIN_ID', SILENT_DOMAIN)
            monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
        else:
            # In its processes rclpy.init() fails, and names this value.
            monkeypatch.setenv('ROS_DOMAIN_ID', NO_DOMAIN)
            if 'rclpy' in sys.modules:
                monkeypatch.setattr('rclpy.init', _refuse_to_start)
        yield


def _refuse_to_start(*arguments, **named):
    raise RuntimeError('a test over DDS needs the fixture dds (test/conftest.py)')
