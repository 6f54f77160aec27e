# SPDX-License-Identifier: Apache-2.0
"""Runs a fleet in blocks of trips, on any executor; what is kept does not grow with the fleet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.experiments.fleet.charging_times import charging_times_of
from bev_preheat.experiments.fleet.drawn_fleet import draw_fleet_trip, vehicle_of
from bev_preheat.experiments.fleet.tally import (
    ARRIVAL_C,
    BOUGHT_WH,
    CHARGING_S,
    groups_of,
    HEATER_WH,
    MORE_WH,
    REACHED,
    SAVED_S,
    Tally,
    tally_from,
)
from bev_preheat.experiments.fleet.ways import Arrival, arrivals_of, NONE, REACHED_K, WAYS
from bev_preheat.experiments.numbered import run_numbered

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from concurrent.futures import Executor
    from typing import Any

    from bev_preheat.experiments.fleet.drawn_fleet import FleetTrip

# A task is so many trips: some seconds of work, of which sending them is a small part.
BLOCK = 1000
# Why trips are left out.
NOT_DRIVEN, NEVER_CHARGED = 'not driven', 'never charged'


@dataclass(frozen=True)
class Block:
    """The Tally of the trips from `number` * BLOCK on, `size` of them."""

    number: int
    size: int
    tally: Tally

    def as_record(self) -> dict[str, Any]:
        """Return the block as JSON holds it."""
        return {'number': self.number, 'size': self.size, **self.tally.as_record()}


def block_from(record: dict[str, Any]) -> Block:
    """Return a Block from `as_record` of it."""
    return Block(record['number'], record['size'], tally_from(record))


def block_of(trips: int, seed: int, number: int) -> Block:
    """Return one Block of a fleet of so many trips."""
    first, end = number * BLOCK, min((number + 1) * BLOCK, trips)
    return Block(number, end - first, tally_of(draw_fleet_trip(seed, trip) for trip in range(first, end)))


def tally_of(trips: Iterable[FleetTrip]) -> Tally:
    """Return the Tally of drawn trips; it does not depend on their order."""
    tally = Tally()
    # What is compiled for a vehicle is kept for a few of them only.
    for (car, charger_w), same in groupby(
            sorted(trips, key=lambda trip: (trip.car, trip.charger_w)),
            key=lambda trip: (trip.car, trip.charger_w)):
        driven = []
        for trip in same:
            arrivals = arrivals_of(trip, vehicle_of(car))
            if arrivals is None:
                tally.left_out[NOT_DRIVEN] += 1
            else:
                driven.append((trip, arrivals))
        if driven:
            _charge(tally, driven, car, charger_w)
    return tally


def _charge(tally: Tally, driven: list[tuple[FleetTrip, dict[str, Arrival]]], car: str,
            charger_w: float) -> None:
    """Count trips of one car to one charger."""
    ambient_c = np.repeat([trip.ambient_c for trip, _ in driven], len(WAYS))
    ends = [arrivals[way] for _, arrivals in driven for way in WAYS]
    charging_s, bought_wh = (values.reshape(len(driven), len(WAYS)) for values in charging_times_of(
        car, charger_w).of(ambient_c, np.array([end.temperature_c for end in ends]),
                           np.array([end.soc for end in ends])))
    for (trip, arrivals), times_s, energies_wh in zip(driven, charging_s.tolist(), bought_wh.tolist()):
        if not np.isfinite(times_s).all():
            tally.left_out[NEVER_CHARGED] += 1
            continue
        unheated = WAYS.index(NONE)
        tally.count(groups_of(trip.car, trip.ambient_c, trip.length_min), {way: {
            HEATER_WH: arrivals[way].heater_wh, BOUGHT_WH: energy_wh, CHARGING_S: time_s,
            ARRIVAL_C: arrivals[way].temperature_c,
            REACHED: float(arrivals[way].temperature_c > trip.goal.target_temperature_c - REACHED_K),
            SAVED_S: times_s[unheated] - time_s, MORE_WH: energy_wh - energies_wh[unheated]}
            for way, time_s, energy_wh in zip(WAYS, times_s, energies_wh)})


def run_fleet(trips: int, seed: int, executor: Executor, report: Callable[[Block], object],
              finished: Mapping[int, Block] | None = None,
              keep: Callable[[int, Block], object] | None = None) -> None:
    """
    Run trips 0 … `trips` - 1 in blocks; `report` is called with each Block, in order.

    `finished` and `keep` are those of `run_numbered`; a finished block of another size, the last one of
    a smaller fleet, is run again. Raises WorkerLost where a process dies.
    """
    blocks = -(-trips // BLOCK)
    last = trips - (blocks - 1) * BLOCK
    usable = {number: block for number, block in (finished or {}).items()
              if block.size == (last if number == blocks - 1 else BLOCK)}
    for block in run_numbered(executor, partial(block_of, trips, seed), range(blocks), usable, keep):
        report(block)
