# SPDX-License-Identifier: Apache-2.0
"""A car of two masses, from its logs to its file; the car is that of docs/tutorials/make_files.py."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

from bev_preheat.vehicle import load_vehicle

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi', 'scipy')]
MAKE_FILES = Path(__file__).parents[2] / 'docs' / 'tutorials' / 'make_files.py'
TRUTH = {'heat_capacity': 335e3, 'leakage': 9.0, 'heater_efficiency': 0.9, 'shell_share': 100.0 / 335.0,
         'shell_conductance': 600.0}
MAP = """extends: common
signals:
  current_a: {channels: HV battery current, positive: charging}
  battery_heater_w: PTC heater power
"""


@pytest.fixture
def identified(said):
    """Return the figures of an identification, the heat path of its file and the printed text."""
    def run(start, logs, name):
        status, output, _ = said('identify', *(f'{log}.csv' for log in logs), '--vehicle', start, '--signals',
                                 './map.yaml', '--output', f'{name}.yaml', '--json', 'found.json')
        assert status == 0
        return json.loads(Path('found.json').read_text()), load_vehicle(f'./{name}.yaml').heat_path, output
    return run


# A slow shell, and the drivetrain's heat, with all Joule heat, in the core.
SLOW_SHELL = (('between_w = 600', 'between_w = 80'),
              ('(0.7 * ohm * current_a**2', '(ohm * current_a**2 + 0.02 * abs(power_w)'),
              ('late_w + 0.02 * abs(power_w) + 0.3 * ohm * current_a**2', 'late_w'))


@pytest.fixture
def logs(tmp_path, request):
    """Return the names of the tutorial's logs in tmp_path; the script that writes them has some texts replaced."""
    script = MAKE_FILES.read_text()
    for old, new in getattr(request, 'param', ()):
        assert script.count(old) == 1
        script = script.replace(old, new)
    (tmp_path / 'make_files.py').write_text(script)
    subprocess.run([sys.executable, 'make_files.py'], cwd=tmp_path, check=True)
    (tmp_path / 'map.yaml').write_text(MAP)
    return [*(f'{kind}{number}' for kind in ('drive', 'warm') for number in (1, 2, 3)), 'night']


def assert_contain(parameters, truth):
    for name, value in truth.items():
        assert parameters[name]['low'] < value < parameters[name]['high'], name


@pytest.mark.parametrize('logs', [SLOW_SHELL], indirect=True)
def test_a_slow_shell_is_found_and_no_slow_sensor_in_its_place(identified, logs):
    found, path, _ = identified('mid_size_lfp', logs, 'my_car')
    assert path.sensor_place == 'shell'
    assert_contain({item['name']: item for item in found['parameters']}, {**TRUTH, 'shell_conductance': 80.0})


def test_shell_and_core_are_found_and_stay_where_logs_do_not_tell_them(identified, logs):
    found, path, output = identified('mid_size_lfp', logs, 'my_car')
    parameters = {item['name']: item for item in found['parameters']}
    assert_contain(parameters, TRUTH)
    assert parameters['shell_conductance']['high'] < 2.0 * TRUTH['shell_conductance']
    assert parameters['shell_share']['is_identified'] and parameters['shell_conductance']['is_identified']
    assert path.sensor_place == 'shell'
    assert path.shell_share == pytest.approx(parameters['shell_share']['estimate'], rel=1e-4)
    assert found['leave_one_out']['rmse_k'] < 0.4
    assert 'it explains unseen trips better than one mass' in ' '.join(output.split())
    # A night tells nothing of the share, and is no reason to leave the structure of START.
    _, kept, _ = identified('./my_car.yaml', ['night'], 'again')
    assert (kept.shell_share, kept.sensor_place) == (path.shell_share, 'shell')
