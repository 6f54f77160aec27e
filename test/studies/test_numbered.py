# SPDX-License-Identifier: Apache-2.0
"""Trips by number: on any executor the same results in the same order, each computed once."""

from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from functools import partial
from itertools import count, islice
import os
import signal
import threading
import time

import psutil
import pytest
from run_here import Here

from bev_preheat.console.program import WorkerLost
from bev_preheat.errors import InvalidInput
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.vehicle.heat_path import DIRECT
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.robustness.car_study import CarResult, result_from
from bev_preheat_studies.workers import Workers


def cube(number):
    return number**3


class Backwards(Here):
    """Answers after four tasks have arrived, the last task first."""

    def __init__(self):
        super().__init__(cores=2)
        self._waiting = []

    def submit(self, function, /, *arguments, **options):
        self._waiting.append((Future(), super().submit(function, *arguments, **options).result()))
        futures = [future for future, _ in self._waiting]
        if len(futures) == 4:
            for future, result in reversed(self._waiting):
                future.set_result(result)
            self._waiting = []
        return futures[-1]


@pytest.mark.parametrize('make', [Here, partial(Here, 5), Backwards, partial(ThreadPoolExecutor, 3)])
def test_results_come_in_the_order_of_the_numbers(make):
    with make() as executor:
        assert list(run_numbered(executor, cube, range(12))) == [number**3 for number in range(12)]


def test_each_result_is_kept_as_soon_as_it_is_there():
    kept = []
    results = run_numbered(Backwards(), cube, range(4), keep=lambda *pair: kept.append(pair))
    assert next(results) == 0
    # Trip 0 came after two others.
    assert kept == [(2, 8), (1, 1), (0, 0)]


def test_what_is_finished_is_not_run_again():
    executor, kept = Here(), []
    results = list(run_numbered(executor, cube, range(6), {1: 'one', 4: 'four', 9: 'nine'},
                                lambda number, result: kept.append(number)))
    assert results == [0, 'one', 8, 27, 'four', 125]
    assert executor.ran == kept == [0, 2, 3, 5]


def test_a_study_that_is_complete_runs_nothing():
    executor = Here()
    results = run_numbered(executor, cube, count(), dict.fromkeys(range(7), 1))
    assert (list(islice(results, 7)), executor.ran) == ([1] * 7, [])


def test_no_more_is_handed_out_than_keeps_the_cores_busy():
    executor = Here(cores=4)
    next(run_numbered(executor, cube, count()))
    assert executor.ran == list(range(12))


def test_while_the_first_trip_takes_long_not_all_others_are_begun():
    class Slow(Here):
        """Answers the first task never, the others at once."""

        def submit(self, function, /, *arguments, **options):
            future = super().submit(function, *arguments, **options)
            if self.ran == [0]:
                future = self.first = Future()
            elif len(self.ran) == 32:
                self.first.set_result('late')
            return future

    executor = Slow(cores=2)
    assert next(run_numbered(executor, cube, count())) == 'late'
    assert len(executor.ran) == 32


class Broken(Executor):
    """Loses its workers."""

    def __init__(self, error):
        self.losses, self._error = {LookupError: 'all is lost'}, error

    def submit(self, function, /, *arguments, **options):
        future = Future()
        future.set_exception(self._error)
        return future


@pytest.mark.parametrize('error, message', [
    (BrokenExecutor(), 'a worker process was killed'), (KeyError('x'), 'all is lost')])
def test_a_lost_worker_is_told(error, message):
    with pytest.raises(WorkerLost) as lost:
        list(run_numbered(Broken(error), cube, range(3)))
    assert str(lost.value) == message


def test_an_error_of_a_trip_is_the_error_of_the_study():
    def fail(number):
        raise ZeroDivisionError(number)
    with pytest.raises(ZeroDivisionError, match='0'):
        list(run_numbered(Broken(ZeroDivisionError(0)), cube, range(3)))


def made(number):
    return CarResult(number, Mismatch(), DIRECT, None, {}, cpu_s=0.1 * number)


def made_from(record):
    return made(record['number'])


def test_a_stopped_study_goes_on_from_its_file(tmp_path):
    path, study = tmp_path / 'study.jsonl', {'study': 'made', 'seed': 3}
    with kept_results(path, study, made_from) as kept:
        first = list(islice(run_numbered(Here(), made, range(8), kept.finished, kept.keep), 3))
    executor = Here()
    with kept_results(path, study, made_from) as kept:
        again = list(run_numbered(executor, made, range(8), kept.finished, kept.keep))
    assert first == again[:3] and again == [made(number) for number in range(8)]
    assert executor.ran[-1] == 7 and not set(executor.ran) & {0, 1, 2}
    assert len(path.read_text().splitlines()) == 1 + 8


def test_a_line_that_is_no_result_is_named(tmp_path):
    path = tmp_path / 'study.jsonl'
    with kept_results(path, {'study': 'made'}, result_from):
        pass
    with path.open('a') as file:
        file.write('{"number": 0}\n')
    with pytest.raises(InvalidInput, match='line 2 is not a result of this study'), kept_results(
            path, {'study': 'made'}, result_from):
        pass


def process_of(number):
    return os.getpid()


def sleep_after(pids, number):
    with open(f'{pids}/{os.getpid()}', 'w'):
        pass
    time.sleep(60.0)


def kill_first(pids):
    while not list(pids.iterdir()):
        time.sleep(0.01)
    os.kill(int(next(pids.iterdir()).name), signal.SIGKILL)


# The message about a lost worker is tested above, daily.
@pytest.mark.deep
@pytest.mark.costly
def test_a_killed_process_ends_the_study_and_the_others_with_it(tmp_path):
    with Workers(2) as workers:
        found = set(run_numbered(workers, process_of, range(6)))
        threading.Thread(target=kill_first, args=(tmp_path,)).start()
        with pytest.raises(WorkerLost):
            next(run_numbered(workers, partial(sleep_after, tmp_path), range(2)))
    assert os.getpid() not in found and 1 <= len(found) <= 2
    processes = [psutil.Process(pid) for pid in found if psutil.pid_exists(pid)]
    assert psutil.wait_procs(processes, 10.0)[1] == []


@pytest.mark.costly
def test_leaving_the_block_while_processes_work_makes_no_noise(tmp_path, monkeypatch):
    """As with Ctrl-C."""
    heard = []
    monkeypatch.setattr(threading, 'excepthook', heard.append)
    with Workers(1) as workers:
        tasks = [workers.submit(sleep_after, tmp_path, number) for number in range(6)]
        while not list(tmp_path.iterdir()):
            time.sleep(0.01)
    end = time.monotonic() + 10.0
    while not all(task.done() for task in tasks):
        assert time.monotonic() < end
        time.sleep(0.01)
    assert heard == []
