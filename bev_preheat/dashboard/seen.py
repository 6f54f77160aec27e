# SPDX-License-Identifier: Apache-2.0
"""The page's inputs from a planner, as plain values; instants in seconds of the planner's clock."""

from __future__ import annotations

from typing import NamedTuple


class PlanSeen(NamedTuple):
    """
    A PreheatPlan.

    `status` is the number of a planning.status.Status. Instants [s] are None if they are unset. Temperatures in
    deg C, charge 0 ... 1, charging times in s; NaN: unknown. The trajectories `times_s` (N + 1,) are instants,
    `temperatures_c` and `socs` are at them, `powers_w` (N,) between them; () without a plan. `later_legs` is the
    number of legs after this one.
    """

    at_s: float
    route_id: str
    method: str
    status: int
    sentence: str
    heating_start_s: float | None
    heating_end_s: float | None
    arrival_s: float | None
    predicted_c: float
    deviation_k: float
    target_c: float
    target_reason: str
    arrival_soc: float
    charging_s: float
    charging_unheated_s: float
    model_factors: tuple[float, ...] = ()
    later_legs: int = 0
    times_s: tuple[float, ...] = ()
    temperatures_c: tuple[float, ...] = ()
    socs: tuple[float, ...] = ()
    powers_w: tuple[float, ...] = ()


class EntrySeen(NamedTuple):
    """An entry of /diagnostics: name without the planner's, level (0 OK, 1 WARN, 2 ERROR, 3 STALE), values."""

    name: str
    level: int
    message: str
    values: dict[str, str]


class RouteSeen(NamedTuple):
    """The reserves of charge (0 ... 1) that a route asks for on arrival: at each stop, and at its end."""

    stop_reserves: tuple[float, ...]
    stops: int
    reserve: float

    def reserve_of_leg(self, later_legs: int) -> float:
        """Return the reserve at the end of the leg that has `later_legs` legs after it."""
        stop = self.stops - later_legs
        if later_legs <= 0 or not 0 <= stop < self.stops:
            return self.reserve
        return self.stop_reserves[stop] if stop < len(self.stop_reserves) else 0.0
