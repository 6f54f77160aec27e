# SPDX-License-Identifier: Apache-2.0
"""Input files: only regular ones are opened, as a pipe would block and a device never end; the installed ones."""

import os

import pytest

from bev_preheat.bus.vss_source import text_of
from bev_preheat.control.departures import load_departures, load_grid_prices
from bev_preheat.errors import InvalidInput
from bev_preheat.files import input_files
from bev_preheat.files.input_files import find_configuration, read_text
from bev_preheat.files.table import read_head
from bev_preheat.logs.dbc import load_dbc
from bev_preheat.recording.comparison import load_expectation
from bev_preheat.vehicle.charging_curve import read_charging_curve

READERS = {
    'departures': load_departures, 'grid prices': load_grid_prices,
    'charging curve': read_charging_curve,
    'expected figures': load_expectation,
    'token': lambda path: text_of(path, 'live.vss.token'),
    'DBC': pytest.param(load_dbc, marks=pytest.mark.needs('cantools')),
    'log': read_head, 'vehicle': lambda path: find_configuration('vehicles', path, '.yaml')}
KINDS = {'is not a regular file': os.mkfifo, 'is a folder; a file is needed': os.mkdir,
         'no such file': lambda path: None}


@pytest.mark.parametrize('read', READERS.values(), ids=READERS)
@pytest.mark.parametrize('reason', KINDS)
def test_only_a_regular_file_is_opened(read, reason, tmp_path):
    KINDS[reason](path := tmp_path / 'thing')
    with pytest.raises(InvalidInput, match=f'{path}: {reason}'):
        read(path)


def test_text_is_read_from_the_home_folder_up_to_a_size(tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'week.yaml').write_bytes('Müller'.encode())
    assert read_text('~/week.yaml') == 'Müller'
    monkeypatch.setattr(input_files, 'LARGEST_TEXT', 5)
    with pytest.raises(InvalidInput, match='~/week.yaml: is larger than'):
        read_text('~/week.yaml')
    (tmp_path / 'week.yaml').write_bytes(b'\xff')
    with pytest.raises(InvalidInput, match='week.yaml: cannot be read: is not UTF-8 text'):
        read_text('~/week.yaml')


def test_without_a_prefix_path_the_own_prefix_counts(tmp_path, monkeypatch):
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    packages = tmp_path / 'lib/python3.12/site-packages'
    monkeypatch.setattr(input_files, 'HERE', packages / 'bev_preheat/files/input_files.py')
    monkeypatch.setattr(input_files, 'SOURCES', packages)
    with pytest.raises(InvalidInput, match='the files of bev_preheat are missing'):
        input_files.configuration_folder('vehicles')
    marker = tmp_path / 'share/ament_index/resource_index/packages/bev_preheat'
    marker.parent.mkdir(parents=True)
    marker.touch()
    assert input_files.configuration_folder('vehicles') == tmp_path / 'share/bev_preheat/config/vehicles'
