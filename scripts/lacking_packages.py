# SPDX-License-Identifier: Apache-2.0
"""
Print the packages missing from this Python, for pip; with --constraints the packages that must stay as is.

Run by setup.bash with the Python of .venv on a machine with a ROS 2 distribution. A package of the
system that is at least the oldest supported version is used; an older or absent one is to be installed
in a version up to the tested one.
"""

import argparse
from importlib import metadata
from pathlib import Path
import re

SCRIPTS = Path(__file__).resolve().parent
# Extensions of colcon's command line for a build of the two packages, and their own dependencies.
BUILD = re.compile('colcon-|setuptools$')


def pinned(*files):
    """Return {package: version} of requirement files; of several lines the first counts."""
    versions = {}
    for file in files:
        for name, version in re.findall(r'^([\w.-]+)==([\w.]+)', (SCRIPTS / file).read_text(), re.M):
            versions.setdefault(name, version)
    return versions


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
    parser.add_argument('--group', help='with what scripts/requirements-GROUP.txt names')
    arguments = parser.parse_args(arguments)
    group = pinned(f'requirements-{arguments.group}.txt') if arguments.group else {}
    tested = {**group, **pinned('requirements.txt', 'requirements-optional.txt')}
    oldest = {name: version for name, version in pinned('requirements-oldest.txt').items()
              if name in tested}
    wanted = {**oldest, **pinned('requirements-optional.txt')}
    wanted |= {name: version for name, version in group.items() if name not in oldest}
    # Of what builds, any version will do that the distribution brings.
    wanted |= {name: '0' for name in tested if BUILD.match(name)}
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
