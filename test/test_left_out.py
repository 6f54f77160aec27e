# SPDX-License-Identifier: Apache-2.0
"""A worker of xdist that crashes is reported with its reason."""

import os
from pathlib import Path
import subprocess
import sys

import pytest

CONFTEST = """
import left_out

def pytest_configure(config):
    left_out.begin(config)
    config.pluginmanager.register(left_out)
"""
TESTS = """
import os

def test_sound():
    pass

def test_that_ends_its_process():
    os._exit(70)
"""


def test_the_reason_of_a_crashed_worker_is_shown(tmp_path):
    pytest.importorskip('xdist')
    (tmp_path / 'conftest.py').write_text(CONFTEST)
    (tmp_path / 'test_crash.py').write_text(TESTS)
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get('PYTHONPATH', '')])
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '-p', 'xdist', '-n', '1',
         '--max-worker-restart=0', 'test_crash.py'],
        # Other plugins, such as those of ROS, take most of the time of a start.
        cwd=tmp_path, text=True, capture_output=True, timeout=60, env={
            **os.environ, 'PYTHONPATH': path, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'})
    assert done.returncode == 1
    assert 'test_that_ends_its_process' in done.stdout and 'workeroutput' not in done.stdout + done.stderr
