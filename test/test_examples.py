# SPDX-License-Identifier: Apache-2.0
"""
The examples of the docs: they run, use the public interface only, and their pictures name quantities and units.

Two quick ones run daily, all in `make test-deep`; `make docs` runs them too.
"""

import ast
from pathlib import Path
import re
from runpy import run_path
import sys
import time

import pytest

import bev_preheat as bp

FOLDER = Path(__file__).resolve().parents[1] / 'docs' / 'examples'
EXAMPLES = sorted(FOLDER.glob('*.py'))
DAILY = ('own_vehicle', 'when_to_heat')
NEED_CASADI = ('alpine_pass', 'table_two')
# Each takes less than 20 s; processor time does not depend on the other programs of the machine.
MOST_SECONDS = 20.0
MOST_PANELS = 4
# A quantity and its unit, such as "trip length [min]".
LABEL = re.compile(r'\w.*\s\[[^\]]+\]$', re.DOTALL)


def cases():
    for example in EXAMPLES:
        marks = [] if example.stem in DAILY else [pytest.mark.deep]
        marks += [pytest.mark.needs('casadi')] * (example.stem in NEED_CASADI)
        yield pytest.param(example, id=example.stem, marks=[*marks, pytest.mark.needs('matplotlib')])


def panels_of(figure):
    """Return the panels of a figure in reading order; a colour bar is no panel."""
    return [axes for axes in figure.axes if axes.get_label() != '<colorbar>']


def bottom_panel(axes):
    """Return the panel at the bottom of the axes' column, which has the label of a shared x axis."""
    column = axes.get_subplotspec().colspan.start
    below = [other for other in panels_of(axes.figure) if other.get_subplotspec().colspan.start == column]
    return below[-1] if axes.get_shared_x_axes().joined(axes, below[-1]) else axes


@pytest.mark.costly
@pytest.mark.parametrize('example', list(cases()))
def test_an_example_runs_and_its_pictures_are_labelled(example, tmp_path, monkeypatch, capsys):
    import matplotlib
    import matplotlib.pyplot as plt
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'argv', [str(example)])
    used = matplotlib.get_backend()
    matplotlib.use('Agg')
    monkeypatch.setattr(plt, 'show', lambda: None)
    start_s = time.process_time()
    try:
        run_path(str(example), run_name='__main__')
        assert time.process_time() - start_s < MOST_SECONDS
        figures = [plt.figure(number) for number in plt.get_fignums()]
        assert figures and capsys.readouterr().out
        for figure in figures:
            panels = panels_of(figure)
            assert 1 <= len(panels) <= MOST_PANELS
            for axes in figure.axes:
                assert LABEL.search(axes.get_ylabel()), axes.get_ylabel()
            for axes in panels:
                assert LABEL.search(bottom_panel(axes).get_xlabel())
                assert axes.lines or axes.patches or axes.collections
            figure.canvas.draw()
    finally:
        plt.close('all')
        matplotlib.use(used)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.stem)
def test_an_example_uses_the_public_interface_only(example):
    tree = ast.parse(example.read_text())
    imported = {name for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))
                for name in ([node.module] if isinstance(node, ast.ImportFrom) else
                             [alias.name for alias in node.names])}
    assert {name for name in imported if name.startswith('bev_preheat')} == {'bev_preheat'}
    used = {node.attr for node in ast.walk(tree)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == 'bp'}
    assert used and used <= set(bp.__all__)


def test_each_example_has_its_place_in_the_gallery():
    order = run_path(str(FOLDER.parent / 'example_order.py'))['ORDER']
    assert sorted(order) == [example.stem for example in EXAMPLES]
    assert set(DAILY) | set(NEED_CASADI) <= set(order)
