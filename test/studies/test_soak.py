# SPDX-License-Identifier: Apache-2.0
"""The assessment of a soak test detects each failure; a run of a few seconds."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from bev_preheat_studies.soak.command import judge, memory_growth_mb_in_10_min

GOOD_LOAD = {
    'commands': np.arange(0.0, 600.0, 0.9).tolist(), 'wrong': [], 'internal_errors': 0, 'states_sent': 6000,
    'garbage_sent': 20, 'routes_sent': 15, 'calls': 9, 'heating_commands': 400}
FLAT_MB = [(float(t), 80.0 + 0.1 * np.sin(t)) for t in range(600)]


@pytest.mark.parametrize('rate_mb_per_s', [0.0, 0.001, -0.002])
def test_growth_is_the_slope(rate_mb_per_s):
    random = np.random.default_rng(4)
    t = np.arange(0.0, 900.0, 3.0)
    memory_mb = 75.0 + rate_mb_per_s * t + 0.05 * random.normal(size=len(t))
    assert memory_growth_mb_in_10_min(t, memory_mb) == pytest.approx(
        600.0 * rate_mb_per_s, abs=0.05)


@pytest.mark.parametrize('changed, exit_status, what', [
    ({'wrong': ['9000 W is commanded']}, 0, 'forbidden commands'), ({'internal_errors': 1}, 0, 'internal errors'),
    ({'garbage_sent': 0}, 0, 'garbage messages'), ({'heating_commands': 0}, 0, 'of these, heating'),
    ({}, -11, 'process'), ({}, None, 'process')])
def test_what_is_wrong_is_named(changed, exit_status, what):
    judged = judge(SimpleNamespace(**{**GOOD_LOAD, **changed}), FLAT_MB, 1.0, exit_status)
    assert [item.what for item in judged if not item.good] == [what]


@pytest.mark.deep
@pytest.mark.usefixtures('dds')
def test_a_short_soak_test_loads_the_planner_and_judges_it(tmp_path):
    figures = tmp_path / 'soak.json'
    done = subprocess.run(
        [sys.executable, '-m', 'bev_preheat_studies', 'soak', '--minutes', '0.15', '--json', str(figures)],
        capture_output=True, text=True, timeout=300)
    items = {item['what']: item for item in json.loads(figures.read_text())['judgements']}
    # Within seconds the memory still grows, and the regularity of commands depends on the load of
    # the computer; all other requirements must hold.
    for what in ('resident memory, growth in 10 min', 'command periods missed',
                 'longest time without a command'):
        del items[what]
    assert [item for item in items.values() if not item['good']] == [], done.stdout
    assert int(items['battery states sent']['value']) > 0
    assert int(items['of these, heating']['value']) > 0
