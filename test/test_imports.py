# SPDX-License-Identifier: Apache-2.0
"""
Imports of a process: planning runs without ROS, the planner node without solver and plots.

Planning works without ROS installed, and the product works without the studies.
No files import one another in a circle.

Imports run in separate processes, because this one has already loaded everything.
"""

from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec
import os
from pathlib import Path
import pkgutil
import subprocess
import sys

import pytest

ROOMS = ('bev_preheat.planning', 'bev_preheat.vehicle', 'bev_preheat.route', 'bev_preheat.estimation',
         'bev_preheat.charging', 'bev_preheat.control', 'bev_preheat.simulation', 'bev_preheat.commands.route',
         'bev_preheat_studies.robustness.command')
CHECKOUT = Path(__file__).resolve().parent.parent

IMPORT_AND_LIST = """
import importlib, sys
for names in sys.argv[2:]:
    for name in names.split(','):
        importlib.import_module(name)
    print(*(name for name in sys.argv[1].split(',') if name in sys.modules))
"""


def modules_of(room):
    folder = find_spec(room).submodule_search_locations
    return [room] + [module.name for module in pkgutil.walk_packages(folder or [], f'{room}.')]


def with_path(*folders):
    """Return the environment of a process that imports from these folders first, then as this one."""
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([*map(str, folders), *filter(None, sys.path)]))
    # The coverage tool loads packages of its own.
    environment.pop('COVERAGE_PROCESS_CONFIG', None)
    return environment


def loaded_by(groups, unwanted):
    """Which of the unwanted packages a fresh process has loaded after each group of modules."""
    done = subprocess.run(
        [sys.executable, '-c', IMPORT_AND_LIST, ','.join(unwanted),
         *map(','.join, groups)],
        env=with_path(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


@pytest.fixture(scope='module')
def loaded_by_room():
    """Return the loaded modules after each room, in order: one process imports all rooms."""
    return dict(zip(ROOMS, loaded_by(
        map(modules_of, ROOMS), ['rclpy', 'casadi', 'scipy', 'matplotlib'])))


@pytest.mark.costly
@pytest.mark.parametrize('room', ROOMS)
def test_planning_rooms_need_no_ros_no_solver_and_no_plots(loaded_by_room, room):
    assert loaded_by_room[room] == []


@pytest.mark.costly
def test_planner_node_needs_no_solver_no_plots_and_no_readers_of_files_that_it_does_not_read():
    planner, checker = loaded_by([['bev_preheat.nodes.planner_node'], ['bev_preheat.nodes.nlp_checker_node']], [
        'casadi', 'scipy', 'matplotlib', 'jsonschema', 'bev_preheat.route.csv_file'])
    assert planner == []
    # The checker's solver has a process of its own.
    assert not {'casadi', 'scipy', 'matplotlib'}.intersection(checker)


def test_this_check_sees_what_is_loaded():
    assert loaded_by([['json'], ['decimal']], ['csv', 'decimal', 'json']) == [
        ['json'], ['decimal', 'json']]


@pytest.mark.costly
def test_rooms_use_only_rooms_below_them():
    """Lazy imports count. Other contracts: planning does without ROS, the product without its studies."""
    done = subprocess.run(
        [sys.executable, '-c', 'from importlinter.cli import lint_imports_command; '
         'lint_imports_command()', '--config', 'setup.cfg', '--no-cache'],
        env=with_path(CHECKOUT, CHECKOUT / 'studies'), cwd=CHECKOUT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def circle(*packages):
    """Return the modules of a circle of imports, lazy ones included; None if there is no circle."""
    import grimp
    graph = grimp.build_graph(*packages, exclude_type_checking_imports=True, cache_dir=None)
    imported = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    try:
        TopologicalSorter(imported).prepare()
    except CycleError as error:
        return error.args[1]
    return None


def test_no_files_import_one_another_in_a_circle():
    assert circle('bev_preheat', 'bev_preheat_studies') is None


def test_this_check_sees_a_circle_except_one_of_type_hints(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / 'ring_of_imports'
    folder.mkdir()
    for file, text in (
            ('__init__', ''), ('first', 'from ring_of_imports import second\n'),
            ('second', 'import ring_of_imports.third\n'),
            ('third', 'from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n'
                      '    from ring_of_imports.first import Hint\n')):
        (folder / f'{file}.py').write_text(text)
    assert circle('ring_of_imports') is None
    with open(folder / 'third.py', 'a', encoding='utf-8') as module:
        module.write('def late():\n    from ring_of_imports.first import value\n')
    assert {f'ring_of_imports.{file}' for file in ('first', 'second', 'third')} == set(circle('ring_of_imports'))
