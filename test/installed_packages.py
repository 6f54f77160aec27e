# SPDX-License-Identifier: Apache-2.0
"""Packages with planning methods, as pip installs them: modules and the metadata of their entry points."""

from pathlib import Path
import shutil
import sys

from bev_preheat.planning import installed_methods

EXAMPLES = Path(__file__).resolve().parents[1] / 'docs' / 'examples'


def write_metadata(folder, name, entries, version='1.0'):
    """Write the metadata of a distribution with entry points {name: 'module:function'}."""
    info = folder / f'{name.replace("-", "_")}-{version}.dist-info'
    info.mkdir(parents=True)
    (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n')
    (info / 'entry_points.txt').write_text(f'[{installed_methods.GROUP}]\n' + ''.join(
        f'{entry} = {value}\n' for entry, value in entries.items()))


def put_example(folder, example):
    """Put a package of docs/examples into a folder, with the metadata of its pyproject.toml."""
    # ament_flake8's order of imports does not know this module of the standard library.
    import tomllib
    project = tomllib.loads((EXAMPLES / example / 'pyproject.toml').read_text())
    for module in project['tool']['setuptools']['py-modules']:
        shutil.copy(EXAMPLES / example / f'{module}.py', folder)
    about = project['project']
    write_metadata(folder, about['name'], about['entry-points'][installed_methods.GROUP], about['version'])


def use_folder(monkeypatch, folder):
    """Import from a folder until the end of the test, and forget its methods and modules then."""
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(installed_methods, 'LOADED', {})
    for module in folder.glob('*.py'):
        # A test may have loaded this module from another folder.
        monkeypatch.delitem(sys.modules, module.stem, raising=False)
