# SPDX-License-Identifier: Apache-2.0
"""Arguments of all studies: processes, cluster, and the file of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.output import check_output_arguments
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import OutputFile
from bev_preheat.optional_packages import require
from bev_preheat_studies.cluster import ClusterWorkers
from bev_preheat_studies.workers import Workers

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from collections.abc import Sequence
    from concurrent.futures import Executor

    from bev_preheat.files.output_files import AnyPath

JOBS = (1, 1024)


def add_study_arguments(parser: ArgumentParser) -> None:
    """Add `--jobs`, `--cluster` and `--results`."""
    parser.add_argument('--jobs', type=int, metavar='N', help='processes (default: all cores)')
    parser.add_argument('--cluster', metavar='ADDRESS',
                        help='run on the workers of this dask scheduler, such as tcp://host:8786, '
                        'instead of processes on this computer')
    parser.add_argument('--results', metavar='FILE',
                        help='append each result to this file (JSON lines); if the file exists, the study '
                        'resumes from it')


def check_study_arguments(arguments: Namespace, inputs: Sequence[AnyPath]) -> None:
    """
    Check `--jobs`, `--cluster`, `--results`, `--json` and `--plot` before the study starts.

    `inputs` are the files that the study reads. Raises InvalidInput.
    """
    low, high = JOBS
    if arguments.jobs is not None and not low <= arguments.jobs <= high:
        raise InvalidInput(f'--jobs: {arguments.jobs} is not allowed; it must be {low} ... {high}')
    if arguments.jobs is not None and arguments.cluster is not None:
        raise InvalidInput('--jobs sets the processes on this computer; with --cluster, the scheduler '
                           'sets the number of workers')
    check_output_arguments(arguments, inputs, [OutputFile('--results', arguments.results)])
    if arguments.cluster is not None:
        require('distributed')


def study_executor(arguments: Namespace) -> Executor:
    """Return the requested executor; leaving its `with` block cancels running tasks."""
    return Workers(arguments.jobs) if arguments.cluster is None else ClusterWorkers(arguments.cluster)
