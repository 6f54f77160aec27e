# SPDX-License-Identifier: Apache-2.0
"""Situations that the trips cover, and refusals of trips that determine nothing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import S_PER_H

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.identification.electrical import Electrical
    from bev_preheat.identification.trips import Trip

LEAST_TRIPS, MOST_TRIPS = 3, 200
# Least change of the battery temperature over any trip [K].
LEAST_CHANGE_K = 2.0
# A night that determines leakage: duration [h] and difference to the air [K].
NIGHT_H, NIGHT_DIFFERENCE_K = 3.0, 5.0


@dataclass(frozen=True)
class Coverage:
    """
    Situations covered by trips.

    Ranges are (low, high). The resistance is known between `resistance_from_c` and `resistance_to_c`, where at
    least
    two trips with voltage and current were; None: nowhere. `coldest_trip` is the only trip below, '' if none.
    """

    trips: int
    drives: int
    nights: int
    charging_sessions: int
    heated_trips: int
    unheated_drives: int
    hours: float
    battery_c: tuple[float, float]
    ambient_c: tuple[float, float]
    soc: tuple[float, float]
    speed_mps: tuple[float, float]
    resistance_from_c: float | None
    resistance_to_c: float | None
    coldest_trip: str
    coldest_c: float
    telling_nights: int

    def as_dictionary(self) -> dict[str, Any]:
        """Return the coverage in JSON form."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


def refuse_poor(trips: Sequence[Trip]) -> None:
    """Raise InvalidInput with a sentence for each reason why no car can be identified from Trips."""
    problems = []
    has_drive = any(trip.kind == 'drive' for trip in trips)
    if not trips or (has_drive and len(trips) < LEAST_TRIPS):
        problems.append(f'{len(trips)} usable log{"" if len(trips) == 1 else "s"}; at least {LEAST_TRIPS} are '
                        'needed with drives, because each is predicted from the others; record more drives')
    if len(trips) > MOST_TRIPS:
        problems.append(f'{len(trips)} logs; at most {MOST_TRIPS} are fitted; leave out the shortest')
    changes_k = [float(np.ptp(trip.battery_temperature_c)) for trip in trips]
    if trips and max(changes_k) < LEAST_CHANGE_K:
        problems.append(f'battery_temperature_c changes by at most {max(changes_k):.1f} K within a log; at least '
                        f'{LEAST_CHANGE_K:g} K are needed; record drives of 20 min or more with a cold battery, '
                        'or a night at stand after a drive')
    if trips and all(trip.kind == 'charging session' for trip in trips):
        problems.append('none of the logs is a drive, a night or heated at stand; record at least one drive of '
                        '20 min')
    if problems:
        raise InvalidInput(problems)


def coverage_of(trips: Sequence[Trip], electrical: Electrical) -> Coverage:
    """Return the Coverage of Trips."""
    def span(name: str) -> tuple[float, float]:
        return (min(float(getattr(trip, name).min()) for trip in trips),
                max(float(getattr(trip, name).max()) for trip in trips))

    telling = [trip for trip in trips if trip.name in electrical.used]
    lows = sorted((float(trip.battery_temperature_c.min()), trip.name) for trip in telling)
    highs = sorted((float(trip.battery_temperature_c.max()) for trip in telling), reverse=True)
    drives = [trip for trip in trips if trip.kind == 'drive']
    nights = [trip for trip in trips if trip.kind == 'night at stand']
    return Coverage(
        len(trips), len(drives), len(nights), sum(trip.kind == 'charging session' for trip in trips),
        sum(trip.heats for trip in trips), sum(not trip.heats for trip in drives),
        sum(map(len, trips)) / S_PER_H, span('battery_temperature_c'), span('ambient_c'), span('soc'),
        span('speed_mps'), lows[1][0] if len(lows) > 1 else None, highs[1] if len(highs) > 1 else None,
        lows[0][1] if lows else '', lows[0][0] if lows else float('nan'),
        sum(len(trip) > NIGHT_H * S_PER_H
            and float(np.mean(np.abs(trip.battery_temperature_c - trip.ambient_c))) > NIGHT_DIFFERENCE_K
            for trip in nights))
