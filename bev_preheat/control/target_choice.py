# SPDX-License-Identifier: Apache-2.0
"""
Chooses the target of the current leg if its charger is known and no target is given.

It chooses the cheapest target by `charging.worth`, for the corrected vehicle and the estimated state. A new
leg gets a target at once, after a first look at every fifth degree. The full search follows in the next
updates, with PLANS_EACH_UPDATE plans each, so that no update takes long. It is repeated in the same way when
the estimate, the route or the time of arrival has changed, and every SEARCH_PERIOD_S. A target is replaced only
if another is cheaper by LEAST_GAIN_SHARE, so that jitter does not change it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.charging.stop import refuse_stranded, stop_after, USUAL_DEPARTURE_SOC
from bev_preheat.charging.worth import targets_between, WorthSearch
from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.estimation.prior import prior_factor_covariance
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.vehicle.charging import charging_of

if TYPE_CHECKING:
    from bev_preheat.charging.stop import Charger
    from bev_preheat.charging.target_worth import TargetWorth
    from bev_preheat.control.inputs import Leg
    from bev_preheat.control.settings import Settings
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

# The first look at a new leg: spacing of its targets, and how far it goes above the usual target [K].
FIRST_LOOK_K = 5.0
PLANS_EACH_UPDATE = 1
# A target is replaced if another is cheaper by more than this share of the cost.
LEAST_GAIN_SHARE = 5e-4
# The search is repeated after SEARCH_PERIOD_S [s]. After LEAST_PERIOD_S [s] it is repeated as soon as a factor has
# moved by FACTOR_CHANGE of its standard deviation, or the arrival by ARRIVAL_CHANGE_S [s].
SEARCH_PERIOD_S, LEAST_PERIOD_S = 600.0, 60.0
FACTOR_CHANGE = 0.25
ARRIVAL_CHANGE_S = 60.0

_FACTOR_DEVIATIONS = np.sqrt(np.diag(prior_factor_covariance()))


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
    the session never ends.
    """

    source: TargetSource
    reason: str
    target_c: float | None = None
    heating_pays: bool = True
    charging_time_s: float = math.nan
    unheated_charging_time_s: float = math.nan
    bought_energy_wh: float = math.nan
    unheated_bought_energy_wh: float = math.nan

    def goal(self, goal: Goal) -> Goal:
        """Return the Goal with this target."""
        if self.heating_pays and self.target_c is None:
            return goal
        target_c = goal.target_temperature_c if self.target_c is None else self.target_c
        return replace(goal, target_temperature_c=target_c, heating_pays=self.heating_pays)


@dataclass(frozen=True, eq=False)
class TargetSearchInput:
    """
    Input of a target search: vehicle, battery state and route ahead on a leg, estimated at an instant [ns].

    `route_id` and `legs_after` identify the leg. `vehicle` and `route` are corrected by the estimated
    factors; `log_factors` (5,) are their logarithms, None without estimation. `heater_share` is the share of
    its power that the heater delivers. `goal` has the usual target.
    """

    route_id: str
    legs_after: int
    leg: Leg
    settings: Settings
    goal: Goal
    vehicle: Vehicle
    route: Route
    state: BatteryState
    stamp_ns: int
    log_factors: Any = None
    heater_share: float = 1.0

    @property
    def given(self) -> str:
        """The source of a given target, as a sentence; '' if no target is given."""
        return _given(self.leg, self.settings)


