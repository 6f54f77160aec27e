# SPDX-License-Identifier: Apache-2.0
"""The decision: a status, the plan behind it, and the command."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.target import TargetChoice
from bev_preheat.estimation.forecast import Forecast
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.status import Status
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Leg


class Command(NamedTuple):
    """
    Electrical power of the HVCH for the battery [W], the end of its lease [ns], and its reason.

    `sources_w` has name and electrical power [W] of other heat sources that heat, under the same lease.
    """

    battery_heating_power_w: float
    valid_until_ns: int
    reason: Status
    sources_w: tuple[tuple[str, float], ...] = ()

    def power_w(self, name: str) -> float:
        """Return the electrical power [W] of the heat source of a name."""
        return self.battery_heating_power_w if name == HVCH else dict(self.sources_w).get(name, 0.0)

    @property
    def total_w(self) -> float:
        """The electrical power of all heat sources [W]."""
        return self.battery_heating_power_w + sum(power_w for _, power_w in self.sources_w)


@dataclass(frozen=True)
class Decision:
    """
    Status and sentence that hold until the next input, and the plan behind them, if any.

    `sentence` None is the plan's own. `plan_start_ns` is the instant of the plan's time 0, `leg` the leg
    that it plans. `later_legs` lie beyond the current or next stop. `forecast` has the uncertainty of the
    arrival temperature; None: unknown. The command follows `commanded` unless that is None, else the plan; the
    heater delivers `command_share` of the command. `model_factors` are the factors of the corrected vehicle
    (PreheatPlan.msg); (): not corrected. `target` is the choice of the plan's target; None: no choice.
    `charger_heat_w` [W] is commanded while the vehicle charges and has no plan.
    """

    status: Status
    sentence: str | None
    plan: Plan | None = None
    plan_start_ns: int = 0
    leg: Leg | None = None
    later_legs: tuple[Leg, ...] = ()
    forecast: Forecast | None = None
    commanded: Plan | None = None
    command_share: float = 1.0
    model_factors: tuple[float, ...] = ()
    target: TargetChoice | None = None
    charger_heat_w: float = 0.0

    @property
    def explanation(self) -> str:
        """The sentence."""
        if self.sentence is not None:
            return self.sentence
        return '' if self.plan is None else self.plan.explanation

    def read(self) -> tuple[str, float]:
        """Return `explanation` and `arrival_deviation_k`; raises any exception of computing them."""
        return self.explanation, self.arrival_deviation_k

    @property
    def arrival_deviation_k(self) -> float:
        """Standard deviation of the temperature on arrival [K]; NaN if unknown."""
        return math.nan if self.forecast is None else self.forecast.deviation_k


# Until the first valid route plan arrives.
WITHOUT_ROUTE = Decision(Status.NO_ROUTE, 'No valid route plan has arrived yet.')
