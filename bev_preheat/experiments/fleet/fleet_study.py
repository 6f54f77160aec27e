# SPDX-License-Identifier: Apache-2.0
"""Runs a fleet in blocks of trips, on any executor; what is kept does not grow with the fleet."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, replace
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
    QUANTITIES,
    REACHED,
    SAVED_S,
    Tally,
    tally_from,
)
from bev_preheat.experiments.fleet.ways import Arrival, arrivals_of, NONE, REACHED_K, WAYS
from bev_preheat.experiments.kept_results import open_results, results_of
from bev_preheat.experiments.numbered import run_numbered

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable, Iterator, Mapping
    from concurrent.futures import Executor
    from typing import Any

    from bev_preheat.experiments.fleet.drawn_fleet import FleetTrip
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.numerics.arrays import FloatArray

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
    first, size = number * BLOCK, size_of(trips, number)
    return Block(number, size, tally_of(
        draw_fleet_trip(seed, trip) for trip in range(first, first + size)))


def tally_of(trips: Iterable[FleetTrip]) -> Tally:
    """Return the Tally of drawn trips; it does not depend on their order."""
    tally = Tally()
    groups: list[tuple[str, ...]] = []
    values: list[FloatArray] = []
    # What is compiled for a vehicle is kept for a few of them only.
    for (car, charger_w), same in groupby(sorted(trips, key=_plug_of), key=_plug_of):
        driven = []
        for trip in same:
            arrivals = arrivals_of(trip, vehicle_of(car))
            if arrivals is None:
                tally.left_out[NOT_DRIVEN] += 1
            else:
                driven.append((trip, arrivals))
        if driven:
            charged = _charged(driven, car, charger_w)
            ends = np.array(np.isfinite(charged).all(axis=(1, 2)))
            tally.left_out[NEVER_CHARGED] += int((~ends).sum())
            groups += [groups_of(car, trip.ambient_c, trip.length_min)
                       for (trip, _), does_end in zip(driven, ends.tolist()) if does_end]
            values.append(charged[ends])
    tally.left_out = +tally.left_out
    if groups:
        tally.count(groups, WAYS, np.concatenate(values))
    return tally


def _plug_of(trip: FleetTrip) -> tuple[str, float]:
    return trip.car, trip.charger_w


def _charged(driven: list[tuple[FleetTrip, dict[str, Arrival]]], car: str,
             charger_w: float) -> FloatArray:
    """
    Return what trips of one car to one charger come to, shape (trips, WAYS, QUANTITIES).

    Where a session does not end, its values are not finite.
    """
    shape = len(driven), len(WAYS)
    ends = [arrivals[way] for _, arrivals in driven for way in WAYS]
    heater_wh, arrival_c, soc = np.array([(end.heater_wh, end.temperature_c, end.soc) for end in ends]).T
    ambient_c, target_c = (np.repeat(of_trips, len(WAYS)) for of_trips in (
        [trip.ambient_c for trip, _ in driven], [trip.goal.target_temperature_c for trip, _ in driven]))
    charging_s, bought_wh = charging_times_of(car, charger_w).of(ambient_c, arrival_c, soc)
    unheated = WAYS.index(NONE)

    def above_unheated(values: FloatArray) -> FloatArray:
        by_trip = values.reshape(shape)
        difference: FloatArray = by_trip - by_trip[:, unheated:unheated + 1]
        return difference.ravel()

    # An infinite time less another one is no number, and no trip that is counted.
    with np.errstate(invalid='ignore'):
        columns = {HEATER_WH: heater_wh, BOUGHT_WH: bought_wh, CHARGING_S: charging_s, ARRIVAL_C: arrival_c,
                   REACHED: (arrival_c > target_c - REACHED_K).astype(float),
                   SAVED_S: -above_unheated(charging_s), MORE_WH: above_unheated(bought_wh)}
    return np.stack([columns[quantity] for quantity in QUANTITIES], axis=-1).reshape(*shape, len(QUANTITIES))


def size_of(trips: int, number: int) -> int:
    """Return how many trips a block of a fleet of so many trips has."""
    return min(BLOCK, trips - number * BLOCK)


def run_fleet(trips: int, seed: int, executor: Executor, report: Callable[[Block], object],
              finished: Container[int] = (), keep: Callable[[int, Block], object] | None = None) -> None:
    """
    Run trips 0 … `trips` - 1 in blocks, but for those of `finished`; `report` is called with each Block.

    `keep` is that of `run_numbered`. Raises WorkerLost where a process dies.
    """
    numbers = (number for number in range(-(-trips // BLOCK)) if number not in finished)
    for block in run_numbered(executor, partial(block_of, trips, seed), numbers, keep=keep):
        report(block)


@dataclass(frozen=True)
class KeptFleet:
    """The numbers of the blocks that a results file has, their Tally, and what keeps a new one."""

    finished: set[int]
    tally: Tally
    keep: Callable[[int, Block], object] | None = None


@contextmanager
def kept_fleet(path: AnyPath | None, study: Mapping[str, Any], trips: int) -> Iterator[KeptFleet]:
    """
    Give the KeptFleet of a fleet of so many trips, whose `study` plain values describe.

    A block of another size, the last one of a smaller fleet, is not used. Raises InvalidInput where the
    file holds another study, or is damaged.
    """
    kept = KeptFleet(set(), Tally())
    if path is None:
        yield kept
        return
    with open_results(path, study) as file:
        # Of a million trips there are a thousand blocks: only their sum stays in memory.
        for block in results_of(file, path, block_from):
            is_of_fleet = 0 <= block.number and size_of(trips, block.number) == block.size
            if is_of_fleet and block.number not in kept.finished:
                kept.finished.add(block.number)
                kept.tally.add(block.tally)
        yield replace(kept, keep=lambda number, block: file.append(block.as_record()))
