# SPDX-License-Identifier: Apache-2.0
"""Keeps the finished results of an interrupted study."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from bev_preheat.commands.program import Interrupted, WorkerLost
from bev_preheat.files.output_files import STANDARD_OUTPUT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bev_preheat.files.output_files import AnyPath


class InterruptedEnding:
    """End of a study's work; `cause` is None if the study is complete."""

    cause: Interrupted | WorkerLost | None = None

    @property
    def is_complete(self) -> bool:
        """Whether the work ended without interruption."""
        return self.cause is None

    def tell(self, finished: int | str, wanted: int | str, what: str,
             files: Iterable[AnyPath | None], results: AnyPath | None = None) -> None:
        """
        Raise the cause, if any, after the finished results have been saved.

        The message says that `finished` of `wanted` `what` (a plural such as 'trips') are finished, and
        which of `files` (None: not requested) hold them; the study can continue from a file of `results`.
        """
        if self.cause is None:
            return
        names = ['standard output' if path == STANDARD_OUTPUT else str(path)
                 for path in files if path is not None]
        if not finished:
            kept = ('nothing finished, nothing written' if results is None
                    else 'no results yet')
        elif names:
            kept = f'finished results are in {" and ".join(names)}'
        else:
            kept = 'the summary covers finished results only'
        if results is not None:
            kept += f'; the same command continues from {results}'
        self.cause.kept = f'after {finished} of {wanted} {what}; {kept}'
        raise self.cause


@contextmanager
def keeping_what_is_finished() -> Iterator[InterruptedEnding]:
    """Yield an InterruptedEnding; an interruption ends the block, and can be raised later by `tell`."""
    ending = InterruptedEnding()
    try:
        yield ending
    except (Interrupted, WorkerLost) as cause:
        ending.cause = cause
