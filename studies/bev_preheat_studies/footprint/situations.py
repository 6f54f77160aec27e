# SPDX-License-Identifier: Apache-2.0
"""The planned situations, with the plans in Python for comparison."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.ecu.vectors import BAD_INPUT, draw_vector, LONG_AT, LONG_EVERY, OK, vector_of
from bev_preheat.native.library import without_core
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.ecu.vectors import Vector
    from bev_preheat.vehicle.description import Vehicle

# As in check.c.
INSTANT_TOLERANCE_S, ENERGY_TOLERANCE_WH, ARRIVAL_TOLERANCE_K, ARRIVAL_TOLERANCE_SOC = 1e-3, 1e-3, 1e-4, 1e-7
TOLERANCES = np.array([
    *2 * [INSTANT_TOLERANCE_S], *6 * [ENERGY_TOLERANCE_WH], ARRIVAL_TOLERANCE_K, ARRIVAL_TOLERANCE_SOC])
# A plan that is searched for within limits may be another one: battery energy [Wh, share], arrival up to the
# target [K].
OTHER_WH, OTHER_SHARE, OTHER_K = 1.5, 1e-3, 0.1
# Of Vector.situation.
TARGET_C = 4
# Routes of the package, with their battery temperature at the start [deg C].
ROUTES = {'reference': 0.0, 'alpine_pass': -10.0}
ROUTE_SOC, ROUTE_TARGET_C = 0.9, 25.0


class Planned(NamedTuple):
    """
    The result and cost of a plan.

    `instructions` is None if they are not counted; `told` are the numbers of tell_plan in planned.h.
    """

    status: int
    stack_bytes: int
    instructions: int | None
    told: tuple[float, ...]


@dataclass(frozen=True)
class FootprintCase:
    """A Vector, and the name of its route; '' for a drawn trip."""

    vector: Vector
    route: str = ''

    @property
    def steps(self) -> int:
        """Number of steps of the trip."""
        return len(self.vector.columns[1])

    @property
    def numbers(self) -> array[float]:
        """The input of `take_situation` in planned.h."""
        return array('d', [*self.vector.situation, *(value for column in self.vector.columns for value in column)])

    def agrees(self, method: int, planned: Planned) -> bool:
        """Return whether a plan by METHODS[method] agrees with Python's, as in check.c."""
        answer = self.vector.answers[method]
        if planned.status != answer.status or answer.status != OK:
            return planned.status == answer.status
        if np.isclose(planned.told, answer.expected, rtol=0.0, atol=TOLERANCES, equal_nan=True).all():
            return True
        (*_, wh, arrival_c, _), (*_, expected_wh, expected_c, _) = planned.told, answer.expected
        target_c = self.vector.situation[TARGET_C]
        return (not answer.is_exact
                and abs(wh - expected_wh) <= max(OTHER_WH, OTHER_SHARE * abs(expected_wh))
                and abs(min(arrival_c, target_c) - min(expected_c, target_c)) <= OTHER_K)


def situations(vehicle: Vehicle, exported: Sequence[Vector], long: int, seed: int) -> list[FootprintCase]:
    """
    Return FootprintCases of a Vehicle: those of its export, `long` more with the most steps, and the ROUTES.

    Cases with a NaN are left out.
    """
    with without_core():
        vectors = [*exported, *(draw_vector(vehicle, seed, LONG_AT + LONG_EVERY * (len(exported) + number))
                                for number in range(long))]
        return [
            *(FootprintCase(vector) for vector in vectors if vector.answers[0].status != BAD_INPUT),
            *(FootprintCase(vector_of(make_trip(vehicle, load_route(route, vehicle.defaults)),
                                      BatteryState(start_c, ROUTE_SOC), Goal(ROUTE_TARGET_C)), route)
              for route, start_c in ROUTES.items())]
