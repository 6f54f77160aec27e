# SPDX-License-Identifier: Apache-2.0
"""
Runs the numbered trips of a study on any executor.

A task is a picklable function of a trip's number. Its result depends on that number only, so a study has the
same results on one core, on all, on a cluster, and in two halves.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import BrokenExecutor, CancelledError
from functools import lru_cache
import pickle
from queue import SimpleQueue
from typing import Generic, TYPE_CHECKING, TypeVar

from bev_preheat.console.program import WorkerLost

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from concurrent.futures import Executor, Future
    from typing import Any

Result = TypeVar('Result')

# Tasks submitted per core at a time, so that no core waits while results are on their way.
AHEAD = 3
# While one trip takes long, at most this many others per core are begun; their results wait in memory.
MOST_BEGUN = 16
# Unpickled tasks that a worker caches.
KEPT_TASKS = 4


def run_numbered(executor: Executor, task: Callable[[int], Result], numbers: Iterable[int],
                 finished: Mapping[int, Result] | None = None,
                 keep: Callable[[int, Result], object] | None = None) -> Iterator[Result]:
    """
    Return an iterator over `task(number)` of all `numbers`, in their order.

    Those of `finished` {number: result} are not run again. `keep(number, result)` is called with each other
    result as soon as it arrives, in any order. Leaving the executor's `with` block ends the tasks that are left.
    Raises WorkerLost if a worker dies and its task is lost. Optional attributes of an executor: `cores`, and
    `losses` {exception: explanation}, further exceptions that mean a lost worker.
    """
    return _Run(executor, task, numbers, finished or {}, keep or (lambda number, result: None)).results()


class _Run(Generic[Result]):
    """Submitted, running and finished trips of a study."""

    def __init__(self, executor: Executor, task: Callable[[int], Result], numbers: Iterable[int],
                 finished: Mapping[int, Result], keep: Callable[[int, Result], object]) -> None:
        self._executor, self._task, self._keep = executor, Shipped(task), keep
        self._losses: Mapping[type[Exception], str] = getattr(executor, 'losses', {})
        self._all_losses: tuple[type[Exception], ...] = (BrokenExecutor, CancelledError, *self._losses)
        self._numbers = iter(numbers)
        self._there = dict(finished)
        self._asked: deque[int] = deque()
        self._running: dict[Future[Result], int] = {}
        self._came: SimpleQueue[Future[Result]] = SimpleQueue()

    def results(self) -> Iterator[Result]:
        while True:
            while self._asked and self._asked[0] in self._there:
                yield self._there.pop(self._asked.popleft())
            if not self._ask():
                if not self._asked:
                    return
                self._receive()

    def _ask(self) -> bool:
        """Submit the next number if there is one and the executor has room; return whether it did."""
        cores: int = getattr(self._executor, 'cores', 1)
        if len(self._running) >= AHEAD * cores or len(self._asked) >= MOST_BEGUN * cores:
            return False
        number = next(self._numbers, None)
        if number is None:
            return False
        self._asked.append(number)
        if number not in self._there:
            try:
                future = self._executor.submit(self._task, number)
            except BrokenExecutor:
                raise WorkerLost from None
            self._running[future] = number
            future.add_done_callback(self._came.put)
        return True

    def _receive(self) -> None:
        """Wait for a result."""
        future = self._came.get()
        number = self._running.pop(future)
        try:
            result = future.result()
        except self._all_losses as error:
            raise WorkerLost(*(what for kind, what in self._losses.items()
                               if isinstance(error, kind))) from None
        self._there[number] = result
        self._keep(number, result)


class Shipped(Generic[Result]):
    """A task that is sent with each number, but unpickled only once in each worker."""

    def __init__(self, task: Callable[[int], Result]) -> None:
        """Pickle the task."""
        self._pickled = pickle.dumps(task)

    def __call__(self, number: int) -> Result:
        """Return the task's result."""
        result: Result = _unpickled(self._pickled)(number)
        return result


@lru_cache(maxsize=KEPT_TASKS)
def _unpickled(pickled: bytes) -> Callable[[int], Any]:
    task: Callable[[int], Any] = pickle.loads(pickled)
    return task
