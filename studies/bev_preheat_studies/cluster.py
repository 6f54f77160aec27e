# SPDX-License-Identifier: Apache-2.0
"""
Workers on other computers: a cluster of dask.distributed as an executor.

If a worker dies, only time is lost: the scheduler gives its task to another worker. A worker's result depends
only on the trip's number, and each number counts once.
"""

from __future__ import annotations

from concurrent.futures import CancelledError, Executor
from contextlib import suppress
import logging
import re
from time import monotonic
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.optional_packages import require
from bev_preheat_studies.sources import sources

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future
    from typing import Any, TypeVar

    Result = TypeVar('Result')

ADDRESS = re.compile(r'([a-z]+://)?(\[[0-9a-fA-F:.]+\]|[\w.-]+):\d{1,5}')
# Connection timeout [s].
CONNECT_S = 5.0
CLOSE_S = 2.0
# Workers may join and leave; they are counted at this interval [s].
COUNTED_AGAIN_S = 2.0


class ClusterWorkers(Executor):
    """
    An executor on all workers of a dask scheduler; workers may join and leave.

    Leaving its `with` block cancels tasks that have not started. A worker finishes the trip that it has
    started; the result is dropped.
    """

    def __init__(self, address: str) -> None:
        """
        Connect to a scheduler at an address such as 'tcp://host:8786'.

        Raises InvalidInput if no scheduler answers, if it has no workers, or if a worker runs other sources of
        this program; MissingPackage without dask.distributed.
        """
        require('distributed')
        if not ADDRESS.fullmatch(address):
            raise InvalidInput(f'--cluster: {quoted(address)} is not an address such as tcp://host:8786')
        from distributed import Client, KilledWorker
        _silence('distributed')
        self.losses = {
            KilledWorker: 'a trip ended several workers of the cluster, one after the other',
            CancelledError: 'the scheduler of the cluster has gone'}
        self._address = address
        try:
            self._client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise InvalidInput(
                f'--cluster: {address}: no scheduler answers there: {_first_line(error)}') from error
        try:
            self._check()
        except BaseException:
            self._close()
            raise
        self._executor = self._client.get_executor(pure=False)
        self._counted_s, self._cores = monotonic(), self._count()

    @property
    def cores(self) -> int:
        """Number of tasks that the workers run at a time."""
        if monotonic() - self._counted_s > COUNTED_AGAIN_S:
            self._cores, self._counted_s = self._count(), monotonic()
        return self._cores

    def submit(self, function: Callable[..., Result], /, *arguments: Any,
               **options: Any) -> Future[Result]:
        """Return the Future of a task."""
        future: Future[Result] = self._executor.submit(function, *arguments, **options)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancel unfinished tasks, and disconnect."""
        with suppress(Exception):
            self._executor.shutdown(wait=False)
        self._close()

    def _count(self) -> int:
        # A lost scheduler is reported when results are awaited.
        with suppress(Exception):
            cores: int = sum(self._client.ncores().values())
            return max(1, cores)
        return 1

    def _check(self) -> None:
        if not self._client.ncores():
            raise InvalidInput(f'--cluster: {self._address}: the scheduler has no workers; start some: '
                               f'dask worker {self._address} --nthreads 1')
        try:
            found = self._client.run(sources)
        except Exception as error:
            raise InvalidInput(f'--cluster: {self._address}: a worker cannot run bev_preheat: '
                               f'{_first_line(error)}') from error
        for worker, version in found.items():
            if version != sources():
                raise InvalidInput(f'--cluster: {worker} runs bev_preheat {version}, this is {sources()}; '
                                   'the same sources are needed for the same results')

    def _close(self) -> None:
        with suppress(Exception):
            self._client.close(timeout=CLOSE_S)


def _silence(library: str) -> None:
    """Silence a library's log: the study reports each event in one line."""
    for name in (library, *logging.root.manager.loggerDict):
        if name.partition('.')[0] == library:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
