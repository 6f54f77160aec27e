# SPDX-License-Identifier: Apache-2.0
"""`preheat export-ecu` as a user runs it: refusals, and their order."""

import errno
import os
from pathlib import Path

import pytest

from bev_preheat.code_generation import ecu_export as export

EXPORT = ['export-ecu', '--vehicle', 'reference', '--output', 'out']


@pytest.fixture
def undrawn(monkeypatch):
    """No situation may be drawn."""
    def draw(*_):
        raise AssertionError('computed before the outputs were checked')

    monkeypatch.setattr(export, 'draw_vectors', draw)


@pytest.mark.usefixtures('undrawn')
def test_what_is_no_folder_of_its_own_or_stands_in_the_way_is_refused(refused):
    Path('file').write_text('kept')
    Path('mine').mkdir()
    Path('mine/thesis.tex').write_text('kept')
    Path('out/vectors.txt').mkdir(parents=True)
    for folder, problem in (
            ('file', 'file: is not a folder'), ('', "'': is not a folder"),
            ('mine', 'mine: has files that an export does not write: thesis.tex; name a folder of its own'),
            ('out', 'out/vectors.txt: is a folder; only a regular file can be written'),
            ('file/below', f'file/below/MISRA.md: cannot be a file: {os.strerror(errno.ENOTDIR)}')):
        assert refused(*EXPORT, '--output', folder) == f'--output: {problem}'
    assert os.listdir('mine') == ['thesis.tex']


@pytest.mark.parametrize('option, value, message', [
    ('--vectors', '0', '--vectors: 0 is not allowed; it must be 1 ... 100000'),
    ('--seed', '-1', '--seed: -1 is not allowed; it must be 0 or more'),
    ('--vehicle', 'refrence', "vehicle 'refrence' is unknown; did you mean 'reference'?")])
@pytest.mark.usefixtures('undrawn')
def test_what_is_not_allowed_is_told_in_one_line(refused, option, value, message):
    assert refused(*EXPORT, option, value).startswith(message)
    assert not Path('out').exists()


@pytest.mark.usefixtures('undrawn')
def test_missing_sources_of_the_core_are_told(refused, monkeypatch, tmp_path):
    monkeypatch.setattr(export, 'CHECKOUT', tmp_path)
    monkeypatch.setattr(export, 'installed_prefix', lambda name: None)
    assert refused(*EXPORT) == (
        'the sources of bev_preheat_core are missing: the package is not installed; build '
        'it from a checkout: colcon build --base-paths . core msg_defs')
    # An export built from other sources.
    monkeypatch.setattr(export, 'installed_prefix', lambda name: tmp_path)
    assert 'the source of bev_preheat_core cannot be read' in refused(*EXPORT)


def test_a_seed_without_a_plan_is_told(refused, monkeypatch):
    monkeypatch.setattr(export, 'draw_vectors', lambda *_: [])
    assert 'no situation that was drawn has a plan' in refused(*EXPORT, '--vectors', '1')
    assert not Path('out').exists()


def test_an_export_is_replaced_and_says_what_it_has(said):
    words = [*EXPORT, '--vehicle', 'small_car', '--vectors', '6', '--seed', '2']
    first = said(*words)
    contents = {path: path.read_bytes() for path in Path('out').rglob('*') if path.is_file()}
    assert first[0] == 0
    assert 'written: out: vehicle ' in first[1] and ' 6 situations: ' in first[1]
    assert 'compile and compare: make -C out all check' in first[1]
    Path('out/build').mkdir()
    Path('out/main.c').write_text('old')
    assert said(*words)[:2] == first[:2]
    assert {path: path.read_bytes() for path in Path('out').rglob('*') if path.is_file()} == contents
