# SPDX-License-Identifier: Apache-2.0
"""Arguments that name logs of drives, and the trips recorded in them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from bev_preheat.identification.trips import Trip
    from bev_preheat.vehicle import Vehicle


def add_log_arguments(parser: ArgumentParser, needs_logs: bool = True) -> None:
    """Add the logs, at least one if the command `needs_logs`, `--signals` and `--repair`."""
    parser.add_argument('logs', nargs='+' if needs_logs else '*', metavar='LOG',
                        help='recorded drives, charging sessions, nights at stand')
    parser.add_argument('--signals', metavar='NAME|FILE',
                        help="signal map of the logs (default: found from the logs' names of signals)")
    parser.add_argument('--repair', action='store_true',
                        help='correct mix-ups of sign, unit and scale that physics reveals')


def read_trips(arguments: Namespace, vehicle: Vehicle, is_fit: bool = False) -> list[Trip]:
    """
    Return the Trips of the logs, one recording in memory at a time.

    A fit also refuses recordings with doubts about sign or unit. Raises InvalidInput with one line for each
    problem of a log.
    """
    from bev_preheat.identification.recording_checks import refuse_doubted
    from bev_preheat.identification.trips import trip_of, trips_from
    from bev_preheat.logs.reading import read_recording

    def trip(path: str) -> Trip:
        recording = read_recording(Path(path), arguments.signals, arguments.repair)
        if is_fit:
            refuse_doubted(recording)
        return trip_of(recording, vehicle)

    return trips_from(partial(trip, path) for path in arguments.logs)
