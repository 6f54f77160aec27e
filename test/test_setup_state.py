# SPDX-License-Identifier: Apache-2.0
"""The scripts' answer to whether .venv is ready, after each way in which setup may have ended."""

from pathlib import Path
import subprocess

import pytest

SCRIPT = Path(__file__).parents[1] / 'scripts' / 'ros_underlay.bash'


def state(root, *groups):
    return subprocess.run(
        ['bash', '-euc', 'bev_preheat_root=$1; . "$2"; bev_preheat_venv_state "${@:3}"', 'bash', str(root),
         str(SCRIPT), *groups],
        check=True, capture_output=True, text=True, env={'PATH': '/usr/bin:/bin'}).stdout.strip()


@pytest.mark.parametrize('made, ready, for_builds', [
    ((), 'absent', 'absent'),
    (('.venv/',), 'unfinished', 'unfinished'),
    # The packages of builds are there, the program's are being installed, or their installation was interrupted.
    (('.venv/.ready', '.venv/.adding-demo'), 'unfinished', 'ready'),
    # A group that only a part of the program needs.
    (('.venv/.ready', '.venv/.ready-demo', '.venv/.adding-logs'), 'ready', 'ready'),
    (('.venv/.ready', '.venv/.ready-demo'), 'ready', 'ready'),
    (('.venv/.ready-demo',), 'unfinished', 'unfinished')])
def test_an_interrupted_setup_is_never_taken_for_ready(tmp_path, made, ready, for_builds):
    for name in made:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        if name.endswith('/'):
            (tmp_path / name).mkdir()
        else:
            (tmp_path / name).write_text(f'{tmp_path}/.venv\n3.12.3 wheels 1 1\n')
    assert state(tmp_path) == state(tmp_path, 'demo') == ready
    assert state(tmp_path, 'build') == for_builds


def test_a_copied_checkout_is_not_ready(tmp_path):
    (tmp_path / '.venv').mkdir()
    (tmp_path / '.venv' / '.ready').write_text('/elsewhere/.venv\n3.12.3 wheels 1 1\n')
    assert state(tmp_path) == state(tmp_path, 'build') == 'moved'