class TargetChooser:
    """Chooses the target of one leg after another."""

    def __init__(self) -> None:
        """Start without a choice."""
        self._is_outdated = False
        self._forget()

    def _forget(self) -> None:
        self._key: tuple[Any, ...] = ()
        self._choice: TargetChoice | None = None
        self._search: WorthSearch | None = None
        self._searched: TargetSearchInput | None = None

    def follow_new_mission(self) -> None:
        """Search again for the same leg of another route plan."""
        self._is_outdated = True

    def without_charger(self, leg: Leg, settings: Settings) -> TargetChoice:
        """Return the TargetChoice of a leg whose charger is unknown."""
        self._forget()
        return _unchosen(leg, settings, "the route plan does not say the charger's power")

    def choose(self, now: TargetSearchInput) -> TargetChoice:
        """Return the TargetChoice for a TargetSearchInput; start or continue a search if one is due."""
        charger = now.leg.charger
        if charger is None:
            return self.without_charger(now.leg, now.settings)
        obstacle = _obstacle(now)
        if obstacle:
            self._forget()
            return _unchosen(now.leg, now.settings, obstacle)
        key = (now.route_id, now.legs_after, charger, now.leg.target_temperature_c, now.goal,
               now.settings.prices, now.settings.method)
        if key != self._key:
            self._forget()
            self._key = key
        try:
            self._go_on(now, charger)
        except (InvalidInput, PlanningFailure, ArithmeticError) as error:
            self._search = None
            self._choice = _unchosen(now.leg, now.settings, f'no target can be chosen: {error}')
        assert self._choice is not None
        return self._choice

    def _go_on(self, now: TargetSearchInput, charger: Charger) -> None:
        is_first = self._choice is None
        if self._search is None:
            if not self._is_due(now):
                return
            self._is_outdated, self._searched = False, now
            self._begin(now, charger)
            if self._search is None:
                return
            if now.given:
                self._keep_given(now, self._search)
                return
            if not is_first:
                return
            for target_c in _first_look_c(self._search, now.goal):
                self._search.look_at(target_c)
            self._choice = self._best_of(self._search, now)
            return
        if self._search.advance(PLANS_EACH_UPDATE):
            self._choice, self._search = self._best_of(self._search, now), None

    def _is_due(self, now: TargetSearchInput) -> bool:
        before = self._searched
        if before is None:
            return True
        elapsed_s = abs(now.stamp_ns - before.stamp_ns) / NS_PER_S
        if elapsed_s < LEAST_PERIOD_S:
            return False
        has_learned = (now.log_factors is None) is not (before.log_factors is None) or (
            now.log_factors is not None and bool((np.abs(
                now.log_factors - before.log_factors) > FACTOR_CHANGE * _FACTOR_DEVIATIONS).any()))
        later_s = abs(now.leg.arrival_ns - before.leg.arrival_ns) / NS_PER_S
        return (self._is_outdated or elapsed_s >= SEARCH_PERIOD_S or has_learned
                or later_s > ARRIVAL_CHANGE_S or now.heater_share != before.heater_share)

    def _begin(self, now: TargetSearchInput, charger: Charger) -> None:
        """Begin a search; if nothing is left to charge, set the choice without one."""
        unheated = plan_unheated(now.vehicle, now.route, now.state, now.goal)
        refuse_stranded(unheated)
        wanted_soc = charger.departure_soc
        departure_soc = USUAL_DEPARTURE_SOC if wanted_soc is None else wanted_soc
        if unheated.arrival_soc >= departure_soc:
            self._choice = _nothing_to_charge(now, unheated.arrival_soc, wanted_soc)
            return

        def plan_to(target_c: float) -> Plan:
            return plan_preheating(
                now.vehicle, now.route, now.state, replace(now.goal, target_temperature_c=target_c),
                now.settings.method, heater_share=now.heater_share)

        self._search = WorthSearch(
            now.vehicle, stop_after(now.route, charger.power_w, departure_soc), unheated,
            now.goal.target_temperature_c, now.settings.prices, plan_to)

    def _keep_given(self, now: TargetSearchInput, search: WorthSearch) -> None:
        self._choice = _with_figures(
            TargetChoice(TargetSource.GIVEN, now.given), search.look_at(now.goal.target_temperature_c),
            search.without)
        self._search = None

    def _best_of(self, search: WorthSearch, now: TargetSearchInput) -> TargetChoice:
        best, without, before = search.best(), search.without, self._choice
        if math.isinf(best.cost):
            return _with_figures(_unchosen(now.leg, now.settings, search.verdict(best)), without, without)
        kept, kept_c = without, None
        if before is not None and before.heating_pays and before.target_c is not None:
            kept_c = before.target_c
            kept = search.look_at(kept_c)
        if best.cost < (1.0 - LEAST_GAIN_SHARE) * kept.cost:
            kept, kept_c = best, None if best is without else best.target_c
        return _with_figures(TargetChoice(
            TargetSource.CHOSEN, _reason(search, kept, best), kept_c, kept_c is not None), kept, without)


