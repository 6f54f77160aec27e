# SPDX-License-Identifier: Apache-2.0
"""The loop of the studies: the same results in order in one process and in several, kept, resumed and shown."""

from argparse import ArgumentParser
from dataclasses import dataclass
import json
from multiprocessing import active_children
import os
import signal
import time

import pytest
from waiting import poll_until

from bev_preheat.commands.program import Interrupted, WorkerLost
from bev_preheat.errors import InvalidInput
from bev_preheat_studies.study import add_study_arguments, check_study_arguments, Study


@dataclass(frozen=True)
class Made:
    number: int
    cube: int
    process: int = 0


def cube(number):
    return Made(number, number**3)


def cube_there(number):
    return Made(number, number**3, os.getpid())


def study(task=cube, wanted=6):
    return Study(task, Made, wanted, {'study': 'made', 'seed': 3}, None, 'situations')


def arguments(*given):
    parser = ArgumentParser()
    add_study_arguments(parser)
    parsed = parser.parse_args(['--jobs', '1', *given])
    check_study_arguments(parsed)
    return parsed


def wait_for_the_end_of(workers):
    # Not by psutil, which would collect their exit status, for which the executor's thread then waits for ever.
    poll_until(lambda: workers.isdisjoint(process.pid for process in active_children()), 'end of the workers')


@pytest.mark.costly
def test_results_come_in_order_and_are_the_same_in_several_processes():
    alone, together = (list(study(cube_there, 12).run(jobs)) for jobs in (1, 2))
    assert [(each.number, each.cube) for each in alone] == [(number, number**3) for number in range(12)]
    assert [(each.number, each.cube) for each in together] == [(each.number, each.cube) for each in alone]
    assert {each.process for each in alone} == {os.getpid()}
    workers = {each.process for each in together}
    assert os.getpid() not in workers and 1 <= len(workers) <= 2
    wait_for_the_end_of(workers)


def test_a_stopped_study_goes_on_from_its_file(tmp_path):
    path, run = tmp_path / 'made.jsonl', []

    def note(number):
        run.append(number)
        return cube(number)

    first = study(note).run(1, path)
    assert [next(first).number for _ in range(3)] == [0, 1, 2]
    first.close()
    results = list(study(note, 8).run(1, path))
    assert results == [cube(number) for number in range(8)]
    assert run == list(range(8))
    assert list(study(note, 8).run(1, path)) == results and run == list(range(8))
    assert len(path.read_text().splitlines()) == 1 + 8


def kill_yourself(number):
    os.kill(os.getpid(), signal.SIGKILL)


def sleep_after_the_first(number):
    if number > 0:
        time.sleep(60.0)
    return cube(number)


@pytest.mark.costly
def test_a_lost_worker_is_told():
    with pytest.raises(WorkerLost, match='a worker process was killed'):
        list(study(kill_yourself).run(2))


@pytest.mark.costly
def test_leaving_a_study_kills_its_workers():
    before = set(active_children())
    results = study(sleep_after_the_first).run(2)
    assert next(results) == cube(0)
    workers = {process.pid for process in set(active_children()) - before}
    # As with Ctrl-C.
    results.close()
    assert workers
    wait_for_the_end_of(workers)


def test_an_interrupted_study_shows_what_is_finished(tmp_path, capsys):
    def until_three(number):
        if number == 3:
            raise Interrupted
        return cube(number)

    path = tmp_path / 'made.json'
    with pytest.raises(Interrupted) as ended:
        study(until_three).conduct(arguments('--json', str(path)), lambda console, results: {})
    assert ended.value.kept == f'after 3 of 6 situations; finished results are in {path}'
    assert 'only part of the study has run' in capsys.readouterr().out
    written = json.loads(path.read_text())
    assert (written['complete'], len(written['results'])) == (False, 3)


@pytest.mark.parametrize('given, message', [
    (['--seed', '-1'], '--seed: -1 is not allowed; it must be 0 ... '),
    (['--jobs', '0'], '--jobs: 0 is not allowed; it must be 1 ... 1024'),
    (['--plot', 'a.txt'], 'a.txt: must end in .png or .svg or .pdf')])
def test_bad_arguments_are_refused_before_anything_runs(given, message):
    with pytest.raises(InvalidInput, match=message):
        arguments(*given)
