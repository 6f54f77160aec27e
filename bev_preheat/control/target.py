# SPDX-License-Identifier: Apache-2.0
"""
The target of a leg as a value, with its source and reason, also of a vehicle that may not charge.

A chosen target is the cheapest by expected cost (`charging.expectation`). A given target, or the vehicle's
default, is kept or not heated to at all: it is heated to from the probability on from which that costs less
than no heating. Once it is, the decision stays until the probability changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from enum import IntEnum
import math
from typing import NamedTuple

from bev_preheat.charging.expectation import Expectation
from bev_preheat.charging.stop import (
    chance_text,
    CHARGER_RANGE_W,
    ChargingProspect,
    stop_after,
    USUAL_DEPARTURE_SOC,
)
from bev_preheat.charging.target_worth import pays_from_probability, Prices, TargetWorth
from bev_preheat.charging.worth_search import goal_of, WorthSearch
from bev_preheat.control.inputs import Leg
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import Route
from bev_preheat.tunables import USUAL_PAYS_FROM
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Vehicle


class ChargingDoubt(NamedTuple):
    """
    The `probability` of charging that a plan counts with, above 0 ... 1.

    `pays_from` is the least probability for which some heating pays, above 1: none. `starts_by_ns` is the
    instant at which heating starts if charging becomes certain [ns]; None: no heating even then.
    """

    probability: float
    pays_from: float
    starts_by_ns: int | None = None

    def told(self, plan: Plan, now_ns: int) -> tuple[Status, str]:
        """Return status and sentence of a Plan at an instant [ns]: the heater waits unless heating never pays."""
        if plan.status is not Status.NOT_WORTH_IT or self.starts_by_ns is None or self.pays_from > 1.0:
            return plan.status, (
                f'{plan.explanation} Planned for {chance_text(self.probability)} chance of charging.')
        # The local time of day, as 14:32.
        start = 'at once' if self.starts_by_ns <= now_ns else (
            f'by {datetime.fromtimestamp(self.starts_by_ns // NS_PER_S):%H:%M}')
        enough = f' to {chance_text(self.pays_from)}' if self.pays_from > self.probability else ''
        return Status.WAITING, (
            f'Heating waits: {chance_text(self.probability)} chance of charging; it starts {start} if that '
            f'rises{enough}. {plan.explanation}')


def given_target_pays_from(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                           prospect: ChargingProspect, prices: Prices,
                           plan_to: Callable[[float], Plan]) -> float:
    """
    Return the least probability of charging from which on heating to the target of a Goal pays; above 1: never.

    `plan_to` returns the Plan for a target [deg C]. The charger is unknown: it gives all that the inlet takes, to
    the usual departure. USUAL_PAYS_FROM if the session is unknown: the vehicle file does not describe it, or the
    battery arrives with enough charge.
    """
    try:
        charger_power_w = min(charging_of(vehicle).maximum_inlet_power_w, CHARGER_RANGE_W[1])
        unheated = plan_unheated(vehicle, route, state, goal)
        stop = stop_after(route, charger_power_w, USUAL_DEPARTURE_SOC)
        if unheated.arrival_soc >= stop.departure_soc:
            return USUAL_PAYS_FROM
        search = WorthSearch(vehicle, stop, unheated, goal.target_temperature_c, prices, plan_to, Expectation(
            vehicle, route, state, stop, prospect, prices, unheated))
    except InvalidInput:
        return USUAL_PAYS_FROM
    target = search.look_at(goal.target_temperature_c)
    if math.isclose(target.charged_cost, search.without.charged_cost, rel_tol=1e-12):
        # It arrives that warm anyway.
        return 0.0
    return pays_from_probability(target, search.without)


class TargetSource(IntEnum):
    """Source of the target; the numbers are those of PreheatPlan's constants TARGET_...."""

    UNKNOWN = 0
    GIVEN = 1
    DEFAULT = 2
    CHOSEN = 3


@dataclass(frozen=True)
class TargetChoice:
    """
    The target of a leg [deg C], its source and the reason as a sentence.

    `target_c` is None if the goal's own target holds. Charging times [s] and bought energies [Wh] are those
    with the target and without any further heating, from the latest search; NaN if unknown, infinite if
    the session never ends. `doubt` is None if the vehicle charges for certain. `heats_until_arrival` is
    that of the Goal. `cools`: the target is the highest temperature on arrival.
    """

    source: TargetSource
    reason: str
    target_c: float | None = None
    heating_pays: bool = True
    charging_time_s: float = math.nan
    unheated_charging_time_s: float = math.nan
    bought_energy_wh: float = math.nan
    unheated_bought_energy_wh: float = math.nan
    doubt: ChargingDoubt | None = None
    heats_until_arrival: bool = False
    cools: bool = False

    def goal(self, goal: Goal) -> Goal:
        """Return the Goal with this target."""
        if self.heating_pays and self.target_c is None:
            return goal
        target_c = goal.target_temperature_c if self.target_c is None else self.target_c
        return replace(goal_of(goal, target_c, math.inf if self.cools else -math.inf),
                       heating_pays=self.heating_pays, heats_until_arrival=self.heats_until_arrival)


def given_target(leg: Leg, settings: Settings) -> str:
    """Return the source of a given target, as a sentence; '' if no target is given."""
    if leg.target_temperature_c is not None:
        return 'The target is given by the route plan.'
    if settings.target_battery_temperature_c is not None:
        return 'The target is given by the parameter target_battery_temperature.'
    if math.isfinite(leg.maximum_arrival_temperature_c):
        return 'The highest temperature on arrival is given by the route plan; no target is chosen.'
    return ''


def unchosen(leg: Leg, settings: Settings, why: str) -> TargetChoice:
    """Return the TargetChoice if no target is chosen: the given target, or the default for the reason `why`."""
    given = given_target(leg, settings)
    if given:
        return TargetChoice(TargetSource.GIVEN, given)
    return TargetChoice(TargetSource.DEFAULT, f"The target is the vehicle's default: {why.rstrip('.')}.")


def with_figures(choice: TargetChoice, heated: TargetWorth, without: TargetWorth) -> TargetChoice:
    """Return a TargetChoice with the figures of its session, and of that without any further heating."""
    return replace(choice, charging_time_s=heated.charging_time_s,
                   unheated_charging_time_s=without.charging_time_s,
                   bought_energy_wh=heated.bought_energy_wh,
                   unheated_bought_energy_wh=without.bought_energy_wh)
