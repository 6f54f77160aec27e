# SPDX-License-Identifier: Apache-2.0
"""Supervision results: the decision that holds until the next input, and the heater's command."""

from dataclasses import dataclass
import math
from typing import NamedTuple

from bev_preheat.control.inputs import Leg
from bev_preheat.control.target_choice import TargetChoice
from bev_preheat.estimation.forecast import Forecast
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.status import Status


class Command(NamedTuple):
    """Electrical power for the battery [W], until when it may be used [ns], and why."""

    battery_heating_power_w: float
    valid_until_ns: int
    reason: Status


@dataclass(frozen=True)
class Decision:
    """
    Status and sentence that hold until the next input, and the plan behind them, if any.

    `sentence` None is the plan's own. `plan_start_ns` is the instant of the plan's time 0, `leg` the leg
    that it plans. `later_legs` lie beyond the current or next stop. `forecast` says how sure the
    temperature on arrival is; None: that is unknown. The command follows `commanded` where that is not
    None, else the plan; the heater delivers `command_share` of the command. `model_factors` are the
    factors of the corrected vehicle (PreheatPlan.msg); (): none. `target` says where the plan's target
    comes from; None: it has none. `charger_heat_w` [W] is commanded while the vehicle charges, where
    there is no plan.
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
        """Return `explanation` and `arrival_deviation_k`; raises what working them out raises."""
        return self.explanation, self.arrival_deviation_k

    @property
    def arrival_deviation_k(self) -> float:
        """Standard deviation of the temperature on arrival [K]; NaN where it is unknown."""
        return math.nan if self.forecast is None else self.forecast.deviation_k


# Before anything has arrived, and until a valid route plan has.
WITHOUT_ROUTE = Decision(Status.NO_ROUTE, 'No valid route plan has arrived yet.')
