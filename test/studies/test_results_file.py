# SPDX-License-Identifier: Apache-2.0
"""Results files: records are read back, a half-written line is dropped, another study is refused."""

from dataclasses import asdict, dataclass

import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat_studies.results_file import ResultsFile

STUDY = {'study': 'sweep', 'seed': 1, 'vehicle': 'reference (17ab)', 'methods': ['a', 'b']}


@dataclass(frozen=True)
class Made:
    number: int
    value: float | None = None


RESULTS = [Made(0, 0.1 + 0.2), Made(2), Made(1, 1e-300)]


@pytest.fixture
def path(tmp_path):
    path = tmp_path / 'study.jsonl'
    with ResultsFile(path, STUDY) as file:
        for result in RESULTS:
            file.append(asdict(result))
    return path


def read(path):
    with ResultsFile(path, STUDY) as file:
        return list(file.results(Made))


def test_a_half_written_line_is_dropped_wherever_it_was_cut(path):
    whole = path.read_bytes()
    begins = whole.rindex(b'\n', 0, -1) + 1
    for end in range(begins, len(whole)):
        path.write_bytes(whole[:end])
        with ResultsFile(path, STUDY) as file:
            assert list(file.results(Made)) == RESULTS[:2]
            file.append(asdict(RESULTS[2]))
        assert path.read_bytes() == whole


@pytest.mark.parametrize('change, message', [
    ({'seed': 2}, 'holds another study: seed is 1 in the file, 2 here; choose another file'),
    ({'vehicle': 'reference (99ff)', 'methods': ['a']},
     'vehicle is reference (17ab) in the file, reference (99ff) here, methods is ["a", "b"] in the '
     'file, ["a"] here'),
    ({'fault': 'dead'}, 'fault is not given in the file, dead here')])
def test_the_file_of_another_study_is_refused_by_what_differs(path, change, message):
    before = path.read_bytes()
    with pytest.raises(InvalidInput) as refused:
        ResultsFile(path, {**STUDY, **change})
    assert message in str(refused.value) and len(refused.value.problems) == 1
    assert path.read_bytes() == before


@pytest.mark.parametrize('text', ['duration_s,speed_mps\n30,20\n', '{"results": []}\n', 'notes', '[1]\n'])
def test_what_is_no_results_file_is_refused_and_stays(tmp_path, text):
    path = tmp_path / 'other.txt'
    path.write_text(text)
    with pytest.raises(InvalidInput, match='is not a results file of a study'):
        ResultsFile(path, STUDY)
    assert path.read_text() == text


def test_a_damaged_line_is_named(path):
    lines = path.read_text().splitlines()
    path.write_text('\n'.join([*lines[:2], '{"number": 2, "va', *lines[3:]]) + '\n')
    with pytest.raises(InvalidInput, match='line 3 is damaged: \'{"number": 2, "va'):
        read(path)


def test_two_studies_do_not_write_to_one_file(path):
    with ResultsFile(path, STUDY), pytest.raises(InvalidInput, match='another running study'):
        ResultsFile(path, STUDY)
    assert read(path) == RESULTS


def test_a_line_that_is_no_result_is_named(path):
    with path.open('a') as file:
        file.write('{"numbre": 0}\n')
    with pytest.raises(InvalidInput, match='line 5 is not a result of this study'):
        read(path)
