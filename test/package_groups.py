# SPDX-License-Identifier: Apache-2.0
"""The groups of packages in scripts/requirements*.txt, and processes that see those of one group only."""

from importlib import metadata
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# For each Python process: the modules of other packages are not there.
SITECUSTOMIZE = """
import os
import sys
HIDDEN = frozenset(os.environ['BEV_PREHEAT_TEST_HIDDEN'].split())
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in HIDDEN:
            raise ModuleNotFoundError(f'No module named {name!r} in this group', name=name)
sys.meta_path.insert(0, Hidden())
"""


def normal(name):
    """Return a distribution's name as PyPI compares it."""
    return name.lower().replace('_', '-').replace('.', '-')


def pins(file, group=None):
    """Return {package: version} of a requirement file; with a group: of the lines that name it."""
    found = {}
    for line in (ROOT / 'scripts' / file).read_text().splitlines():
        package, _, groups = line.partition('#')
        if '==' in package and group in (None, *groups.split()):
            name, version = package.split(';')[0].strip().split('==')
            found[normal(name)] = version
    return found


def packages_of(*groups):
    """Return the packages that setup installs without a distribution for these groups, beside those for builds."""
    found = pins('requirements.txt')
    for group in groups:
        found |= pins('requirements-optional.txt', None if group == 'test' else group)
        if (ROOT / 'scripts' / f'requirements-{group}.txt').exists():
            found |= pins(f'requirements-{group}.txt')
    return found


def environment_of(folder, *groups):
    """Return variables for processes that see the packages of these groups only; `folder` gets a module."""
    listed = {name for path in (ROOT / 'scripts').glob('requirements*.txt') for name in pins(path.name)}
    others = listed - packages_of(*groups).keys()
    hidden = [module for module, names in metadata.packages_distributions().items()
              if module.isidentifier() and others.issuperset(map(normal, names))]
    (folder / 'sitecustomize.py').write_text(SITECUSTOMIZE)
    return {'PYTHONPATH': os.pathsep.join(filter(None, [str(folder), os.environ.get('PYTHONPATH')])),
            'BEV_PREHEAT_TEST_HIDDEN': ' '.join(hidden)}
