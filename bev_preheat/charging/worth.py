# SPDX-License-Identifier: Apache-2.0
"""
Worth of heating before the charger: its cost, and the savings at the charger, over all targets.

    cost = price · bought energy + value of time · charging time

Energy spent on heat before arrival is bought back at the charger, so the bought energy includes it. Plans
are those of the planner, sessions those of `session`, with the heating at the charger that costs least from each
arrival (`heating_choice`). Cost over the target may have several minima, because
the map of the charging power has corners. So a grid is scanned, and refined around its lowest points.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import partial
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import arrival_state, check_stop, refuse_stranded, stop_after
from bev_preheat.charging.target_worth import Prices, TargetWorth
from bev_preheat.charging.verdict import verdict_on
from bev_preheat.errors import figure, figure_beyond, InvalidInput
from bev_preheat.planning.bracketing import least_of, Trial
from bev_preheat.planning.planner import DEFAULT_METHOD, plan_preheating, plan_unheated
from bev_preheat.planning.situation import check_situation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bev_preheat.charging.heating_choice import HeatingChoice
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

WH_PER_KWH = 1000.0
SECONDS_PER_H = 3600.0
# Targets are scanned in whole degrees, and the best is refined to this [K].
GRID_K = 1.0
TARGET_RESOLUTION_K = 0.05
# Number of the grid's lowest minima that are refined.
REFINED_MINIMA = 3
# A saving of less than this [s] is rounding.
LEAST_SAVED_S = 0.1
MOST_PRICE_PER_KWH, MOST_VALUE_PER_H = 1e3, 1e6
# Not a recommendation: the verdict states the value of time from which on heating pays.
ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H = 0.60, 10.0


@dataclass(frozen=True)
class Worth:
    """
    The worth of heating over all `targets` tried, in rising order.

    `best` costs the least, `fixed` is the result of heating to the usual target. `verdict` is for the driver.
    `break_even_value_of_time_per_h` is the least value of time for which some heating pays, or None. `best_choice`
    and `choice_without` are the HeatingChoices at the charger after the best target and without heating.
    """

    targets: tuple[TargetWorth, ...]
    best: TargetWorth
    without_heating: TargetWorth
    fixed: TargetWorth
    break_even_value_of_time_per_h: float | None
    verdict: str
    best_choice: HeatingChoice = field(compare=False)
    choice_without: HeatingChoice = field(compare=False)

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as `preheat worth --json` writes it."""
        return {'targets': [asdict(target) for target in self.targets],
                'best': asdict(self.best), 'without_heating': asdict(self.without_heating),
                'fixed_target': asdict(self.fixed),
                'break_even_value_of_time_per_h': self.break_even_value_of_time_per_h,
                'charger_heating': {'best': self.best_choice.as_dictionary(),
                                    'without_heating': self.choice_without.as_dictionary(),
                                    'sentence': self.best_choice.sentence()},
                'verdict': self.verdict}


def check_prices(prices: Prices) -> None:
    """Raise InvalidInput, one sentence per problem, if Prices are negative or not numbers."""
    problems = [f'{name}: {figure_beyond(value, 0.0, most)} is not allowed; it must be 0 ... {figure(most)} {unit}'
                for name, value, most, unit in (
                    ('energy price', prices.energy_per_kwh, MOST_PRICE_PER_KWH, 'per kWh'),
                    ('value of time', prices.time_per_h, MOST_VALUE_PER_H, 'per h'))
                if not 0.0 <= value <= most]
    if problems:
        raise InvalidInput(problems)


def find_worth(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
               charger_power_w: float, departure_soc: float, prices: Prices,
               method: str = DEFAULT_METHOD) -> Worth:
    """
    Return the Worth of heating on a route to a charger of `charger_power_w` [W].

    `state` is the battery's at the start, `goal` gives the reserve on arrival and the usual target. Charging ends
    at `departure_soc` (0 ... 1). Raises InvalidInput if an input is not allowed, the charge is not enough for the
    trip, or the battery arrives with more than `departure_soc`.
    """
    stop = stop_after(route, charger_power_w, departure_soc)
    _check(vehicle, route, state, goal, stop, prices)
    unheated = plan_unheated(vehicle, route, state, goal)
    refuse_stranded(unheated)

    def plan_to(target_c: float) -> Plan:
        return plan_preheating(vehicle, route, state, replace(
            goal, target_temperature_c=target_c), method)

    search = WorthSearch(vehicle, stop, unheated, goal.target_temperature_c, prices, plan_to)
    search.advance(math.inf)
    return search.worth()


class _Paused(Exception):
    """The search has used up its plans for now."""


