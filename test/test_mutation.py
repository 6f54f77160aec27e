# SPDX-License-Identifier: Apache-2.0
"""Changes of C files by `make mutation`: one place each, in code alone, the same sample on every machine."""

from difflib import unified_diff
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

SOURCE = """\
/* a + b is not code, nor is 7 */
#define MOST 5
static int is_warm(double t_c, const double limits_c[2]) {
  double kept[4] = {0.0};  // 3 * 4
  const char *const words = "1 < 2";
  if (t_c >= limits_c[1] && words != NULL) {
    return 1;
  }
  return bev_minimum(t_c - 0.5, kept[0]) > 2.0 * t_c;
}
"""
CHANGES = {
    'double kept[4] = {1.0};', 'return 2;',
    'if (t_c > limits_c[1] && words != NULL) {', 'if (t_c >= limits_c[2] && words != NULL) {',
    'if (t_c >= limits_c[1] || words != NULL) {', 'if (t_c >= limits_c[1] && words == NULL) {',
    'return bev_maximum(t_c - 0.5, kept[0]) > 2.0 * t_c;', 'return bev_minimum(t_c + 0.5, kept[0]) > 2.0 * t_c;',
    'return bev_minimum(t_c - 1.5, kept[0]) > 2.0 * t_c;', 'return bev_minimum(t_c - 0.5, kept[1]) > 2.0 * t_c;',
    'return bev_minimum(t_c - 0.5, kept[0]) >= 2.0 * t_c;', 'return bev_minimum(t_c - 0.5, kept[0]) > 3.0 * t_c;',
    'return bev_minimum(t_c - 0.5, kept[0]) > 2.0 / t_c;'}


@pytest.fixture
def mutation(tmp_path, monkeypatch):
    path = Path(__file__).parents[1] / 'scripts/mutation.py'
    spec = spec_from_file_location('mutation', path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    (tmp_path / 'warm.c').write_text(SOURCE)
    monkeypatch.setattr(module, 'ROOT', tmp_path)
    monkeypatch.setattr(module, 'SUBJECTS', {'warmth': ('warm.c',)})
    return module


def test_each_change_is_in_one_line_of_code(mutation):
    added = []
    for mutant in mutation.c_mutants('warm.c'):
        lines = [line for line in unified_diff(SOURCE.splitlines(), mutant.text.splitlines(), lineterm='', n=0)
                 if not line.startswith(('---', '+++', '@@'))]
        was, now = (line[1:].strip() for line in lines)
        assert mutant.change == f'{was} -> {now}'
        assert mutant.where == f'warm.c:{1 + [line.strip() for line in SOURCE.splitlines()].index(was)}'
        added.append(now.partition('  //')[0])
    assert sorted(added) == sorted(CHANGES)


def test_a_seed_draws_the_same_sample_again(mutation):
    drawn = [mutation.draw(['warmth'], 5, seed)['warmth'] for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert {len(each) for each in drawn} == {5}


def test_only_changes_of_code_that_is_the_same_are_tried_again(mutation):
    first, second, *_ = mutation.c_mutants('warm.c')
    table = ''.join(f'warmth\tnoticed\t{name}\t{where}\t{change}\n' for name, where, change, _ in (
        first, (second.name, second.where, 'return 3; -> return 4;', None)))
    drawn, before = mutation.again(table)
    assert drawn == {'warmth': [first]}
    assert before == {first.name: 'noticed', second.name: 'noticed'}
