# SPDX-License-Identifier: Apache-2.0
"""
Chooses the target of the current leg if its charger is known and no target is given.

It chooses the cheapest target by `charging.worth`, for the corrected vehicle and the estimated state. A new
leg gets a target at once, after a first look at every fifth degree. The full search follows in the next
updates, with PLANS_EACH_UPDATE plans each, so that no update takes long. It is repeated in the same way when
the estimate, the route or the time of arrival has changed, and every SEARCH_PERIOD_S. A target is replaced only
if another is cheaper by LEAST_GAIN_SHARE, so that jitter does not change it, and moves by MOST_MOVE_K in one
search, so that an estimate that is still settling does not swing it. A new route plan to the same charger keeps
the target in the same way.

If it is uncertain whether the vehicle charges, or when it arrives, the cost is an expected one. Another
probability needs no plan: the targets found so far are weighed again at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.charging.expectation import Expectation
from bev_preheat.charging.prospect import HeldProspect
from bev_preheat.charging.stop import refuse_stranded, stop_after, USUAL_DEPARTURE_SOC
from bev_preheat.charging.worth import targets_between, WorthSearch
from bev_preheat.control.charging_doubt import ChargingDoubt, given_target_pays_from, USUAL_PAYS_FROM
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.estimation.prior import prior_factor_covariance
from bev_preheat.numerics.factors import NS_PER_S
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
# A repeated search moves the target by this much at most [K], and is repeated while the best target is further
# away. A search takes a minute or two; the heater of the reference vehicle warms the battery by less than this in
# that time, so the battery misses nothing. In the first minutes of a trip the sensor lags behind the cells and the
# estimated factors settle: the best target moves by several kelvin to and fro, while the cost around it is flat.
MOST_MOVE_K = 2.0
# Another route plan leads to the same destination if charger and prices are the same, and the arrivals are no
# further apart than this [s].
SAME_ARRIVAL_S = 1800.0
# The search is repeated after SEARCH_PERIOD_S [s]. After LEAST_PERIOD_S [s] it is repeated as soon as a factor has
# moved by FACTOR_CHANGE of its standard deviation, or the arrival by ARRIVAL_CHANGE_S [s].
SEARCH_PERIOD_S, LEAST_PERIOD_S = 600.0, 60.0
FACTOR_CHANGE = 0.25
ARRIVAL_CHANGE_S = 60.0

NO_CHARGER = "the route plan does not say the charger's power"

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
    the session never ends. `doubt` is None if the vehicle charges for certain. `heats_until_arrival` is
    that of the Goal.
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

    def goal(self, goal: Goal) -> Goal:
        """Return the Goal with this target."""
        if self.heating_pays and self.target_c is None:
            return goal
        target_c = goal.target_temperature_c if self.target_c is None else self.target_c
        return replace(goal, target_temperature_c=target_c, heating_pays=self.heating_pays,
                       heats_until_arrival=self.heats_until_arrival)


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

    @property
    def remaining_s(self) -> float:
        """Time until the arrival [s]."""
        return self.route.total_duration_s

    @property
    def heats_until_arrival(self) -> bool:
        """Whether plans for a chosen target heat until arrival; a given target holds on arrival."""
        is_chosen = not self.given and self.leg.charger is not None and not _obstacle(self)
        return is_chosen and self.leg.prospect.heats_until_arrival

    def plan_to(self, target_c: float) -> Plan:
        """Return the Plan for a target [deg C]."""
        return plan_preheating(
            self.vehicle, self.route, self.state, replace(
                self.goal, target_temperature_c=target_c, heats_until_arrival=self.heats_until_arrival),
            self.settings.method, heater_share=self.heater_share)


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
        # The search behind the choice, finished or not, and the prospect that it counts with.
        self._weighed: WorthSearch | None = None
        self._held = HeldProspect()
        # Whether a whole search has been completed for this leg; the first look at it is coarse.
        self._is_searched = False

    def follow_new_mission(self) -> None:
        """Search again for the same leg of another route plan."""
        self._is_outdated = True

    def without_charger(self, leg: Leg, settings: Settings) -> TargetChoice:
        """Return the TargetChoice of a leg whose charger is unknown, and that charges for certain."""
        self._forget()
        return _unchosen(leg, settings, NO_CHARGER)

    def choose(self, now: TargetSearchInput) -> TargetChoice:
        """Return the TargetChoice for a TargetSearchInput; start or continue a search if one is due."""
        charger = now.leg.charger
        obstacle = _obstacle(now)
        if charger is None or obstacle:
            return self._without_session(now, obstacle or NO_CHARGER)
        key = (now.route_id, now.legs_after, charger, now.leg.target_temperature_c, now.goal,
               now.settings.prices, now.settings.method)
        if key != self._key:
            # Another route plan to the same destination: the target moves from the present one, as in an update.
            before = self._choice if key[1:] == self._key[1:] and self._is_same_arrival(now) else None
            self._forget()
            self._key, self._choice, self._is_searched = key, before, before is not None
        is_revised = self._held.follow(now.leg.prospect.seen_from(now.remaining_s))
        try:
            if is_revised and self._choice is not None:
                self._revise(now)
            self._go_on(now, charger)
        except (InvalidInput, PlanningFailure, ArithmeticError) as error:
            self._search = self._weighed = None
            self._choice = _unchosen(now.leg, now.settings, f'no target can be chosen: {error}')
        assert self._choice is not None
        return self._choice

    def _without_session(self, now: TargetSearchInput, why: str) -> TargetChoice:
        """Return the TargetChoice of a leg whose session is unknown, for the reason `why`."""
        key, prospect = (now.route_id, now.legs_after, now.goal, why), now.leg.prospect
        if key != self._key:
            self._forget()
            self._key = key
        is_revised = self._held.follow(prospect.seen_from(now.remaining_s))
        if prospect.probability == 1.0:
            self._choice = _unchosen(now.leg, now.settings, why)
        elif self._choice is None or is_revised or self._is_due(now):
            self._is_outdated, self._searched = False, now
            held = self._held.prospect
            pays_from = given_target_pays_from(
                now.vehicle, now.route, now.state, now.goal, held, now.settings.prices, now.plan_to)
            self._choice = replace(
                _unchosen(now.leg, now.settings, why),
                heating_pays=self._goes_on() or held.probability >= pays_from,
                doubt=ChargingDoubt(held.probability, pays_from, self._starts_by_ns(
                    now, now.goal.target_temperature_c)))
        return self._choice

    def _revise(self, now: TargetSearchInput) -> None:
        """Count with another prospect from now on, at once if only the probability differs."""
        held, weighed = self._held.prospect, self._weighed
        self._is_outdated = True
        if weighed is not None and weighed.takes(held):
            for search in (weighed, self._search):
                if search is not None:
                    search.revise(held.probability)
            self._choice = self._weigh(weighed, now)
        else:
            # As for a new leg, but the target found so far is still preferred.
            self._search = self._searched = None

    def _go_on(self, now: TargetSearchInput, charger: Charger) -> None:
        if self._search is None:
            if not self._is_due(now):
                return
            is_first = self._searched is None
            self._is_outdated, self._searched = False, now
            self._begin(now, charger)
            if self._search is None:
                return
            if now.given:
                self._choice = self._weigh(self._search, now)
                self._search = None
                return
            if not is_first:
                return
            for target_c in _first_look_c(self._search, now.goal):
                self._search.look_at(target_c)
            self._choice = self._weigh(self._search, now)
            return
        if self._search.advance(PLANS_EACH_UPDATE):
            self._choice, self._search = self._weigh(self._search, now), None
            self._is_searched = True

    def _is_same_arrival(self, now: TargetSearchInput) -> bool:
        before = self._searched
        return before is not None and not now.given and (
            abs(now.leg.arrival_ns - before.leg.arrival_ns) <= SAME_ARRIVAL_S * NS_PER_S)

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
            self._weighed = None
            self._choice = self._by_usual_share(now, _nothing_to_charge(now, unheated.arrival_soc, wanted_soc))
            return

        stop, prospect = stop_after(now.route, charger.power_w, departure_soc), self._held.prospect
        self._search = WorthSearch(
            now.vehicle, stop, unheated, now.goal.target_temperature_c, now.settings.prices, now.plan_to,
            None if prospect.is_certain else Expectation(
                now.vehicle, now.route, now.state, stop, prospect, now.settings.prices, unheated,
                now.heater_share))

    def _weigh(self, search: WorthSearch, now: TargetSearchInput) -> TargetChoice:
        """Return the TargetChoice by the targets that a search has found so far."""
        self._weighed = search
        choice = self._given_one(search, now) if now.given else self.best_of(search, now)
        probability = self._held.prospect.probability
        if probability == 1.0:
            return choice
        if now.given:
            target_c = now.goal.target_temperature_c
            pays_from = search.pays_from_probability(target_c)
            choice = replace(choice, heating_pays=self._goes_on() or probability >= pays_from)
        else:
            target_c, pays_from = search.best_if_charged().target_c, search.pays_from_probability()
        return replace(choice, doubt=ChargingDoubt(
            probability, pays_from, self._starts_by_ns(now, target_c)))

    def _by_usual_share(self, now: TargetSearchInput, choice: TargetChoice) -> TargetChoice:
        """Return a TargetChoice without a session; in doubt it is heated for from the usual probability on."""
        probability = self._held.prospect.probability
        if probability == 1.0 or not choice.heating_pays:
            return choice
        return replace(choice, heating_pays=probability >= USUAL_PAYS_FROM, doubt=ChargingDoubt(
            probability, USUAL_PAYS_FROM, self._starts_by_ns(now, now.goal.target_temperature_c)))

    @staticmethod
    def _starts_by_ns(now: TargetSearchInput, target_c: float) -> int | None:
        """Return the instant at which heating to a target starts [ns]; None without heating."""
        start_s = now.plan_to(target_c).heating_start_s
        return None if start_s is None else now.stamp_ns + round(start_s * NS_PER_S)

    def _goes_on(self) -> bool:
        """Return whether heating to a given target is decided for the present probability: it then stays so."""
        before = self._choice
        return (before is not None and before.doubt is not None and before.heating_pays
                and before.doubt.probability == self._held.prospect.probability)

    @staticmethod
    def _given_one(search: WorthSearch, now: TargetSearchInput) -> TargetChoice:
        return _with_figures(
            TargetChoice(TargetSource.GIVEN, now.given), search.look_at(now.goal.target_temperature_c),
            search.without)

    def best_of(self, search: WorthSearch, now: TargetSearchInput) -> TargetChoice:
        """Return the choice from a search's best target: heat to it if that gains enough, otherwise none."""
        best, without, before = search.best(), search.without, self._choice
        if math.isinf(best.cost):
            return _with_figures(_unchosen(now.leg, now.settings, search.verdict(best)), without, without)
        kept, kept_c = without, None
        if before is not None and before.heating_pays and before.target_c is not None:
            kept_c = before.target_c
            kept = search.look_at(kept_c)
        if best.cost < (1.0 - LEAST_GAIN_SHARE) * kept.cost:
            if kept_c is None or best is without or not self._is_searched or (
                    abs(best.target_c - kept_c) <= MOST_MOVE_K):
                kept, kept_c = best, None if best is without else best.target_c
            else:
                step_c = kept_c + math.copysign(MOST_MOVE_K, best.target_c - kept_c)
                step = search.look_at(step_c)
                if step.cost < kept.cost:
                    kept, kept_c, self._is_outdated = step, step_c, True
        return _with_figures(TargetChoice(
            TargetSource.CHOSEN, _reason(search, kept, best), kept_c, kept_c is not None,
            heats_until_arrival=now.heats_until_arrival), kept, without)


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
    if best.cost < (1.0 - LEAST_GAIN_SHARE) * chosen.cost:
        return (f'{search.verdict(chosen)} {best.target_c:.1f} degC is cheaper: the target moves there, by at '
                f'most {MOST_MOVE_K:g} K in one search.')
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
