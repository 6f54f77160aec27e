# SPDX-License-Identifier: Apache-2.0
"""
Print the packages missing from this Python, for pip; with --constraints the packages that must stay as is.

Run by setup.bash with the Python of .venv on a machine with a ROS 2 distribution. Builds need the packages of
requirements.txt; the arguments are the groups needed in addition. A package of the system that is at least the
oldest supported version is used; an older or absent one is to be installed in a version up to the tested one.
"""

import argparse
from importlib import metadata
from pathlib import Path
import re

SCRIPTS = Path(__file__).resolve().parent
# Extensions of colcon's command line for a build of the packages, and their own dependencies.
BUILD = re.compile('colcon-|setuptools$')
# Of these files only the packages of requirements-oldest.txt are wanted; the distribution brings what those need.
WITH_OLDEST = ('requirements.txt', 'requirements-demo.txt', 'requirements-test.txt')
# Mark of packages that do not work with the NumPy of a distribution.
WHEELS_ONLY = 'wheels'


def pinned(file, group=None):
    """
    Return {package: version} of a requirement file, with a group: of the lines that name it.

    Of several lines for a package the first counts.
    """
    versions = {}
    path = SCRIPTS / file
    for name, version, groups in re.findall(
            r'^([\w.-]+)==([\w.]+)(?: *#(.*))?', path.read_text() if path.exists() else '', re.M):
        if WHEELS_ONLY not in groups.split() and group in (None, *groups.split()):
            versions.setdefault(name, version)
    return versions


def packages_of(group):
    """
    Return the packages of a group, as two {package: version}.

    Of the first, those of requirements-oldest.txt are wanted; of the second, all in the tested version.
    """
    file = f'requirements-{group}.txt'
    own, optional = pinned(file), pinned('requirements-optional.txt', None if group == 'test' else group)
    return (own, optional) if file in WITH_OLDEST else ({}, {**optional, **own})


def installed(name):
    """Return the version of an installed package, None without one."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def numbers(version):
    """Return a version for comparisons."""
    return tuple(map(int, re.findall(r'\d+', version)[:3]))


def main(arguments=None):
    """Print a line for each package; `arguments` None: those of the process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--constraints', action='store_true', help='print the packages that must stay as they are')
    parser.add_argument('groups', nargs='*', metavar='GROUP', help='with the packages of this group')
    arguments = parser.parse_args(arguments)
    by_oldest, wanted = pinned('requirements.txt'), {}
    # Of what builds, any version will do that the distribution brings.
    builds = {name: '0' for name in by_oldest if BUILD.match(name)}
    for group in arguments.groups:
        with_oldest, as_they_are = packages_of(group)
        by_oldest, wanted = {**with_oldest, **by_oldest}, {**as_they_are, **wanted}
    tested = {**wanted, **by_oldest}
    wanted |= {name: version for name, version in pinned('requirements-oldest.txt').items() if name in tested}
    wanted |= builds
    # Compiled messages, matplotlib and SciPy of the system work with one major version of NumPy only.
    numpy_major = numbers(installed('numpy') or '1')[0]
    for name, least in sorted(wanted.items()):
        present = installed(name)
        lacks = present is None or numbers(present) < numbers(least)
        if name == 'setuptools' and not lacks:
            lacks = numbers(present) > numbers(tested[name])
        if arguments.constraints:
            if not lacks:
                print(f'{name}=={present}')
            elif name == 'numpy':
                print(f'numpy<{numpy_major + 1}')
        elif lacks:
            print(f'{name}>={least},<={tested[name]}')


if __name__ == '__main__':
    main()
