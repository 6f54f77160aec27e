# SPDX-License-Identifier: Apache-2.0
"""
What a process loads: planning runs without ROS, the planner node without solver and plots.

Imported in processes of their own, as this one has loaded everything already.
"""

from importlib.util import find_spec
import os
from pathlib import Path
import pkgutil
import subprocess
import sys

import pytest

ROOMS = ('planning', 'vehicle', 'route', 'estimation', 'supervision', 'simulation',
         'experiments.robustness', 'experiments.scenario_drive')
PACKAGE = Path(find_spec('bev_preheat').origin).parent

IMPORT_AND_LIST = """
import importlib, sys
for names in sys.argv[2:]:
    for name in names.split(','):
        importlib.import_module(name)
    print(*(name for name in sys.argv[1].split(',') if name in sys.modules))
"""


def modules_of(room):
    folder = PACKAGE / room.replace('.', '/')
    return [f'bev_preheat.{room}'] + [
        module.name
        for module in pkgutil.walk_packages([str(folder)], f'bev_preheat.{room}.')]


def loaded_by(groups, unwanted):
    """Which of the unwanted packages a fresh process has loaded after each group of modules."""
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(
        [str(PACKAGE.parent), *filter(None, sys.path)]))
    done = subprocess.run(
        [sys.executable, '-c', IMPORT_AND_LIST, ','.join(unwanted),
         *map(','.join, groups)],
        env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


@pytest.fixture(scope='module')
def loaded_by_room():
    """Return what has been loaded after each room, in their order: one process imports them all."""
    return dict(zip(ROOMS, loaded_by(
        map(modules_of, ROOMS), ['rclpy', 'casadi', 'scipy', 'matplotlib'])))


@pytest.mark.costly
@pytest.mark.parametrize('room', ROOMS)
def test_planning_rooms_need_no_ros_no_solver_and_no_plots(loaded_by_room, room):
    assert loaded_by_room[room] == []


@pytest.mark.costly
def test_planner_node_needs_no_solver_and_no_plots():
    assert loaded_by(
        [['bev_preheat.nodes.planner_node']], ['casadi', 'scipy', 'matplotlib']) == [[]]


def test_this_check_sees_what_is_loaded():
    assert loaded_by([['json'], ['decimal']], ['csv', 'decimal', 'json']) == [
        ['json'], ['decimal', 'json']]
