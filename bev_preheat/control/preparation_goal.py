# SPDX-License-Identifier: Apache-2.0
"""What a goal of ~/prepare_battery asks for, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math
from typing import NamedTuple


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
    A battery that is warm at an instant [ns of the node's clock]; it equals itself only.

    `ready_at_ns` 0: as soon as possible. `target_c` [deg C] None: the planner's default.
    `is_plugged_in`: the vehicle stands, and the grid feeds the heater. `ambient_c` [deg C] None: that
    of the route, or the last that is known.
    """

    ready_at_ns: int = 0
    target_c: float | None = None
    is_plugged_in: bool = False
    ambient_c: float | None = None

    @property
    def is_soonest(self) -> bool:
        """Whether the battery is wanted warm as soon as possible."""
        return self.ready_at_ns == 0


class PreparationOutcome(NamedTuple):
    """
    How a Wish ended, and in one sentence why.

    `shortfall_k` is by how much the battery is below the target [K], `temperature_c` how warm it is
    [deg C]; NaN where that is unknown.
    """

    preparation_goal: PreparationGoal
    ending: PreparationEnding
    explanation: str
    shortfall_k: float = math.nan
    temperature_c: float = math.nan
