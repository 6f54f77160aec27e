# SPDX-License-Identifier: Apache-2.0
"""An executor that runs each task at once in this process, which starts no worker for it."""

from concurrent.futures import Executor, Future


class Here(Executor):
    """Takes the place of a study's worker processes; `cores` is their number, `ran` are the tasks' arguments."""

    def __init__(self, cores=1):
        self.cores, self.ran = cores, []

    def submit(self, function, /, *arguments, **options):
        self.ran += arguments
        future = Future()
        future.set_result(function(*arguments, **options))
        return future
