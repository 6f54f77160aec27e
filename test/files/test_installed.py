# SPDX-License-Identifier: Apache-2.0
"""Installed packages are found like by ament_index_python, with and without it."""

import ament_index_python.packages
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.files import configuration


@pytest.fixture
def prefixes(tmp_path, monkeypatch):
    """Make two prefixes in AMENT_PREFIX_PATH, and a missing one; both have `late`, the second also `other`."""
    folders = [tmp_path / name for name in ('gone', 'first', 'second')]
    for folder, package in ((folders[1], 'late'), (folders[2], 'late'), (folders[2], 'other')):
        marker = folder / 'share/ament_index/resource_index/packages' / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()
    monkeypatch.setenv('AMENT_PREFIX_PATH', ':'.join(['', *map(str, folders)]))
    return folders


@pytest.mark.parametrize('package', ['late', 'other'])
def test_the_first_prefix_that_has_the_package_counts_as_for_ros(prefixes, package):
    assert str(configuration.installed_prefix(package)) == ament_index_python.packages.get_package_prefix(package)


def test_without_a_prefix_path_the_own_prefix_counts(tmp_path, monkeypatch):
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    packages = tmp_path / 'lib/python3.12/site-packages'
    monkeypatch.setattr(configuration, '_HERE', packages / 'bev_preheat/files/configuration.py')
    monkeypatch.setattr(configuration, '_SOURCES', packages)
    with pytest.raises(InvalidInput, match='the files of bev_preheat are missing'):
        configuration.configuration_folder('vehicles')
    marker = tmp_path / 'share/ament_index/resource_index/packages/bev_preheat'
    marker.parent.mkdir(parents=True)
    marker.touch()
    assert configuration.configuration_folder('vehicles') == tmp_path / 'share/bev_preheat/config/vehicles'
