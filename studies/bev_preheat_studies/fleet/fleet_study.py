# SPDX-License-Identifier: Apache-2.0
"""Run a fleet in blocks of trips, on any executor; memory does not grow with the fleet."""

from __future__ import annotations

from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat_studies.fleet.arrivals import arrivals_of_all
from bev_preheat_studies.fleet.charging_times import charging_times_of, ChargingTimes
from bev_preheat_studies.fleet.drawing import draw_fleet
from bev_preheat_studies.fleet.drawn_fleet import BLOCK, CARS, CHARGERS_W, goal_of
from bev_preheat_studies.fleet.tally import (
    ARRIVAL_C,
    BOUGHT_WH,
    CHARGING_S,
    groups_of_all,
    HEATER_WH,
    MORE_WH,
    QUANTITIES,
    REACHED,
    SAVED_S,
    Tally,
    tally_from,
)
from bev_preheat_studies.fleet.ways import NONE, REACHED_K, WAYS
from bev_preheat_studies.kept_results import open_results, results_of
from bev_preheat_studies.numbered import run_numbered

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator, Mapping
    from concurrent.futures import Executor
    from typing import Any

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat_studies.fleet.arrivals import Arrivals
    from bev_preheat_studies.fleet.drawn_fleet import FleetTrips

# Each car at each charger [W].
PLUGS = tuple(product(CARS, CHARGERS_W))
# Reasons for leaving a trip out.
NOT_DRIVEN, NEVER_CHARGED = 'not driven', 'never charged'


@dataclass(frozen=True)
class TripBlock:
    """The Tally of the trips from `number` * BLOCK on, `size` of them."""

    number: int
    size: int
    tally: Tally

    def as_record(self) -> dict[str, Any]:
        """Return the block as plain values for JSON."""
        return {'number': self.number, 'size': self.size, **self.tally.as_record()}


def block_from(record: dict[str, Any]) -> TripBlock:
    """Return the TripBlock of a dictionary made by `as_record`."""
    return TripBlock(record['number'], record['size'], tally_from(record))


def block_of(trips: int, seed: int, tables: Mapping[tuple[str, float], ChargingTimes], number: int) -> TripBlock:
    """Return block `number` of a fleet of `trips` trips; `tables` are those of `tally_of`."""
    size = size_of(trips, number)
    return TripBlock(number, size, tally_of(draw_fleet(seed, number, size), tables))


def tally_of(trips: FleetTrips,
             tables: Mapping[tuple[str, float], ChargingTimes] = MappingProxyType({})) -> Tally:
    """Return the Tally of drawn trips; builds a table for each car and charger [W] missing in `tables`."""
    arrivals = arrivals_of_all(trips)
    charged = _charged(trips, arrivals, tables)
    are_charged = np.isfinite(charged).all(axis=(1, 2))
    are_counted = arrivals.are_driven & are_charged
    tally = Tally(left_out=+Counter({NOT_DRIVEN: int((~arrivals.are_driven).sum()),
                                     NEVER_CHARGED: int((arrivals.are_driven & ~are_charged).sum())}))
    if are_counted.any():
        cars = list(CARS)
        tally.count(groups_of_all([cars[car] for car in trips.car[are_counted].tolist()],
                                  trips.ambient_c[are_counted], trips.length_min[are_counted]),
                    WAYS, charged[are_counted])
    return tally


def _charged(trips: FleetTrips, arrivals: Arrivals,
             tables: Mapping[tuple[str, float], ChargingTimes]) -> FloatArray:
    """
    Return the quantities of trips, shape (K, WAYS, QUANTITIES).

    Values are not finite if a trip cannot be driven or a session does not end.
    """
    heater_wh, arrival_c, soc = arrivals.heater_wh, arrivals.temperature_c, arrivals.soc
    charging_s, bought_wh = np.empty_like(soc), np.empty_like(soc)
    target_c = np.array([goal_of(car).target_temperature_c for car in CARS])[trips.car, np.newaxis]
    for car, charger_w, places in trips.plugs():
        table = tables.get((car, charger_w)) or charging_times_of(car, charger_w)
        found = table.of(
            np.repeat(trips.ambient_c[places], len(WAYS)), arrival_c[places].ravel(), soc[places].ravel())
        for values, of_plug in zip((charging_s, bought_wh), found):
            values[places] = of_plug.reshape(-1, len(WAYS))
    unheated = WAYS.index(NONE)

    def above_unheated(values: FloatArray) -> FloatArray:
        difference: FloatArray = values - values[:, unheated:unheated + 1]
        return difference

    # Infinity minus infinity is NaN; such a trip is not counted.
    with np.errstate(invalid='ignore'):
        columns = {HEATER_WH: heater_wh, BOUGHT_WH: bought_wh, CHARGING_S: charging_s, ARRIVAL_C: arrival_c,
                   REACHED: (arrival_c > target_c - REACHED_K).astype(float),
                   SAVED_S: -above_unheated(charging_s), MORE_WH: above_unheated(bought_wh)}
    return np.stack([columns[quantity] for quantity in QUANTITIES], axis=-1)


def size_of(trips: int, number: int) -> int:
    """Return the number of trips in block `number` of a fleet of `trips` trips."""
    return min(BLOCK, trips - number * BLOCK)


def run_fleet(trips: int, seed: int, executor: Executor, report: Callable[[TripBlock], object],
              finished: Container[int] = (), keep: Callable[[int, TripBlock], object] | None = None) -> None:
    """
    Run trips 0 … `trips` - 1 in blocks except those in `finished`; call `report` with each TripBlock.

    `keep` is passed to `run_numbered`. Raises WorkerLost if a process dies.
    """
    numbers = [number for number in range(-(-trips // BLOCK)) if number not in finished]
    # A table takes as long as a thousand trips: build each once, not in every process. A single block needs few.
    tables = dict(zip(PLUGS, run_numbered(executor, _table, range(len(PLUGS))))) if len(numbers) > 1 else {}
    for block in run_numbered(executor, partial(block_of, trips, seed, tables), numbers, keep=keep):
        report(block)


def _table(number: int) -> ChargingTimes:
    return charging_times_of(*PLUGS[number])


@dataclass(frozen=True)
class KeptFleet:
    """The blocks found in a results file: their numbers and their Tally; `keep` appends a new block."""

    finished: set[int]
    tally: Tally
    keep: Callable[[int, TripBlock], object] | None = None


@contextmanager
def kept_fleet(path: AnyPath | None, study: Mapping[str, Any], trips: int) -> Iterator[KeptFleet]:
    """
    Give the KeptFleet of a fleet of `trips` trips, identified by the plain values in `study`.

    A block of another size (the last block of a smaller fleet) is ignored. Raises InvalidInput if the
    file holds another study or is damaged.
    """
    kept = KeptFleet(set(), Tally())
    if path is None:
        yield kept
        return
    with open_results(path, study) as file:
        # A million trips are 250 blocks; only their sum stays in memory.
        for block in results_of(file, path, block_from):
            is_of_fleet = 0 <= block.number and size_of(trips, block.number) == block.size
            if is_of_fleet and block.number not in kept.finished:
                kept.finished.add(block.number)
                kept.tally.add(block.tally)
        yield replace(kept, keep=lambda number, block: file.append(block.as_record()))
