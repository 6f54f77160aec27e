# SPDX-License-Identifier: Apache-2.0
"""A car of two masses, from its logs to its file; the car is that of docs/tutorials/make_files.py."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

from bev_preheat.commands.main import main
from bev_preheat.vehicle import load_vehicle

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi'), pytest.mark.needs('scipy')]
MAKE_FILES = Path(__file__).parents[2] / 'docs' / 'tutorials' / 'make_files.py'
TRUTH = {'heat_capacity': 335e3, 'leakage': 9.0, 'heater_efficiency': 0.9, 'shell_share': 100.0 / 335.0,
         'shell_conductance': 600.0}
MAP = """extends: common
signals:
  current_a: {channels: HV battery current, positive: charging}
  battery_heater_w: PTC heater power
"""


def identified(folder, start, logs, name):
    assert main(['identify', *(str(folder / f'{log}.csv') for log in logs), '--vehicle', start, '--signals',
                 str(folder / 'map.yaml'), '--output', str(folder / f'{name}.yaml'), '--json',
                 str(folder / 'found.json')]) == 0
    return json.loads((folder / 'found.json').read_text()), load_vehicle(folder / f'{name}.yaml').heat_path


def test_shell_and_core_are_found_and_stay_where_logs_do_not_tell_them(tmp_path, capsys):
    subprocess.run([sys.executable, MAKE_FILES], cwd=tmp_path, check=True)
    (tmp_path / 'map.yaml').write_text(MAP)
    drives = [f'{kind}{number}' for kind in ('drive', 'warm') for number in (1, 2, 3)]
    found, path = identified(tmp_path, 'mid_size_lfp', [*drives, 'night'], 'my_car')
    parameters = {item['name']: item for item in found['parameters']}
    for name, truth in TRUTH.items():
        assert parameters[name]['low'] < truth < parameters[name]['high'], name
    assert parameters['shell_conductance']['high'] < 2.0 * TRUTH['shell_conductance']
    assert parameters['shell_share']['is_identified'] and parameters['shell_conductance']['is_identified']
    assert path.sensor_place == 'shell'
    assert path.shell_share == pytest.approx(parameters['shell_share']['estimate'], rel=1e-4)
    assert found['leave_one_out']['rmse_k'] < 0.4
    assert 'it explains unseen trips better than one mass' in ' '.join(capsys.readouterr().out.split())
    # A night tells nothing of the share, and is no reason to leave the structure of START.
    _, kept = identified(tmp_path, str(tmp_path / 'my_car.yaml'), ['night'], 'again')
    assert (kept.shell_share, kept.sensor_place) == (path.shell_share, 'shell')
