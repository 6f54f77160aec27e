# SPDX-License-Identifier: Apache-2.0
"""Plans per second and core for drawn winter trips, in batches and one by one."""

from __future__ import annotations

from time import process_time
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core
from bev_preheat.planning.planner import METHODS
from bev_preheat_studies.cost.figures import Figure
from bev_preheat_studies.fleet.arrivals import arrivals_of_all, planned_in_the_core
from bev_preheat_studies.fleet.drawing import draw_fleet
from bev_preheat_studies.fleet.drawn_fleet import BLOCK, vehicle_of
from bev_preheat_studies.fleet.ways import arrivals_of

if TYPE_CHECKING:
    from collections.abc import Callable

# Plans per trip: one by each method; the runs without heating and always on are not counted.
PLANS = len(METHODS)
LEAST_PLANS_PER_S = 20e3
ROUNDS = 5
# Number of trips planned one by one, and of trips planned with all ways.
ONE_BY_ONE, ALL = 60, 2000


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures, by processor time; `log` takes a line of progress. Empty without the core."""
    if core() is None:
        return []
    # Do not measure the set-up of each vehicle.
    arrivals_of_all(draw_fleet(1, 0, ALL))
    at_once_s = []
    for block in range(ROUNDS):
        started = process_time()
        trips = draw_fleet(1, block)
        for car, places in trips.cars():
            planned_in_the_core(trips, car, places)
        at_once_s.append((process_time() - started) / BLOCK)
        log(f'fleet, block {block}: {1e6 * at_once_s[-1]:.0f} us a trip')
    trips = draw_fleet(1, 0, ALL)
    started = process_time()
    arrivals_of_all(trips)
    whole_s = (process_time() - started) / ALL
    # The same share of all cars; trips with an active limit are excluded from the comparison.
    some = [trips.trip(place) for place in np.linspace(0, ALL - 1, ONE_BY_ONE).astype(int).tolist()]
    one_by_one_s = []
    for trip in some:
        started = process_time()
        arrivals_of(trip, vehicle_of(trip.car))
        one_by_one_s.append(process_time() - started)
    at_once, alone = float(np.median(at_once_s)), float(np.median(one_by_one_s))
    mean_steps = float(trips.steps.mean())
    return [
        Figure(f'fleet, {mean_steps:.0f} steps on average, drawn and planned in batches: plans per s and core',
               PLANS / at_once, '1/s', LEAST_PLANS_PER_S, '>='),
        Figure('fleet, with the trips on which a limit is active, planned one by one: plans per s and core',
               PLANS / whole_s, '1/s'),
        Figure('fleet, plan_preheating trip by trip without an active limit: plans per s and core',
               PLANS / alone, '1/s')]
