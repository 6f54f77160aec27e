# SPDX-License-Identifier: Apache-2.0
"""A worker of a study loads neither ROS nor solver nor plots."""

import os
from pathlib import Path
import subprocess
import sys

import pytest

UNWANTED = ('rclpy', 'casadi', 'scipy', 'matplotlib')
IMPORT_AND_LIST = ('import sys; from bev_preheat_studies.robustness import car_figures, car_study; '
                   'from bev_preheat_studies.commands import robustness, robustness_days, robustness_signals; '
                   f'print(*set({UNWANTED}) & set(sys.modules))')


# test/test_imports.py asks this of bev_preheat_studies.robustness daily.
@pytest.mark.deep
def test_study_needs_neither_ros_nor_solver_nor_plots():
    root = Path(__file__).parents[3]
    done = subprocess.run(
        [sys.executable, '-c', IMPORT_AND_LIST], capture_output=True, text=True, timeout=60,
        env=dict(os.environ, PYTHONPATH=os.pathsep.join(
            [str(root), str(root / 'studies'), *filter(None, sys.path)])))
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
