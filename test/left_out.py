# SPDX-License-Identifier: Apache-2.0
"""
Skip the tests of optional packages that are not installed; the end of the run says how to install them.

A test is marked `needs('casadi', 'scipy')`, runs the installed nlp_checker, or its module imports the package.
`make test`, whose setup installs the optional packages, runs all tests.
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
    """A module that is skipped if a direct or indirect import is not installed."""

    def collect(self):
        try:
            return list(super().collect())
        except self.CollectError as error:
            package = getattr(error.__cause__, 'name', None)
            if not isinstance(error.__cause__, ModuleNotFoundError) or package not in PACKAGES:
                raise
            pytest.skip(how_to_install(package), allow_module_level=True)


def pytest_pycollect_makemodule(module_path, parent):
    """Collect each test module as a module that may be skipped."""
    return _Module.from_parent(parent, path=module_path)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Skip a test that is marked with packages, if one is not installed."""
    needed = {package for mark in item.iter_markers('needs') for package in mark.args}
    # The executable ends at once without it.
    if hasattr(item, 'callspec') and 'nlp_checker' in item.callspec.params.values():
        needed.add('casadi')
    for package in sorted(needed):
        if not is_there(package):
            pytest.skip(how_to_install(package))
