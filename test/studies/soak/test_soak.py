# SPDX-License-Identifier: Apache-2.0
"""A soak test of a few seconds, as `make soak` runs one for minutes."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.usefixtures('dds')


@pytest.mark.deep
def test_a_short_soak_test_loads_the_planner_and_judges_it(tmp_path):
    picture = tmp_path / 'soak.png'
    done = subprocess.run(
        [sys.executable, '-m', 'bev_preheat_studies.soak', '--minutes', '0.15', '--output',
         str(picture)], capture_output=True, text=True, timeout=300)
    items = {item['what']: item for item in json.loads(
        picture.with_suffix('.json').read_text())['judgements']}
    # Within seconds the memory still grows, and the regularity of commands depends on the load of
    # the computer; all other requirements must hold.
    for what in ('resident memory, growth in 10 min', 'command periods missed',
                 'longest time without a command'):
        del items[what]
    assert [item for item in items.values() if not item['good']] == [], done.stdout
    assert int(items['battery states sent']['value']) > 0
    assert int(items['of these, heating']['value']) > 0
    assert picture.read_bytes().startswith(b'\x89PNG')
