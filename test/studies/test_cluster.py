# SPDX-License-Identifier: Apache-2.0
"""Studies on a dask cluster: the same results as on one core, also when a worker is killed."""

from contextlib import ExitStack
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from bev_preheat import optional_packages
from bev_preheat.commands.main import main
from bev_preheat.errors import InvalidInput
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.vehicle.heat_path import DIRECT
from bev_preheat_studies.cluster import ClusterWorkers
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.robustness.car_study import CarResult

pytestmark = pytest.mark.needs('distributed')
TRIPS = 40


def drive_slowly(number):
    """Return a result that depends on the number, and its worker."""
    time.sleep(0.15)
    return CarResult(number, Mismatch(), DIRECT, None, {}, cpu_s=1.0 / (1.0 + number), pace=os.getpid())


def from_record(record):
    return CarResult(record['number'], Mismatch(), DIRECT, None, {}, record['cpu_s'], record['pace'])


@pytest.fixture
def stack():
    """Ends the processes started by a test."""
    with ExitStack() as stack:
        yield stack


def start(stack, *words):
    """Start a process of dask's."""
    process = subprocess.Popen([sys.executable, '-m', 'dask', *words], stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, env={**os.environ, 'PYTHONPATH': os.pathsep.join(
                                   (os.path.dirname(__file__), *sys.path))})
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


@pytest.fixture
def address(stack):
    """The address of a scheduler in a process of its own."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    start(stack, 'scheduler', '--host', '127.0.0.1', '--port', str(port), '--no-dashboard')
    return f'tcp://127.0.0.1:{port}'


def connected(address):
    """Return ClusterWorkers as soon as there are two."""
    for _ in range(60):
        try:
            workers = ClusterWorkers(address)
        except InvalidInput as error:
            assert 'no workers' in str(error) or 'no scheduler answers' in str(error)
            time.sleep(0.5)
            continue
        if workers.cores == 2:
            return workers
        workers.shutdown()
    raise TimeoutError


@pytest.mark.deep
def test_a_worker_that_is_killed_costs_no_result_and_none_is_counted_twice(stack, address, tmp_path):
    for _ in range(2):
        start(stack, 'worker', address, '--nthreads', '1', '--no-nanny', '--no-dashboard')
    path, killed, results = tmp_path / 'study.jsonl', None, []
    with connected(address) as workers, kept_results(path, {}, from_record) as kept:
        for result in run_numbered(workers, drive_slowly, range(TRIPS), kept.finished, kept.keep):
            results.append(result)
            if len(results) == TRIPS // 4:
                killed = int(result.pace)
                os.kill(killed, signal.SIGKILL)
    assert [result.number for result in results] == list(range(TRIPS))
    assert [result.cpu_s for result in results] == [1.0 / (1.0 + number) for number in range(TRIPS)]
    # Both worked; the surviving one until the end.
    assert {int(result.pace) for result in results} >= {killed} and int(results[-1].pace) != killed
    with kept_results(path, {}, from_record) as kept:
        assert [kept.finished[number] for number in range(TRIPS)] == results
    assert len(path.read_text().splitlines()) == 1 + TRIPS


@pytest.mark.costly
def test_a_cluster_within_this_process_answers_in_order():
    from distributed import LocalCluster
    with (LocalCluster('127.0.0.1:0', n_workers=2, threads_per_worker=1, processes=False,
                       dashboard_address=None, protocol='tcp') as cluster,
          ClusterWorkers(cluster.scheduler_address) as workers):
        assert workers.cores == 2
        assert list(run_numbered(workers, abs, range(-9, 0))) == list(range(9, 0, -1))


@pytest.mark.parametrize('address', ['nonsense:x:y', 'tcp://host', '', 'tcp://host:8786 now'])
def test_what_is_no_address_is_refused_in_one_line(address, capsys):
    assert main(['robustness', '--trips', '1', '--cluster', address]) == 2
    assert capsys.readouterr().err == (
        f'preheat: error: --cluster: {address!r} is not an address such as tcp://host:8786\n')


def test_processes_and_a_cluster_exclude_each_other(capsys):
    assert main(['sweep', '--cluster', 'tcp://127.0.0.1:1', '--jobs', '2']) == 2
    assert '--jobs sets the processes on this computer' in capsys.readouterr().err


def test_without_dask_one_line_says_how_to_install_it(monkeypatch, capsys):
    monkeypatch.setattr(optional_packages, 'find_spec', lambda name: None)
    assert main(['robustness', '--trips', '1', '--cluster', 'tcp://127.0.0.1:1']) == 2
    assert capsys.readouterr().err == (
        'preheat: error: the Python package distributed, which runs studies on a cluster, is not installed; '
        'in the checkout, scripts/setup.bash studies installs it; elsewhere: python3 -m pip install distributed\n')
