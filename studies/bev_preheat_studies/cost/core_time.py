# SPDX-License-Identifier: Apache-2.0
"""Time spent in calls of the native core."""

from __future__ import annotations

from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

from bev_preheat.native.library import core

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextmanager
def timed_core(durations_s: list[float]) -> Iterator[None]:
    """Append the duration of each call of the core [s] to a list inside the block."""
    library = core()
    functions = {name: each for name, each in vars(library).items() if name.startswith('bev_')}

    def timed(function: Callable[..., int]) -> Callable[..., int]:
        def call(*arguments: object) -> int:
            started = perf_counter()
            status = function(*arguments)
            durations_s.append(perf_counter() - started)
            return status
        return call

    for name, each in functions.items():
        setattr(library, name, timed(each))
    try:
        yield
    finally:
        for name, each in functions.items():
            setattr(library, name, each)
