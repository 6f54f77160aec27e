# SPDX-License-Identifier: Apache-2.0
"""
What a process loads: planning runs without ROS, the planner node without solver and plots.

Imported in processes of their own, as this one has loaded everything already.
"""

from importlib.util import find_spec
import os
from pathlib import Path
import pkgutil
import shutil
import subprocess
import sys

import pytest

ROOMS = ('planning', 'vehicle', 'route', 'estimation', 'charging', 'supervision', 'simulation',
         'experiments.robustness', 'experiments.scenario_drive')
PACKAGE = Path(find_spec('bev_preheat').origin).parent
CHECKOUT = Path(__file__).resolve().parent.parent

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


def with_path(folder):
    """Return the environment of a process that imports from a folder first, then as this one."""
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(folder), *filter(None, sys.path)]))
    # What measures coverage loads packages of its own.
    environment.pop('COVERAGE_PROCESS_CONFIG', None)
    return environment


def loaded_by(groups, unwanted):
    """Which of the unwanted packages a fresh process has loaded after each group of modules."""
    done = subprocess.run(
        [sys.executable, '-c', IMPORT_AND_LIST, ','.join(unwanted),
         *map(','.join, groups)],
        env=with_path(PACKAGE.parent), capture_output=True, text=True, timeout=60)
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
def test_planner_node_needs_no_solver_no_plots_and_no_readers_of_files_that_it_does_not_read():
    assert loaded_by([['bev_preheat.nodes.planner_node']], [
        'casadi', 'scipy', 'matplotlib', 'jsonschema', 'bev_preheat.route.csv_file']) == [[]]


def test_this_check_sees_what_is_loaded():
    assert loaded_by([['json'], ['decimal']], ['csv', 'decimal', 'json']) == [
        ['json'], ['decimal', 'json']]


def contracts_kept(checkout):
    """Return whether the contracts of a checkout's setup.cfg are kept, and what was printed."""
    done = subprocess.run(
        [sys.executable, '-c', 'from importlinter.cli import lint_imports_command; '
         'lint_imports_command()', '--config', 'setup.cfg', '--no-cache'],
        env=with_path(checkout), cwd=checkout, capture_output=True, text=True, timeout=120)
    return done.returncode == 0, done.stdout + done.stderr


@pytest.mark.costly
def test_rooms_use_only_rooms_below_them():
    """Lazy imports count."""
    kept, printed = contracts_kept(CHECKOUT)
    assert kept, printed


@pytest.mark.costly
@pytest.mark.parametrize('file, text, complaint', [
    ('planning/status.py', 'def late():\n    import bev_preheat.supervision.settings\n',
     'bev_preheat.planning is not allowed to import bev_preheat.supervision'),
    ('forecourt/__init__.py', '', 'bev_preheat.forecourt')], ids=['lazy, upwards', 'unknown room'])
def test_the_contracts_see_what_breaks_them(tmp_path, file, text, complaint):
    shutil.copy(CHECKOUT / 'setup.cfg', tmp_path)
    shutil.copytree(CHECKOUT / 'bev_preheat', tmp_path / 'bev_preheat',
                    ignore=shutil.ignore_patterns('__pycache__'))
    broken = tmp_path / 'bev_preheat' / file
    broken.parent.mkdir(exist_ok=True)
    with open(broken, 'a', encoding='utf-8') as module:
        module.write(text)
    kept, printed = contracts_kept(tmp_path)
    assert not kept
    assert complaint in printed
