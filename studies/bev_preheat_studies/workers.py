# SPDX-License-Identifier: Apache-2.0
"""Worker processes that end with the work for which they were started."""

from __future__ import annotations

from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
import multiprocessing
from multiprocessing import resource_tracker
import os
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.process import BaseProcess
    from typing import Any, TypeVar

    # The type of a task's result.
    Result = TypeVar('Result')


class Workers(Executor):
    """
    An executor of processes on this computer, one for each core if `jobs` is None.

    Leaving its `with` block kills the processes, busy or not. They ignore SIGINT: Ctrl-C goes to the process
    that started them, which then leaves the block. They also end when that process dies.

    A submitted task cannot be cancelled: when a process ends, the pool's thread sets a result on each
    remaining task, and fails on a cancelled one.
    """

    def __init__(self, jobs: int | None) -> None:
        """Start no process yet."""
        self.cores = jobs or os.cpu_count() or 1
        # A fork would inherit the solver's threads and the terminal's state.
        self._pool = ProcessPoolExecutor(
            self.cores, mp_context=multiprocessing.get_context('spawn'), initializer=_begin)
        self._others: set[BaseProcess] = set(multiprocessing.active_children())

    def submit(self, function: Callable[..., Result], /, *arguments: Any,
               **options: Any) -> Future[Result]:
        """Return the Future of a task; may start a process."""
        task: Future[Result] = Future()
        task.set_running_or_notify_cancel()
        with _interrupts_held():
            of_the_pool = self._pool.submit(function, *arguments, **options)
        of_the_pool.add_done_callback(partial(_hand_on, task))
        return task

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill the processes."""
        for process in set(multiprocessing.active_children()) - self._others:
            process.kill()
        self._pool.shutdown(wait=False, cancel_futures=True)


def _hand_on(task: Future[Result], ended: Future[Result]) -> None:
    """Copy the result or exception of the pool's Future to the task."""
    error = CancelledError() if ended.cancelled() else ended.exception()
    if error is None:
        task.set_result(ended.result())
    else:
        task.set_exception(error)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block SIGINT inside the block; processes started in it ignore SIGINT for good."""
    # The resource tracker unblocks the signal when it starts; normally it starts with the first process.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
