# SPDX-License-Identifier: Apache-2.0
"""A goal of ~/prepare_battery and its outcome."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math
from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.control.grid_prices import GridPrices


class PreparationEnding(IntEnum):
    """Why a goal ended; the values of PrepareBattery's `code`."""

    REACHED = 1
    MISSED = 2
    CANCELED = 3
    REFUSED = 4
    REPLACED = 5
    DISABLED = 6
    INPUT_LOST = 7
    UNPLUGGED = 8
    SHUTTING_DOWN = 9


@dataclass(frozen=True, eq=False)
class PreparationGoal:
    """
    A request for a warm battery at an instant [ns of the node's clock]; it equals only itself.

    `ready_at_ns` 0: as soon as possible. `target_c` [deg C] None: the planner's default.
    `is_plugged_in`: the vehicle stands, and the grid feeds the heater. `ambient_c` [deg C] None: that
    of the route, or the last known; `assumed_ambient_c` [deg C] counts if none is known. `prices` are those of
    energy from the grid: a plugged-in vehicle is heated when it costs the least; None: as late as possible.
    """

    ready_at_ns: int = 0
    target_c: float | None = None
    is_plugged_in: bool = False
    ambient_c: float | None = None
    assumed_ambient_c: float | None = None
    prices: GridPrices | None = None

    @property
    def is_soonest(self) -> bool:
        """Whether the battery is wanted warm as soon as possible."""
        return self.ready_at_ns == 0


class PreparationOutcome(NamedTuple):
    """
    The ending of a PreparationGoal, with the reason as a sentence.

    `shortfall_k` is the shortfall to the target [K], `temperature_c` the battery's temperature [deg C];
    NaN if unknown.
    """

    preparation_goal: PreparationGoal
    ending: PreparationEnding
    explanation: str
    shortfall_k: float = math.nan
    temperature_c: float = math.nan
