# SPDX-License-Identifier: Apache-2.0
"""
Searches the target of least cost before the charger: cost, savings and break-even prices of all targets tried.

    cost = price · bought energy + value of time · charging time + ageing

Targets below the arrival without heating are those of a car that cools.
Energy spent on heat before arrival is bought back at the charger, so the bought energy includes it. Plans
are those of the planner, sessions those of `session`, with the heating at the charger that costs least from each
arrival (`heating_choice`). Cost over the target may have several minima, because
the map of the charging power has corners. So a grid is scanned, and refined around its lowest points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import math
from typing import NamedTuple

from bev_preheat.charging.expectation import arrival_of, Expectation, spent_wh
from bev_preheat.charging.heating_choice import ChargerHeating, HeatingChoice
from bev_preheat.charging.session import Session
from bev_preheat.charging.stop import (
    CERTAIN,
    ChargingProspect,
    ChargingStop,
    check_prospect,
    check_stop,
    refuse_stranded,
    stop_after,
)
from bev_preheat.charging.target_worth import (
    check_prices,
    COOLING,
    greatest_step,
    HEATING,
    pays_from_per_h,
    pays_from_probability,
    pays_to_price_per_kwh,
    Prices,
    TargetWorth,
    TemperatureStep,
    Worth,
)
from bev_preheat.charging.verdict import (
    derating_in,
    LEAST_TIME_S,
    too_warm,
    verdict_in_doubt,
    verdict_on,
    warmer_than,
)
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import WH_PER_KWH
from bev_preheat.planning.bracketing import refine, scan
from bev_preheat.planning.maker_rules import MAKER_RULES, plan_by_rule
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import DEFAULT_METHOD, plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.route.segments import Route
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle.description import Vehicle

# Targets are scanned in whole degrees, and the best is refined to this [K].
GRID_K = 1.0
TARGET_RESOLUTION_K = 0.05


def find_worth(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
               charger_power_w: float, departure_soc: float, prices: Prices,
               method: str = DEFAULT_METHOD, prospect: ChargingProspect = CERTAIN,
               with_rules: bool = False) -> Worth:
    """
    Return the Worth of heating on a route to a charger of `charger_power_w` [W].

    `state` is the battery's at the start, `goal` gives the reserve on arrival and the usual target. Charging
    ends at `departure_soc` (0 ... 1). With an uncertain `prospect` all costs are expected ones (`expectation`).
    `with_rules`: and the worth of `maker_rules`. Raises InvalidInput if an input is not allowed, the charge is not
    enough for the trip, or the battery arrives with more than `departure_soc`.
    """
    stop = stop_after(route, charger_power_w, departure_soc)
    _check(vehicle, route, state, goal, stop, prices, prospect)
    unheated = least_cooled(vehicle, route, state, goal)

    def plan_to(target_c: float) -> Plan:
        return plan_preheating(vehicle, route, state, replace(goal_of(
            goal, target_c, unheated.arrival_temperature_c),
            heats_until_arrival=prospect.heats_until_arrival), method)

    search = WorthSearch(
        vehicle, stop, unheated, goal.target_temperature_c, prices, plan_to, None if prospect.is_certain else
        Expectation(vehicle, route, state, stop, prospect, prices, unheated))
    search.advance(math.inf)
    return replace(search.worth(), by_rule={
        name: search.worth_of(plan_by_rule(name, vehicle, route, state, goal))
        for name in (MAKER_RULES if with_rules else ())})


def goal_of(goal: Goal, target_c: float, unheated_c: float) -> Goal:
    """
    Return the Goal with a target [deg C]: at least, or below the arrival without heating at most.

    A highest temperature that the Goal has stays.
    """
    if math.isfinite(goal.maximum_arrival_temperature_c):
        return replace(goal, target_temperature_c=target_c)
    if target_c < unheated_c:
        return replace(goal, target_temperature_c=min(goal.target_temperature_c, target_c),
                       maximum_arrival_temperature_c=target_c)
    return replace(goal, target_temperature_c=target_c)


def least_cooled(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal) -> Plan:
    """Return the Plan without heating, cooled only as far as the battery needs; raise InvalidInput if stranded."""
    unheated, highest_c = plan_unheated(vehicle, route, state, goal), vehicle.battery.temperature_range_c[1]
    refuse_stranded(unheated)
    if vehicle.cools and unheated.arrival_temperature_c > highest_c:
        return plan_preheating(vehicle, route, state, replace(goal, maximum_arrival_temperature_c=highest_c))
    return unheated


class _Paused(Exception):
    """The search has used up its plans for now."""


class Evaluated(NamedTuple):
    """A TargetWorth, and the BatteryState on arrival behind it."""

    worth: TargetWorth
    arrival: BatteryState


class WorthSearch:
    """
    The search of `find_worth`, which may be done in parts: a number of plans now, the others later.

    `vehicle`, `stop` and `unheated` (the Plan without heating) must not change meanwhile, nor the inputs from
    which `plan_to` makes a Plan for a target [deg C]. `usual_c` is the usual target [deg C]; `without` is the
    TargetWorth without heating. If the car cools, `plan_to` also takes targets below that arrival.
    """

    def __init__(self, vehicle: Vehicle, stop: ChargingStop, unheated: Plan, usual_c: float, prices: Prices,
                 plan_to: Callable[[float], Plan], expectation: Expectation | None = None,
                 found: Sequence[Evaluated] = ()) -> None:
        """
        Simulate the session without heating; raises what `session.charge` raises.

        An `expectation` makes all costs expected ones. `found` are the targets Evaluated by the same search
        so far, the one without heating first: it goes on from there.
        """
        self._expectation = expectation
        self._vehicle, self._stop, self._usual_c, self._prices = vehicle, stop, usual_c, prices
        self._plan_to = plan_to
        self._heating = ChargerHeating(vehicle, stop, prices)
        self._arrivals: dict[float, BatteryState] = {item.target_c: arrival for item, arrival in found}
        # In any case, because the policy at the charger is found from the first arrival.
        self.without = self._worth_of(unheated, unheated.arrival_temperature_c)
        if found:
            self.without = found[0].worth
        self._problem = self._heating.choose(arrival_of(vehicle, unheated)).session.problem
        self._found = {item.target_c: item for item, _ in found} or {self.without.target_c: self.without}
        self._plans_left = 0.0
        self._grid_c = [self.without.target_c, *targets_between(
            self.without.target_c, vehicle.battery.temperature_range_c[1])]

    @property
    def found(self) -> tuple[Evaluated, ...]:
        """The targets Evaluated so far, the one without heating first."""
        return tuple(Evaluated(item, self._arrivals[target_c]) for target_c, item in self._found.items())

    def _session(self, target_c: float) -> Session:
        """Return the Session after an evaluated target [deg C]."""
        return self._heating.choose(self._arrivals[target_c]).session

    def _worth_of(self, plan: Plan, target_c: float) -> TargetWorth:
        self._arrivals[target_c] = arrival_of(self._vehicle, plan)
        return replace(self.worth_of(plan), target_c=target_c)

    def worth_of(self, plan: Plan) -> TargetWorth:
        """Return the TargetWorth of a Plan of the same drive, which is no target of the search."""
        choice = self._heating.choose(arrival_of(self._vehicle, plan))
        session = choice.session
        item = TargetWorth(
            plan.target_temperature_c, plan.arrival_temperature_c, plan.arrival_soc, plan.energy_wh.hvch_electric,
            session.charging_time_s, session.bought_energy_wh, choice.cost, choice.decision.value,
            choice.heated_wh, ageing_cost=session.ageing_cost,
            ageing_outside_share=0.0 if session.ageing is None else session.ageing.outside_share)
        return item if self._expectation is None else self._expectation.of(item, plan)

    def choice_after(self, item: TargetWorth) -> HeatingChoice:
        """Return the HeatingChoice at the charger after an evaluated target, with the costs of all decisions."""
        return self._heating.compare(self._arrivals.get(item.target_c, self._arrivals[self.without.target_c]))

    def look_at(self, target_c: float, cools: bool = False) -> TargetWorth:
        """Return the TargetWorth of heating, or also of cooling, to a target [deg C]; a new one is planned."""
        if target_c <= self.without.target_c and not (cools and self._vehicle.cools):
            return replace(self.without, target_c=target_c)
        if target_c not in self._found:
            self._found[target_c] = self._worth_of(self._plan_to(target_c), target_c)
        return self._found[target_c]

    def _at(self, target_c: float) -> TargetWorth:
        """Return the TargetWorth of `look_at`; a new one counts, and pauses the search after the last plan."""
        if target_c not in self._found:
            if self._plans_left < 1.0:
                raise _Paused
            self._plans_left -= 1.0
        return self.look_at(target_c, cools=True)

    def _colder(self) -> list[float]:
        """Return the whole degrees below the arrival without heating that cooling reaches [deg C], rising."""
        colder: list[float] = []
        target_c = math.ceil(self.without.target_c) - GRID_K
        while self._vehicle.cools and self._at(target_c).arrival_temperature_c < target_c + SHORTFALL_TOLERANCE_K:
            colder.insert(0, target_c)
            target_c -= GRID_K
        return colder

    def advance(self, plans: float) -> bool:
        """Continue the search by at most this many plans; return whether it is finished."""
        self._plans_left = plans
        try:
            self._search()
        except _Paused:
            return False
        return True

    def _search(self) -> None:
        """Evaluate all targets that the search needs; known targets take no time."""
        grid_c = [*self._colder(), *self._grid_c]
        scan(grid_c, lambda target_c: self._at(target_c).cost, TARGET_RESOLUTION_K)
        self._at(max(self._usual_c, self.without.target_c))

        def pays_from(target_c: float) -> float:
            return self._pays_from_per_h(self._at(target_c))

        values = list(map(pays_from, grid_c))
        if 0.0 < min(values) < math.inf:
            refine(grid_c, values.index(min(values)), pays_from, TARGET_RESOLUTION_K)

    def revise(self, probability: float) -> None:
        """Count with another probability of charging (0 ... 1), without any plan or session."""
        if self._expectation is not None:
            self._expectation.revise(probability)
            self._found = {target_c: self._expectation.revised(item)
                           for target_c, item in self._found.items()}
            self.without = self._found[self.without.target_c]

    def best(self) -> TargetWorth:
        """Return the TargetWorth with the lowest cost so far."""
        return min(self._found.values(), key=lambda item: (item.cost, abs(item.target_c - self.without.target_c)))

    @property
    def way(self) -> str:
        """COOLING if the target that pays from the least value of time on, or the best one, is cooled for."""
        cooled = [item for item in self._found.values()
                  if item.arrival_temperature_c < self.without.arrival_temperature_c - SHORTFALL_TOLERANCE_K]
        best, pays_from = self.best(), self.break_even_per_h()
        if best is not self.without:
            return COOLING if best in cooled else HEATING
        return COOLING if any(self._pays_from_per_h(item) <= pays_from for item in cooled) else HEATING

    def break_even_per_h(self) -> float:
        """Return the least value of time for which a target evaluated so far pays [per h], or infinity."""
        return min(map(self._pays_from_per_h, self._found.values()))

    def _pays_from_per_h(self, item: TargetWorth) -> float:
        if self._expectation is None:
            return pays_from_per_h(item, self.without, self._prices.energy_per_kwh)
        return self._expectation.pays_from_per_h(item, self.without)

    def takes(self, prospect: ChargingProspect) -> bool:
        """Return whether `revise` is enough for another ChargingProspect."""
        return self._expectation is not None and prospect == replace(
            self._expectation.prospect, probability=prospect.probability)

    def pays_from_probability(self, target_c: float | None = None) -> float:
        """Return the least probability of charging for which a target, or any so far, pays; above 1: none."""
        items = (self._found.values() if target_c is None else [self.look_at(target_c)])
        return min((pays_from_probability(item, self.without) for item in items), default=math.inf)

    def pays_from_chance(self) -> float:
        """Return `pays_from_probability`, also if the vehicle charges for certain."""
        if self._expectation is not None:
            return self.pays_from_probability()
        without = replace(self.without, charged_cost=self.without.cost, not_charged_cost=0.0)
        return min(pays_from_probability(replace(
            item, charged_cost=item.cost, not_charged_cost=self._prices.cost(self._lost_wh(item), 0.0)), without)
            for item in self._found.values())

    def pays_to_price_per_kwh(self) -> float:
        """Return the price of energy [per kWh] up to which an evaluated target pays, or infinity; 0: none."""
        prospect = CERTAIN if self._expectation is None else self._expectation.prospect
        # A vehicle that waits for the charger charges in any case.
        per_charge = 0.0 if prospect.wait_s is not None else 1.0 / prospect.probability - 1.0
        return max(pays_to_price_per_kwh(
            item, self.without, self._prices.time_per_h, per_charge * self._lost_wh(item) if per_charge else 0.0)
            for item in self._found.values())

    def _lost_wh(self, item: TargetWorth) -> float:
        """Return the heat of a target that is lost if the vehicle does not charge, as battery energy [Wh]."""
        price_per_kwh = self._prices.energy_per_kwh
        if self._expectation is not None and price_per_kwh > 0.0:
            return WH_PER_KWH * (item.not_charged_cost - self.without.not_charged_cost) / price_per_kwh
        return spent_wh(self._vehicle, item.arrival_soc, item.arrival_temperature_c,
                        self.without.arrival_soc - item.arrival_soc)

    @property
    def step(self) -> TemperatureStep | None:
        """The `greatest_step` of the targets evaluated so far."""
        return greatest_step(self._found.values(), self.without)

    def step_in_words(self) -> str:
        """Return the sentence on the `step`; '' for none."""
        return '' if self.step is None else self.step.in_words()

    def best_if_charged(self) -> TargetWorth:
        """Return the TargetWorth with the lowest cost so far if the vehicle charges for certain."""
        return min(self._found.values(), key=lambda item: (item.charged_cost, item.target_c))

    def verdict(self, item: TargetWorth) -> str:
        """Return the sentence for the driver on an evaluated TargetWorth, also on a battery that gets too warm."""
        sentence = self._why_unheated() or verdict_on(
            item, self.without, self.break_even_per_h(), self._prices, self._problem, self.way)
        if self._expectation is not None:
            sentence = verdict_in_doubt(
                sentence, self._expectation.prospect, self.pays_from_probability(), self.way)
        warm = self._too_warm(item)
        return f'{sentence} {warm}' if warm else sentence

    def _why_unheated(self) -> str:
        """Return the sentence on why no target is heated for although the battery can be charged; '' if one is."""
        warmer = [target_c for target_c in self._found if target_c > self.without.target_c]
        if not warmer or math.isinf(self.without.charging_time_s) or any(
                item.hvch_electric_wh != self.without.hvch_electric_wh for item in self._found.values()):
            return ''
        plan = self._plan_to(self._usual_c if self._usual_c in warmer else max(warmer))
        return f'No heating before arrival: {plan.explanation}'

    def _too_warm(self, item: TargetWorth) -> str:
        """Return the sentence on heat that lowers the charging power, '' without any."""
        if item is self.without:
            found = too_warm(self._vehicle, self._stop, self._session(item.target_c))
            if found is not None and found.slower_s > 0.0:
                return found.sentence
        able = [each for each in self._found.values() if math.isfinite(each.charging_time_s)]
        if not able:
            return ''
        fastest = min(able, key=lambda each: each.charging_time_s)
        hottest = max(self._found.values(), key=lambda each: each.arrival_temperature_c)
        slower_s = hottest.charging_time_s - fastest.charging_time_s
        derating = derating_in(self._vehicle, self._stop, self._session(hottest.target_c))
        if derating is None or slower_s < LEAST_TIME_S:
            return ''
        return warmer_than(fastest, hottest, slower_s, derating)

    def worth(self) -> Worth:
        """Return the Worth over all targets evaluated so far."""
        best, break_even = self.best(), self.break_even_per_h()
        return Worth(
            tuple(sorted(self._found.values(), key=lambda item: item.target_c)), best, self.without,
            self.look_at(self._usual_c), None if math.isinf(break_even) else break_even,
            self.verdict(best), self.choice_after(best), self.choice_after(self.without),
            None if self._expectation is None else self.pays_from_probability(),
            self.pays_from_chance(), self.pays_to_price_per_kwh(), way=self.way, step=self.step)


def _check(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, stop: ChargingStop,
           prices: Prices, prospect: ChargingProspect) -> None:
    """Raise InvalidInput with all problems that are known before the drive."""
    checks: tuple[Callable[[], None], ...] = (
        partial(check_situation, vehicle, route, state, goal), partial(check_stop, vehicle, stop),
        partial(check_prices, prices), partial(check_prospect, prospect))
    problems = []
    for check in checks:
        try:
            check()
        except InvalidInput as error:
            problems += error.problems
    if problems:
        raise InvalidInput(problems)


def targets_between(low_c: float, high_c: float) -> list[float]:
    """Return the whole degrees above one temperature [deg C] up to another, and the latter."""
    first = math.floor(low_c / GRID_K) + 1
    last = math.ceil(high_c / GRID_K) - 1
    grid_c = [GRID_K * number for number in range(first, last + 1)]
    return [*grid_c, high_c] if high_c > low_c else []
