# SPDX-License-Identifier: Apache-2.0
"""A soak test of a few seconds, as `make soak` runs one for minutes."""

import json
import subprocess
import sys


def test_a_short_soak_test_loads_the_planner_and_judges_it(tmp_path):
    picture = tmp_path / 'soak.png'
    done = subprocess.run(
        [sys.executable, '-m', 'bev_preheat.endurance', '--minutes', '0.15', '--output',
         str(picture)], capture_output=True, text=True, timeout=90)
    items = {item['what']: item for item in json.loads(
        picture.with_suffix('.json').read_text())['judgements']}
    # In seconds the memory still fills; all else must hold.
    del items['resident memory, growth in 10 min']
    assert [item for item in items.values() if not item['good']] == [], done.stdout
    assert int(items['battery states sent']['value']) > 300
    assert int(items['of these, heating']['value']) > 10
    assert picture.read_bytes().startswith(b'\x89PNG')
