# SPDX-License-Identifier: Apache-2.0
"""What a study keeps when it is interrupted: all that is finished."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from bev_preheat.console.program import Interrupted, WorkerLost
from bev_preheat.files.output_files import STANDARD_OUTPUT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bev_preheat.files.output_files import AnyPath


class InterruptedEnding:
    """How the work of a study ended; `cause` is None where it is complete."""

    cause: Interrupted | WorkerLost | None = None

    @property
    def is_complete(self) -> bool:
        """Whether nothing was interrupted."""
        return self.cause is None

    def tell(self, finished: int | str, wanted: int | str, what: str,
             files: Iterable[AnyPath | None], results: AnyPath | None = None) -> None:
        """
        Raise the cause again, where there is one, now that what is finished has been kept.

        It says that `finished` of `wanted` are finished, a plural such as 'trips' being `what`, and
        which of `files` (None: not asked for) they are in; from a file of `results` the study goes on.
        """
        if self.cause is None:
            return
        names = ['standard output' if path == STANDARD_OUTPUT else str(path)
                 for path in files if path is not None]
        if not finished:
            kept = ('nothing is finished, nothing is written' if results is None
                    else 'there is nothing to sum up yet')
        elif names:
            kept = f'the finished ones are in {" and ".join(names)}'
        else:
            kept = 'the summary is of the finished ones'
        if results is not None:
            kept += f'; the same command goes on from {results}'
        self.cause.kept = f'after {finished} of {wanted} {what}; {kept}'
        raise self.cause


@contextmanager
def keeping_what_is_finished() -> Iterator[InterruptedEnding]:
    """Give an Ending; an interruption ends the block, and may be told later."""
    ending = InterruptedEnding()
    try:
        yield ending
    except (Interrupted, WorkerLost) as cause:
        ending.cause = cause
