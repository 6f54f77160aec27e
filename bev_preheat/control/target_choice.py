# SPDX-License-Identifier: Apache-2.0
"""
Chooses the target of the current leg if its charger is known and no target is given.

It chooses the cheapest target by `charging.worth_search`, for the corrected vehicle and the estimated state. A new
leg gets a target at once, after a first look at every fifth degree. The full search follows in the next
updates, with one plan each, so that no update takes long. It is repeated in the same way when the route plan, the
probability of charging or the heater has changed, and every SEARCH_PERIOD_S. A target is replaced only
if another is cheaper by LEAST_GAIN_SHARE, so that jitter does not change it, and moves by MOST_MOVE_K in one
search, so that an estimate that is still settling does not swing it. A new route plan to the same charger keeps
the target in the same way.

If it is uncertain whether the vehicle charges, or when it arrives, the cost is an expected one. Another
probability needs no plan: the targets found so far are weighed again at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
import math
from typing import Any
from weakref import WeakKeyDictionary

from bev_preheat.charging.expectation import Expectation
from bev_preheat.charging.stop import (
    CERTAIN,
    Charger,
    ChargingProspect,
    ChargingStop,
    held_prospect,
    stop_after,
    USUAL_DEPARTURE_SOC,
)
from bev_preheat.charging.target_worth import TargetWorth
from bev_preheat.charging.worth_search import Evaluated, goal_of, least_cooled, targets_between, WorthSearch
from bev_preheat.control.inputs import Leg
from bev_preheat.control.settings import Settings
from bev_preheat.control.target import (
    ChargingDoubt,
    given_target,
    given_target_pays_from,
    TargetChoice,
    TargetSource,
    unchosen,
    with_figures,
)
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.tunables import (
    FIRST_LOOK_K,
    LEAST_GAIN_SHARE,
    LEAST_PERIOD_S,
    MOST_MOVE_K,
    SAME_ARRIVAL_S,
    SEARCH_PERIOD_S,
    USUAL_PAYS_FROM,
)
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Vehicle

NO_CHARGER = "the route plan does not say the charger's power"


@dataclass(frozen=True, eq=False)
class TargetSearchInput:
    """
    Input of a target search: vehicle, battery state and route ahead on a leg, estimated at an instant [ns].

    `route_id` and `legs_after` identify the leg. `vehicle` and `route` are corrected by the estimated
    factors. `heater_share` is the share of its power that the heater delivers. `goal` has the usual target.
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
    heater_share: float = 1.0

    @property
    def given(self) -> str:
        """The source of a given target, as a sentence; '' if no target is given."""
        return given_target(self.leg, self.settings)

    @property
    def heats_until_arrival(self) -> bool:
        """Whether plans for a chosen target heat until arrival; a given target holds on arrival."""
        is_chosen = not self.given and self.leg.charger is not None and not _obstacle(self)
        return is_chosen and self.leg.prospect.heats_until_arrival

    def plan_to(self, target_c: float, unheated_c: float = -math.inf) -> Plan:
        """Return the Plan for a target [deg C], which is cooled for below an arrival without heating."""
        return plan_preheating(
            self.vehicle, self.route, self.state, replace(
                goal_of(self.goal, target_c, unheated_c), heats_until_arrival=self.heats_until_arrival),
            self.settings.method, heater_share=self.heater_share)


