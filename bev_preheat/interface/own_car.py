# SPDX-License-Identifier: Apache-2.0
"""The part of the public interface for recorded drives of one's own car."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.identification.check import Check
    from bev_preheat.identification.result import Identification
    from bev_preheat.logs.recording import Recording
    from bev_preheat.vehicle import Vehicle


def check(vehicle: Vehicle, recordings: Sequence[Recording], replays: bool = True) -> Check:
    """
    Return how well a vehicle predicts recorded drives, as `preheat check` does.

    `replays`: also as the running planner, with its estimation and without. Raises InvalidInput, which names log,
    signal, value and allowed range.
    """
    from bev_preheat.identification.check import check_trips
    from bev_preheat.identification.trips import trips_of
    return check_trips(vehicle, trips_of(recordings, vehicle), replays)


def identify(vehicle: Vehicle, recordings: Sequence[Recording], name: str = 'identified') -> Identification:
    """
    Return the car that drove the recordings, as `preheat identify` does.

    It needs casadi and scipy (extra `identify`). `vehicle` is the car to start from, `name` the new car's, which
    is the attribute `vehicle` of the result. Raises InvalidInput if the recordings tell too little.
    """
    require('casadi', 'scipy')
    from bev_preheat.identification.identify import identify as identify_trips
    from bev_preheat.identification.trips import trips_of
    return identify_trips(vehicle, trips_of(recordings, vehicle), name)
