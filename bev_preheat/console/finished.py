# SPDX-License-Identifier: Apache-2.0
"""What a study keeps when it is interrupted: all that is finished."""

from contextlib import contextmanager

from bev_preheat.console.program import Interrupted, WorkerLost
from bev_preheat.output_files import STANDARD_OUTPUT


class Ending:
    """How the work of a study ended; `cause` is None where it is complete."""

    cause = None

    @property
    def is_complete(self):
        """Whether nothing was interrupted."""
        return self.cause is None

    def tell(self, finished, wanted, what, files):
        """
        Raise the cause again, where there is one, now that what is finished has been kept.

        It says that `finished` of `wanted` are finished, a plural such as 'trips' being `what`, and
        which of `files` (None: not asked for) they are in.
        """
        if self.cause is None:
            return
        names = ['standard output' if path == STANDARD_OUTPUT else str(path)
                 for path in files if path is not None]
        if not finished:
            kept = 'nothing is finished, nothing is written'
        elif names:
            kept = f'the finished ones are in {" and ".join(names)}'
        else:
            kept = 'the summary is of the finished ones'
        self.cause.kept = f'after {finished} of {wanted} {what}; {kept}'
        raise self.cause


@contextmanager
def keeping_what_is_finished():
    """Give an Ending; an interruption ends the block, and may be told later."""
    ending = Ending()
    try:
        yield ending
    except (Interrupted, WorkerLost) as cause:
        ending.cause = cause