@dataclass(frozen=True, eq=False)
class TargetSearch:
    """
    A search for the cheapest target, as far as it has come; a value.

    It is made of its input, its ChargingStop, the Plan without heating, the prospect that it counts with, and
    the targets Evaluated so far.
    """

    begun: TargetSearchInput
    stop: ChargingStop
    unheated: Plan
    prospect: ChargingProspect
    found: tuple[Evaluated, ...] = ()

    def worker(self) -> WorthSearch:
        """Return the WorthSearch that goes on from here; raises what `session.charge` raises."""
        worker = _WORKERS.pop(self, None)
        if worker is not None:
            return worker
        begun, prices = self.begun, self.begun.settings.prices
        return WorthSearch(
            begun.vehicle, self.stop, self.unheated, begun.goal.target_temperature_c, prices,
            partial(begun.plan_to, unheated_c=self.unheated.arrival_temperature_c),
            None if self.prospect.is_certain else Expectation(
                begun.vehicle, begun.route, begun.state, self.stop, self.prospect, prices, self.unheated,
                begun.heater_share), self.found)

    def after(self, worker: WorthSearch) -> TargetSearch:
        """Return the search with the targets that its worker has Evaluated."""
        search = replace(self, found=worker.found)
        _WORKERS[search] = worker
        return search

    def revised(self, probability: float) -> TargetSearch:
        """Return the search that counts with another probability of charging (0 ... 1), without any plan."""
        worker = self.worker()
        worker.revise(probability)
        return replace(self, prospect=replace(self.prospect, probability=probability)).after(worker)


