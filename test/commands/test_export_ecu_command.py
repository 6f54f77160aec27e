# SPDX-License-Identifier: Apache-2.0
"""`preheat export-ecu` as a user runs it: refusals, and their order."""

import errno
import os
from pathlib import Path

import pytest

from bev_preheat.code_generation import ecu_export as export


@pytest.fixture
def refused(said, monkeypatch):
    """Return the single line of a refused command; no situation may have been drawn."""
    def draw(*_):
        raise AssertionError('computed before the outputs were checked')

    def run(*arguments):
        monkeypatch.setattr(export, 'draw_vectors', draw)
        status, out, err = said('export-ecu', *arguments)
        assert (status, out) == (2, '')
        (line,) = err.splitlines()
        return line
    return run


def test_what_cannot_be_a_folder_of_its_own_is_refused(refused):
    Path('file').write_text('kept')
    assert refused('--vehicle', 'reference', '--output', 'file') == (
        'preheat: error: --output: file: is not a folder')
    Path('mine').mkdir()
    Path('mine/thesis.tex').write_text('kept')
    assert refused('--vehicle', 'reference', '--output', 'mine') == (
        'preheat: error: --output: mine: has files that an export does not write: thesis.tex; '
        'name a folder of its own')
    assert os.listdir('mine') == ['thesis.tex']


def test_what_stands_in_the_way_of_a_file_is_refused(refused):
    Path('out/vectors.txt').mkdir(parents=True)
    assert refused('--vehicle', 'reference', '--output', 'out') == (
        'preheat: error: --output: out/vectors.txt: is a folder; only a regular file can be written')
    Path('file').write_text('kept')
    assert refused('--vehicle', 'reference', '--output', 'file/below') == (
        f'preheat: error: --output: file/below/MISRA.md: cannot be a file: {os.strerror(errno.ENOTDIR)}')


@pytest.mark.parametrize('option, value, message', [
    ('--vectors', '0', '--vectors: 0 is not allowed; it must be 1 ... 100000'),
    ('--seed', '-1', '--seed: -1 is not allowed; it must be 0 or more'),
    ('--vehicle', 'refrence', "vehicle 'refrence' is unknown; did you mean 'reference'?")])
def test_what_is_not_allowed_is_told_in_one_line(refused, option, value, message):
    line = refused('--vehicle', 'reference', '--output', 'out', option, value)
    assert line.startswith(f'preheat: error: {message}')
    assert not Path('out').exists()


def test_missing_sources_of_the_core_are_told(refused, monkeypatch, tmp_path):
    monkeypatch.setattr(export, '_CHECKOUT', tmp_path)
    monkeypatch.setattr(export, 'installed_prefix', lambda name: None)
    assert refused('--vehicle', 'reference', '--output', 'out') == (
        'preheat: error: the sources of bev_preheat_core are missing: the package is not installed; build '
        'it from a checkout: colcon build --base-paths . core msg_defs')
    # An export built from other sources.
    monkeypatch.setattr(export, 'installed_prefix', lambda name: tmp_path)
    assert 'the source of bev_preheat_core cannot be read' in refused(
        '--vehicle', 'reference', '--output', 'out')


def test_a_seed_without_a_plan_is_told(said, monkeypatch):
    monkeypatch.setattr(export, 'draw_vectors', lambda *_: [])
    status, _, err = said('export-ecu', '--vehicle', 'reference', '--output', 'out', '--vectors', '1')
    assert status == 2
    assert 'no situation that was drawn has a plan' in err
    assert not Path('out').exists()


def test_an_export_is_replaced_and_says_what_it_has(said):
    first = said('export-ecu', '--vehicle', 'small_car', '--output', 'out', '--vectors', '6', '--seed', '2')
    contents = {path: path.read_bytes() for path in Path('out').rglob('*') if path.is_file()}
    assert first[0] == 0
    assert 'written: out: vehicle ' in first[1] and ' 6 situations: ' in first[1]
    assert 'compile and compare: make -C out all check' in first[1]
    Path('out/build').mkdir()
    Path('out/main.c').write_text('old')
    assert said('export-ecu', '--vehicle', 'small_car', '--output', 'out', '--vectors', '6', '--seed',
                '2')[:2] == first[:2]
    assert {path: path.read_bytes() for path in Path('out').rglob('*') if path.is_file()} == contents