def _obstacle(now: TargetSearchInput) -> str:
    """Return why no target can be chosen; '' if one can."""
    try:
        charging_of(now.vehicle)
    except InvalidInput as error:
        return str(error)
    return ''


def _given(leg: Leg, settings: Settings) -> str:
    """Return the source of a given target, as a sentence; '' if no target is given."""
    if leg.target_temperature_c is not None:
        return 'The target is given by the route plan.'
    if settings.target_temperature_c is not None:
        return 'The target is given by the parameter target_battery_temperature.'
    return ''


def _unchosen(leg: Leg, settings: Settings, why: str) -> TargetChoice:
    """Return the TargetChoice if no target is chosen: the given target, or the default for the reason `why`."""
    given = _given(leg, settings)
    if given:
        return TargetChoice(TargetSource.GIVEN, given)
    return TargetChoice(TargetSource.DEFAULT, f"The target is the vehicle's default: {why.rstrip('.')}.")


def _nothing_to_charge(now: TargetSearchInput, arrival_soc: float, wanted_soc: float | None) -> TargetChoice:
    if wanted_soc is None:
        return _unchosen(now.leg, now.settings, f'the battery arrives with {100.0 * arrival_soc:.1f} %, and '
                         'the state of charge for departure is unknown')
    choice = TargetChoice(TargetSource.GIVEN, now.given) if now.given else TargetChoice(
        TargetSource.CHOSEN, f'Not worth it: the battery arrives with {100.0 * arrival_soc:.1f} %, and departure '
        f'with {100.0 * wanted_soc:.1f} % needs no charging.', heating_pays=False)
    return replace(choice, charging_time_s=0.0, unheated_charging_time_s=0.0, bought_energy_wh=0.0,
                   unheated_bought_energy_wh=0.0)


def _first_look_c(search: WorthSearch, goal: Goal) -> list[float]:
    """Return the targets [deg C] of the first look."""
    low_c = search.without.target_c
    return [target_c for target_c in targets_between(
        low_c, max(goal.target_temperature_c, low_c) + FIRST_LOOK_K) if target_c % FIRST_LOOK_K == 0.0]


def _reason(search: WorthSearch, chosen: TargetWorth, best: TargetWorth) -> str:
    """Return the sentence on a choice."""
    share = f'{100.0 * LEAST_GAIN_SHARE:g} %'
    if chosen is best:
        return search.verdict(best)
    if chosen.cost < (1.0 - LEAST_GAIN_SHARE) * search.without.cost:
        return f'{search.verdict(chosen)} No other target is cheaper by {share}.'
    if chosen is search.without:
        return (f'Not worth it: heating the battery to {best.arrival_temperature_c:.1f} degC before '
                f'arrival would save less than {share} of the cost. Some heating pays as soon as an hour is '
                f'worth {search.break_even_per_h():.2f} to you.')
    return f'The earlier target stays: no other is cheaper by {share}.'


def _with_figures(choice: TargetChoice, heated: TargetWorth, without: TargetWorth) -> TargetChoice:
    return replace(choice, charging_time_s=heated.charging_time_s,
                   unheated_charging_time_s=without.charging_time_s,
                   bought_energy_wh=heated.bought_energy_wh,
                   unheated_bought_energy_wh=without.bought_energy_wh)