# The worker that has just brought a search so far: the next part of the search needs no other one.
_WORKERS: WeakKeyDictionary[TargetSearch, WorthSearch] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class TargetChooser:
    """
    Chooses the target of one leg after another; a value.

    `key` identifies the leg and its requests, `choice` is its TargetChoice. `search` is the TargetSearch
    under way, `searched` the input of the latest one, `weighed` the search behind the choice, finished or not;
    `held` is the prospect that it counts with. `is_searched`: a whole search has been completed for this leg; the
    first look at it is coarse. `is_outdated`: the search is to be repeated.
    """

    is_outdated: bool = False
    key: tuple[Any, ...] = ()
    choice: TargetChoice | None = None
    search: TargetSearch | None = None
    searched: TargetSearchInput | None = None
    weighed: TargetSearch | None = None
    held: ChargingProspect = CERTAIN
    is_searched: bool = False

    def for_new_mission(self) -> TargetChooser:
        """Return the chooser that searches again for the same leg of another route plan."""
        return replace(self, is_outdated=True)

    def without_charger(self, leg: Leg, settings: Settings) -> tuple[TargetChooser, TargetChoice]:
        """Return the TargetChoice of a leg whose charger is unknown, and that charges for certain."""
        return TargetChooser(self.is_outdated), unchosen(leg, settings, NO_CHARGER)

    def choose(self, now: TargetSearchInput) -> tuple[TargetChooser, TargetChoice]:
        """Return the TargetChoice for a TargetSearchInput, and the chooser, whose search goes on if it is due."""
        charger = now.leg.charger
        obstacle = _obstacle(now)
        if charger is None or obstacle:
            return self._without_session(now, obstacle or NO_CHARGER)
        key = (now.route_id, now.legs_after, charger, now.leg.target_temperature_c, now.goal,
               now.settings.prices, now.settings.method)
        chooser = self
        if key != self.key:
            # Another route plan to the same destination: the target moves from the present one, as in an update.
            is_same = key[1:] == self.key[1:] and self.searched is not None and not now.given and (
                abs(now.leg.arrival_ns - self.searched.leg.arrival_ns) <= SAME_ARRIVAL_S * NS_PER_S)
            before = self.choice if is_same else None
            chooser = TargetChooser(self.is_outdated, key, before, is_searched=before is not None)
        held = held_prospect(chooser.held, now.leg.prospect.seen_from(now.route.total_duration_s))
        is_revised, chooser = held is not chooser.held, replace(chooser, held=held)
        try:
            if is_revised and chooser.choice is not None:
                chooser = chooser._revised(now)
            chooser = chooser._gone_on(now, charger)
        except (InvalidInput, PlanningFailure, ArithmeticError) as error:
            chooser = replace(chooser, search=None, weighed=None, choice=unchosen(
                now.leg, now.settings, f'no target can be chosen: {error}'))
        assert chooser.choice is not None
        return chooser, chooser.choice

    def _without_session(self, now: TargetSearchInput, why: str) -> tuple[TargetChooser, TargetChoice]:
        """Return the TargetChoice of a leg whose session is unknown, for the reason `why`."""
        key, prospect = (now.route_id, now.legs_after, now.goal, why), now.leg.prospect
        chooser = self if key == self.key else TargetChooser(self.is_outdated, key)
        held, choice = held_prospect(chooser.held, prospect.seen_from(now.route.total_duration_s)), chooser.choice
        if prospect.probability == 1.0:
            choice = unchosen(now.leg, now.settings, why)
        elif choice is None or held is not chooser.held or chooser._is_due(now):
            chooser = replace(chooser, is_outdated=False, searched=now, held=held)
            pays_from = given_target_pays_from(
                now.vehicle, now.route, now.state, now.goal, held, now.settings.prices, now.plan_to)
            choice = replace(
                unchosen(now.leg, now.settings, why),
                heating_pays=chooser._goes_on() or held.probability >= pays_from,
                doubt=ChargingDoubt(held.probability, pays_from, chooser._starts_by_ns(
                    now, now.goal.target_temperature_c)))
        return replace(chooser, held=held, choice=choice), choice

    def _revised(self, now: TargetSearchInput) -> TargetChooser:
        """Count with another prospect from now on, at once if only the probability differs."""
        held, weighed = self.held, self.weighed
        chooser = replace(self, is_outdated=True)
        if weighed is None or not weighed.worker().takes(held):
            # As for a new leg, but the target found so far is still preferred.
            return replace(chooser, search=None, searched=None)
        search = self.search
        revised = weighed.revised(held.probability)
        if search is not None:
            search = revised if search is weighed else search.revised(held.probability)
        return replace(chooser, search=search)._weighing(revised, revised.worker(), now)

    def _gone_on(self, now: TargetSearchInput, charger: Charger) -> TargetChooser:
        if self.search is None:
            return self._begun(now, charger) if self._is_due(now) else self
        worker = self.search.worker()
        is_finished = worker.advance(1)
        search = self.search.after(worker)
        if not is_finished:
            # The search behind the choice is this one until it is finished.
            return replace(self, search=search, weighed=search if self.weighed is self.search else self.weighed)
        return replace(replace(self, search=None)._weighing(search, worker, now), is_searched=True)

    def _begun(self, now: TargetSearchInput, charger: Charger) -> TargetChooser:
        """Begin a search; if nothing is left to charge, set the choice without one."""
        is_first = self.searched is None
        chooser = replace(self, is_outdated=False, searched=now)
        unheated = least_cooled(now.vehicle, now.route, now.state, now.goal)
        wanted_soc = charger.departure_soc
        departure_soc = USUAL_DEPARTURE_SOC if wanted_soc is None else wanted_soc
        if unheated.arrival_soc >= departure_soc:
            return replace(chooser, weighed=None, choice=chooser._nothing_to_charge(
                now, unheated.arrival_soc, wanted_soc))
        search = TargetSearch(now, stop_after(now.route, charger.power_w, departure_soc), unheated, self.held)
        worker = search.worker()
        if now.given:
            return chooser._weighing(search, worker, now)
        if not is_first:
            return replace(chooser, search=search.after(worker))
        least_c = worker.without.target_c
        for target_c in targets_between(least_c, max(now.goal.target_temperature_c, least_c) + FIRST_LOOK_K):
            if target_c % FIRST_LOOK_K == 0.0:
                worker.look_at(target_c)
        chooser = chooser._weighing(search, worker, now)
        return replace(chooser, search=chooser.weighed)

    def _is_due(self, now: TargetSearchInput) -> bool:
        before = self.searched
        if before is None:
            return True
        elapsed_s = abs(now.stamp_ns - before.stamp_ns) / NS_PER_S
        return elapsed_s >= SEARCH_PERIOD_S or (
            elapsed_s >= LEAST_PERIOD_S and (self.is_outdated or now.heater_share != before.heater_share))

    def _weighing(self, search: TargetSearch, worker: WorthSearch, now: TargetSearchInput) -> TargetChooser:
        """Return the chooser with the TargetChoice by the targets that a search's worker has found so far."""
        probability, given_c = self.held.probability, now.goal.target_temperature_c
        if now.given:
            chooser, choice = self, with_figures(
                TargetChoice(TargetSource.GIVEN, now.given), worker.look_at(
                    given_c, math.isfinite(now.goal.maximum_arrival_temperature_c)), worker.without)
        else:
            chooser, choice = self.best_of(worker, now)
        if probability < 1.0:
            target_c, pays_from = (given_c, worker.pays_from_probability(given_c)) if now.given else (
                worker.best_if_charged().target_c, worker.pays_from_probability())
            choice = replace(choice, doubt=ChargingDoubt(
                probability, pays_from, self._starts_by_ns(now, target_c)))
            if now.given:
                choice = replace(choice, heating_pays=self._goes_on() or probability >= pays_from)
        return replace(chooser, weighed=search.after(worker), choice=choice)

    def _nothing_to_charge(self, now: TargetSearchInput, arrival_soc: float,
                           wanted_soc: float | None) -> TargetChoice:
        """Return the TargetChoice without a session; in doubt it is heated for from the usual probability on."""
        arrives = f'the battery arrives with {100.0 * arrival_soc:.1f} %, and'
        if wanted_soc is None:
            choice = unchosen(now.leg, now.settings, f'{arrives} the state of charge for departure is unknown')
        else:
            choice = TargetChoice(TargetSource.GIVEN, now.given) if now.given else TargetChoice(
                TargetSource.CHOSEN, f'Not worth it: {arrives} departure with {100.0 * wanted_soc:.1f} % needs no '
                'charging.', heating_pays=False)
            choice = replace(choice, charging_time_s=0.0, unheated_charging_time_s=0.0, bought_energy_wh=0.0,
                             unheated_bought_energy_wh=0.0)
        probability = self.held.probability
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
        before = self.choice
        return (before is not None and before.doubt is not None and before.heating_pays
                and before.doubt.probability == self.held.probability)

    def best_of(self, search: WorthSearch, now: TargetSearchInput) -> tuple[TargetChooser, TargetChoice]:
        """
        Return the choice from a search's best target: heat to it if that gains enough, otherwise none.

        With it, the chooser, which searches again if the best target is further away.
        """
        best, without, before = search.best(), search.without, self.choice
        if math.isinf(best.cost):
            return self, with_figures(unchosen(now.leg, now.settings, search.verdict(best)), without, without)
        kept, kept_c, chooser = without, None, self
        if before is not None and before.heating_pays and before.target_c is not None:
            kept_c = before.target_c
            kept = search.look_at(kept_c, before.cools)
        if best.cost < (1.0 - LEAST_GAIN_SHARE) * kept.cost:
            if kept_c is None or best is without or not self.is_searched or (
                    abs(best.target_c - kept_c) <= MOST_MOVE_K):
                kept, kept_c = best, None if best is without else best.target_c
            else:
                step_c = kept_c + math.copysign(MOST_MOVE_K, best.target_c - kept_c)
                step = search.look_at(step_c, best.target_c < without.target_c)
                if step.cost < kept.cost:
                    kept, kept_c, chooser = step, step_c, replace(self, is_outdated=True)
        reason = f'{_reason(search, kept, best)} {search.step_in_words()}'.rstrip()
        return chooser, with_figures(TargetChoice(
            TargetSource.CHOSEN, reason, kept_c, kept_c is not None,
            heats_until_arrival=now.heats_until_arrival,
            cools=kept.arrival_temperature_c < without.arrival_temperature_c), kept, without)


def _obstacle(now: TargetSearchInput) -> str:
    """Return why no target can be chosen; '' if one can."""
    try:
        charging_of(now.vehicle)
    except InvalidInput as error:
        return str(error)
    return ''


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
        return (f'Not worth it: {search.way} the battery to {best.arrival_temperature_c:.1f} degC before '
                f'arrival would save less than {share} of the cost. Some {search.way} pays as soon as an hour is '
                f'worth {search.break_even_per_h():.2f} to you.')
    return f'The earlier target stays: no other is cheaper by {share}.'
