# SPDX-License-Identifier: Apache-2.0
"""Runs a reader of damaged files in a process of its own, which may crash or never end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
import multiprocessing
from typing import Any

# Without a reading in this time [s] the reader has lost its way in the file.
LONGEST_WAIT_S = 60.0
MOST_MEMORY_BYTES = 8 << 30


class ReaderLost(Exception):
    """The reader crashed, or yielded nothing for too long."""


def in_child(reader: Callable[..., Iterator[Any]], *arguments: Any) -> Iterator[Any]:
    """
    Yield the values of a generator function that runs in a process of its own.

    Raises its exceptions; ReaderLost if it crashes or yields nothing for LONGEST_WAIT_S. Where processes cannot be
    forked it runs in this one.
    """
    if 'fork' not in multiprocessing.get_all_start_methods():
        yield from reader(*arguments)
        return
    context = multiprocessing.get_context('fork')
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_run, args=(there, reader, arguments), daemon=True)
    child.start()
    there.close()
    try:
        while True:
            if not here.poll(LONGEST_WAIT_S):
                raise ReaderLost(f'nothing could be read for {LONGEST_WAIT_S:g} s')
            try:
                kind, value = here.recv()
            except EOFError:
                raise ReaderLost('its reader crashed') from None
            if kind == 'end':
                return
            if kind == 'error':
                raise value
            yield value
    finally:
        here.close()
        child.kill()
        child.join()


def _run(there: Any, reader: Callable[..., Iterator[Any]], arguments: tuple[Any, ...]) -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))
    try:
        for value in reader(*arguments):
            there.send(('value', value))
        there.send(('end', None))
    except Exception as error:
        # Some exceptions of other packages cannot be sent.
        there.send(('error', error if type(error).__module__.startswith(('builtins', 'bev_preheat'))
                    else RuntimeError(str(error) or type(error).__name__)))