class WorthSearch:
    """
    The search of `find_worth`, which may be done in parts: a number of plans now, the others later.

    `vehicle`, `stop` and `unheated` (the Plan without heating) must not change meanwhile, nor the inputs from
    which `plan_to` makes a Plan for a target [deg C]. `usual_c` is the usual target [deg C]; `without` is the
    TargetWorth without heating.
    """

    def __init__(self, vehicle: Vehicle, stop: ChargingStop, unheated: Plan, usual_c: float, prices: Prices,
                 plan_to: Callable[[float], Plan]) -> None:
        """Simulate the session without heating; raises what `session.charge` raises."""
        self._usual_c, self._prices = usual_c, prices
        self._plan_to = plan_to
        self._heating = ChargerHeating(vehicle, stop, prices)
        self._arrivals: dict[float, BatteryState] = {}
        self.without = self._worth_of(unheated, unheated.arrival_temperature_c)
        self._problem = self._heating.choose(arrival_state(unheated)).session.problem
        self._found = {self.without.target_c: self.without}
        self._plans_left = 0.0
        self._grid_c = [self.without.target_c, *targets_between(
            self.without.target_c, vehicle.battery.temperature_range_c[1])]

    def _worth_of(self, plan: Plan, target_c: float) -> TargetWorth:
        arrival = self._arrivals[target_c] = arrival_state(plan)
        choice = self._heating.choose(arrival)
        session = choice.session
        return TargetWorth(
            target_c, plan.arrival_temperature_c, plan.arrival_soc, plan.energy_wh.hvch_electric,
            session.charging_time_s, session.bought_energy_wh, choice.cost, choice.decision.value,
            choice.heated_wh)

    def choice_after(self, item: TargetWorth) -> HeatingChoice:
        """Return the HeatingChoice at the charger after an evaluated target, with the costs of all decisions."""
        return self._heating.compare(self._arrivals[max(item.target_c, self.without.target_c)])

    def look_at(self, target_c: float) -> TargetWorth:
        """Return the TargetWorth of a target [deg C], with a plan and a session for a new target."""
        if target_c <= self.without.target_c:
            return replace(self.without, target_c=target_c)
        if target_c not in self._found:
            self._found[target_c] = self._worth_of(self._plan_to(target_c), target_c)
        return self._found[target_c]

    def _at(self, target_c: float) -> TargetWorth:
        if target_c > self.without.target_c and target_c not in self._found:
            if self._plans_left < 1.0:
                raise _Paused
            self._plans_left -= 1.0
        return self.look_at(target_c)

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
        grid_c = self._grid_c
        for target_c in grid_c:
            self._at(target_c)
        for place in minima([self._at(target_c).cost for target_c in grid_c])[:REFINED_MINIMA]:
            refine(grid_c, place, lambda target_c: self._at(target_c).cost)
        self._at(self._usual_c)

        def pays_from(target_c: float) -> float:
            return pays_from_per_h(self._at(target_c), self.without, self._prices.energy_per_kwh)

        values = list(map(pays_from, grid_c))
        if 0.0 < min(values) < math.inf:
            refine(grid_c, values.index(min(values)), pays_from)

    def best(self) -> TargetWorth:
        """Return the TargetWorth with the lowest cost so far."""
        return min(self._found.values(), key=lambda item: (item.cost, item.target_c))

    def break_even_per_h(self) -> float:
        """Return the least value of time for which a target evaluated so far pays [per h], or infinity."""
        return min(pays_from_per_h(item, self.without, self._prices.energy_per_kwh)
                   for item in self._found.values())

    def verdict(self, item: TargetWorth) -> str:
        """Return the sentence for the driver on an evaluated TargetWorth."""
        return verdict_on(item, self.without, self.break_even_per_h(), self._prices, self._problem)

    def worth(self) -> Worth:
        """Return the Worth over all targets evaluated so far."""
        best, break_even = self.best(), self.break_even_per_h()
        return Worth(
            tuple(sorted(self._found.values(), key=lambda item: item.target_c)), best, self.without,
            self.look_at(self._usual_c), None if math.isinf(break_even) else break_even,
            self.verdict(best), self.choice_after(best), self.choice_after(self.without))


def _check(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, stop: ChargingStop,
           prices: Prices) -> None:
    """Raise InvalidInput with all problems that are known before the drive."""
    checks: tuple[Callable[[], None], ...] = (
        partial(check_situation, vehicle, route, state, goal), partial(check_stop, vehicle, stop),
        partial(check_prices, prices))
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


def minima(costs: Sequence[float]) -> list[int]:
    """Return the places of the local minima of a sequence, the lowest first; infinite values do not count."""
    places, before = [], math.inf
    for place, cost in enumerate(costs):
        # A plateau counts once, at its beginning.
        after = next((other for other in costs[place + 1:] if other != cost), math.inf)
        if cost < before and cost < after:
            places.append(place)
        before = cost
    return sorted(places, key=lambda place: costs[place])


def refine(grid_c: Sequence[float], place: int, cost_at: Callable[[float], float]) -> None:
    """Try targets on both sides of a grid point, to TARGET_RESOLUTION_K of the lowest cost between."""
    low_c, high_c = grid_c[max(place - 1, 0)], grid_c[min(place + 1, len(grid_c) - 1)]
    if high_c > low_c:
        least_of(low_c, high_c, lambda target_c: Trial(target_c, cost_at(target_c), None),
                 TARGET_RESOLUTION_K)


def pays_from_per_h(item: TargetWorth, without: TargetWorth, price_per_kwh: float) -> float:
    """Return the value of time [per h] from which on a target costs less than no heating, or infinity."""
    if math.isinf(item.charging_time_s):
        return math.inf
    if math.isinf(without.charging_time_s):
        return 0.0
    more = price_per_kwh * (item.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH
    saved_h = (without.charging_time_s - item.charging_time_s) / SECONDS_PER_H
    if saved_h < LEAST_SAVED_S / SECONDS_PER_H:
        return math.inf
    return max(more, 0.0) / saved_h
