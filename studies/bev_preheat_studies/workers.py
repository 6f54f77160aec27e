# SPDX-License-Identifier: Apache-2.0
"""Worker processes for one task, which end with the work for which they were started."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
import multiprocessing
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
import os
import signal
import threading
from typing import Any

# The task of a worker process, and only that.
_tasks: list[Callable[[int], Any]] = []


class Workers(ProcessPoolExecutor):
    """
    Processes on this computer, each with the task.

    Leaving the `with` block kills them, whatever they are doing. They ignore SIGINT: Ctrl-C is for
    the process that started them, which then leaves the block. They also end when that process dies.
    """

    def __init__(self, task: Callable[[int], Any], cores: int) -> None:
        """Start no process yet."""
        # A fork would inherit the solver's threads and the terminal's state.
        super().__init__(cores, mp_context=multiprocessing.get_context('spawn'), initializer=_begin,
                         initargs=(task,))
        self._others: set[BaseProcess] = set(multiprocessing.active_children())

    def begin(self, number: int) -> Future[Any]:
        """Return the Future of the task with a number; may start a process."""
        with _interrupts_held():
            return self.submit(_run, number)

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


def _begin(task: Callable[[int], Any]) -> None:
    _tasks.append(task)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _run(number: int) -> Any:
    return _tasks[0](number)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
