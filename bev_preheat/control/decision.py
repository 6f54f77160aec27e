# SPDX-License-Identifier: Apache-2.0
"""The decision: a status, the plan behind it, and the command; and the obstacle, which keeps the heater off."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from bev_preheat.control.inputs import goal_of_leg, Leg, Measurement, Mission
from bev_preheat.control.regime import RegimeReport, UNKNOWN_REGIME
from bev_preheat.control.settings import defaults_of, Settings
from bev_preheat.control.target import TargetChoice
from bev_preheat.control.timetable import Timetable
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.forecast import Forecast
from bev_preheat.estimation.hypotheses import SuspectedFault
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.situation import Goal
from bev_preheat.planning.status import Status
from bev_preheat.vehicle.description import Defaults, HVCH, Vehicle
from bev_preheat.vehicle.variants import with_sources_at


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
    arrival temperature; None: unknown. The command follows `commanded`, because a heater that does not respond is
    still commanded, or else the plan. The heater delivers `command_share` of the command; 0: other sources heat,
    and it is only asked on. `model_factors` are those of the corrected vehicle (PreheatPlan.msg); () if it is not
    corrected, or the heater does not obey, which they do not cover. `vehicle` is that of the plan. `target` is the
    choice of the plan's target; None: no choice.
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
    vehicle: Vehicle | None = None
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


class Unserved(NamedTuple):
    """
    A heat source beside the HVCH that does not heat or cool as commanded, and the sentence on it.

    It delivers a `share` of its command, 0: nothing; `is_refused`: it says so itself.
    """

    name: str
    sentence: str
    is_refused: bool
    share: float = 0.0


class Moment(NamedTuple):
    """
    All that a decision and its command go by at an instant [ns]: valid inputs, refusals, and the car as known.

    `rivals` are other nodes that command the same heater. `without_route` is the Decision as long as there is no
    route. `timetable` is the route's; planning uses `active_timetable`, which is that of the preparation goal, or
    the route's without a goal. `measurement` has only the signals that hold; `doubt` is the sentence on a missing
    signal without which the heater stays off. `heater_refusal` is the sentence on heat that the heater refuses,
    `inactive` that on a managed node that may not heat; '' for none. By its own answer the heater executes
    `heater_share` of its command. `unserved` are the heat sources beside the
    HVCH without which plans are made. `suspected` are the faults of heat sources not reported yet, by name.
    `estimate` is the latest one, None without estimation, and `temperature_c` the battery's [deg C], estimated or
    measured, None: unknown. `direction`: 1 if the vehicle heats now, -1 if it cools; it has heated the battery
    for `heated_s` [s] on this trip.
    """

    now_ns: int
    vehicle: Vehicle
    settings: Settings
    is_enabled: bool
    rivals: str
    refusal: str | None
    without_route: Decision
    timetable: Timetable | None
    active_timetable: Timetable | None
    measurement: Measurement | None
    doubt: str | None = None
    heater_refusal: str = ''
    heater_share: float = 1.0
    inactive: str = ''
    unserved: tuple[Unserved, ...] = ()
    suspected: tuple[tuple[str, SuspectedFault], ...] = ()
    regime: RegimeReport = UNKNOWN_REGIME
    estimate: Estimate | None = None
    temperature_c: float | None = None
    direction: int = 0
    heated_s: float = 0.0

    @property
    def heating_vehicle(self) -> Vehicle:
        """The vehicle with the sources as far as they serve."""
        return with_sources_at(self.vehicle, tuple((each.name, each.share) for each in self.unserved))

    @property
    def mission(self) -> Mission | None:
        """The current Mission of the route; None without a route."""
        return None if self.timetable is None else self.timetable.mission

    @property
    def defaults(self) -> Defaults:
        """The Defaults of vehicle and settings."""
        return defaults_of(self.vehicle, self.settings)

    def goal_of(self, leg: Leg) -> Goal:
        """Return the Goal of a leg; settings and vehicle complete it."""
        return goal_of_leg(leg, self.vehicle, self.settings)


def find_obstacle(moment: Moment) -> Decision | None:
    """Return a Decision that keeps the heater off; None if nothing forbids heating."""
    if moment.inactive:
        return Decision(Status.DISABLED, moment.inactive)
    if not moment.is_enabled:
        return Decision(Status.DISABLED, 'Preheating is switched off through ~/enable.')
    if moment.rivals:
        return Decision(Status.COMMAND_CONFLICT, 'Heat is also commanded by '
                        f'{moment.rivals}; the heater is off until only one is left.')
    if moment.refusal is not None:
        return Decision(Status.INVALID_INPUT, moment.refusal)
    if moment.active_timetable is None:
        return moment.without_route
    if moment.measurement is None:
        return Decision(Status.NO_BATTERY_STATE, 'No valid battery state has arrived yet.')
    age_s = (moment.now_ns - moment.measurement.stamp_ns) / NS_PER_S
    timeout_s, tolerance_s = moment.settings.battery_state_timeout_s, moment.settings.clock_tolerance_s
    if moment.now_ns >= moment.measurement.expires_ns(timeout_s):
        also = '' if moment.doubt is None else f' {moment.doubt}'
        return Decision(Status.STALE_INPUT, f'battery_state is {age_s:.3f} s old; less than '
                        f'{timeout_s:g} s are allowed.{also}')
    if age_s < -tolerance_s:
        return Decision(Status.STALE_INPUT, f'battery_state is stamped {-age_s:.3f} s ahead '
                        f'of the clock; at most {tolerance_s:g} s are allowed.')
    if moment.doubt is not None:
        return Decision(Status.INVALID_INPUT, moment.doubt)
    return None
