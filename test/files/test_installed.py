# SPDX-License-Identifier: Apache-2.0
"""Installed packages are found like by ament_index_python, with and without it."""

import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.files import input_files


def test_without_a_prefix_path_the_own_prefix_counts(tmp_path, monkeypatch):
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    packages = tmp_path / 'lib/python3.12/site-packages'
    monkeypatch.setattr(input_files, '_HERE', packages / 'bev_preheat/files/input_files.py')
    monkeypatch.setattr(input_files, '_SOURCES', packages)
    with pytest.raises(InvalidInput, match='the files of bev_preheat are missing'):
        input_files.configuration_folder('vehicles')
    marker = tmp_path / 'share/ament_index/resource_index/packages/bev_preheat'
    marker.parent.mkdir(parents=True)
    marker.touch()
    assert input_files.configuration_folder('vehicles') == tmp_path / 'share/bev_preheat/config/vehicles'
