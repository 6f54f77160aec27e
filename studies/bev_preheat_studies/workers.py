# SPDX-License-Identifier: Apache-2.0
"""Worker processes that end with the work for which they were started."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
import multiprocessing
from multiprocessing import resource_tracker
import os
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Future
    from multiprocessing.process import BaseProcess
    from typing import Any, TypeVar

    Result = TypeVar('Result')


class Workers(ProcessPoolExecutor):
    """
    An executor of processes on this computer, one for each core if `jobs` is None.

    Leaving its `with` block kills them, whatever they are doing. They ignore SIGINT: Ctrl-C is for
    the process that started them, which then leaves the block. They also end when that process dies.
    """

    def __init__(self, jobs: int | None) -> None:
        """Start no process yet."""
        self.cores = jobs or os.cpu_count() or 1
        # A fork would inherit the solver's threads and the terminal's state.
        super().__init__(self.cores, mp_context=multiprocessing.get_context('spawn'), initializer=_begin)
        self._others: set[BaseProcess] = set(multiprocessing.active_children())

    def submit(self, function: Callable[..., Result], /, *arguments: Any,
               **options: Any) -> Future[Result]:
        """Return the Future of a task; may start a process."""
        with _interrupts_held():
            return super().submit(function, *arguments, **options)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill the processes."""
        for process in set(multiprocessing.active_children()) - self._others:
            process.kill()
        super().shutdown(wait=False, cancel_futures=True)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block SIGINT during the block; processes started in it never receive the signal."""
    # The tracker unblocks SIGINT when it starts, which would otherwise be with the first process.
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
