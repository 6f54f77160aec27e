# SPDX-License-Identifier: Apache-2.0
"""Arguments that name logs of drives, and the trips recorded in them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from bev_preheat.identification.trips import Trip
    from bev_preheat.vehicle import Vehicle


def add_log_arguments(parser: ArgumentParser, needs_logs: bool = True) -> None:
    """Add the logs, at least one if the command `needs_logs`, and `--signals`."""
    parser.add_argument('logs', nargs='+' if needs_logs else '*', metavar='LOG',
                        help='recorded drives, charging sessions, nights at stand')
    parser.add_argument('--signals', metavar='NAME|FILE',
                        help="signal map of the logs (default: found from the logs' names of signals)")


def read_trips(arguments: Namespace, vehicle: Vehicle) -> list[Trip]:
    """Return the Trips of the logs; raise InvalidInput with one line for each log that is refused."""
    from bev_preheat.identification.trips import trips_of
    from bev_preheat.logs.reading import read_recording
    recordings, problems = [], []
    for path in arguments.logs:
        try:
            recordings.append(read_recording(Path(path), arguments.signals))
        except InvalidInput as error:
            problems += error.problems
    if problems:
        raise InvalidInput(problems)
    return trips_of(recordings, vehicle)
