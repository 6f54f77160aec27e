# SPDX-License-Identifier: Apache-2.0
"""
Leave out the tests of optional packages that are not installed, and report their names.

A test is marked `needs('casadi')`, runs the installed nlp_checker, or its module imports the package. The end of
the run reports the left-out tests and how to install the packages, one line each: no test
is skipped silently, and `make test`, whose setup installs the optional packages, runs all tests.
"""

from functools import cache
from importlib.util import find_spec
import shutil

import pytest

from bev_preheat.optional_packages import advice, is_installed, PACKAGES

# Only for tests; not part of the product's optional packages.
LINTERS = frozenset(('ament_flake8', 'ament_pep257'))
# Programs by their usual names, and the package of Debian and Ubuntu.
PROGRAMS = {'chromium': (('chromium', 'chromium-browser', 'google-chrome'), 'chromium'),
            'chromedriver': (('chromedriver', 'chromium.chromedriver'), 'chromium-driver')}
LEFT_OUT = pytest.StashKey()


def begin(config):
    """Start without omissions: {package: [modules, number of tests]}."""
    config.stash[LEFT_OUT] = {}


def how_to_install(package):
    """Return the sentence that says that a package is missing, and how to install it."""
    if package in PROGRAMS:
        return f'{package} is not installed; Debian, Ubuntu: sudo apt install {PROGRAMS[package][1]}'
    if package == 'selenium':
        return ('the Python package selenium, which drives a browser, is not installed; in the checkout, '
                'scripts/setup.bash test installs it; elsewhere: python3 -m pip install selenium')
    if package in LINTERS:
        return (f'{package} is not installed; in the checkout, scripts/setup.bash lint installs it; elsewhere: '
                f'sudo apt install ros-jazzy-{package.replace("_", "-")}')
    return advice(package)


def program(name):
    """Return the path of a program of PROGRAMS, None without it."""
    return next(filter(None, map(shutil.which, PROGRAMS[name][0])), None)


@cache
def is_there(package):
    """Return whether a package or a program of PROGRAMS is installed."""
    if package in PROGRAMS:
        return program(package) is not None
    return find_spec(package) is not None if package == 'selenium' else is_installed(package)


class _Module(pytest.Module):
    """A module that is left out if a direct or indirect import is not installed."""

    def collect(self):
        try:
            return list(super().collect())
        except self.CollectError as error:
            package = getattr(error.__cause__, 'name', None)
            if not isinstance(error.__cause__, ModuleNotFoundError) or package not in PACKAGES:
                raise
            name = self.path.relative_to(self.config.rootpath).as_posix()
            self.config.stash[LEFT_OUT].setdefault(package, [set(), 0])[0].add(name)
            return []


def pytest_pycollect_makemodule(module_path, parent):
    """Collect each test module as a module that may be left out."""
    return _Module.from_parent(parent, path=module_path)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Leave out the tests that are marked with a package that is not installed."""
    kept, missing = [], []
    for item in items:
        needed = {mark.args[0] for mark in item.iter_markers('needs')}
        # The executable ends at once without it.
        if hasattr(item, 'callspec') and 'nlp_checker' in item.callspec.params.values():
            needed.add('casadi')
        packages = [package for package in sorted(needed) if not is_there(package)]
        (missing if packages else kept).append(item)
        for package in packages:
            config.stash[LEFT_OUT].setdefault(package, [set(), 0])[1] += 1
    if missing:
        config.hook.pytest_deselected(items=missing)
        items[:] = kept


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Copy the report of an xdist worker: each worker collects all tests."""
    # A worker that has crashed has no output, and xdist is about to give the reason.
    left_out = getattr(node, 'workeroutput', {}).get('left_out')
    if left_out is not None:
        node.config.stash[LEFT_OUT] = {
            package: (set(modules), count) for package, (modules, count) in left_out.items()}


def pytest_sessionfinish(session):
    """Send the report of an xdist worker to the main process, which prints."""
    if hasattr(session.config, 'workeroutput'):
        session.config.workeroutput['left_out'] = {
            package: [sorted(modules), count]
            for package, (modules, count) in session.config.stash[LEFT_OUT].items()}


def pytest_terminal_summary(terminalreporter, config):
    """Print the left-out tests, one line per package."""
    for package, (modules, count) in sorted(config.stash[LEFT_OUT].items()):
        left_out = [*sorted(modules), f'{count} tests elsewhere' if modules else f'{count} tests']
        terminalreporter.write_line(f'NOT RUN: {", ".join(left_out)}: {how_to_install(package)}', yellow=True)
