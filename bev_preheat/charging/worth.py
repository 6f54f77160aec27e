# SPDX-License-Identifier: Apache-2.0
"""
Is it worth it: what heating before the charger costs, and what it saves there, over all targets.

    cost = price · bought energy + value of time · charging time

Energy that is spent on heat before arrival is bought back at the charger, so the bought energy has all
of it. Plans are those of the planner, sessions those of `session`. Cost over the target may have several
minima: the map of the charging power has corners. So a grid is scanned, and refined where it is low.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import arrival_state, check_stop, refuse_stranded, stop_after
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.bracketing import least_of, Trial
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import DEFAULT_METHOD, plan_preheating, plan_unheated
from bev_preheat.planning.situation import check_situation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bev_preheat.charging.session import Session
    from bev_preheat.charging.stop import Stop
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

WH_PER_KWH = 1000.0
SECONDS_PER_H = 3600.0
# Targets are scanned in whole degrees, and the best is found to this [K].
GRID_K = 1.0
TARGET_RESOLUTION_K = 0.05
# So many of the lowest minima of the grid are looked at closely.
REFINED_MINIMA = 3
# Less time saved than this [s] is rounding.
LEAST_SAVED_S = 0.1
# Costs that differ by less, in whatever currency, are the same to a driver.
LEAST_GAIN = 0.01
MOST_PRICE_PER_KWH, MOST_VALUE_PER_H = 1e3, 1e6


@dataclass(frozen=True)
class Prices:
    """Price of energy [per kWh] and value of the driver's time [per h], in one currency."""

    energy_per_kwh: float
    time_per_h: float

    def cost(self, energy_wh: float, time_s: float) -> float:
        """Return price times energy [Wh] plus value of time times time [s]; infinite where one is."""
        if math.isinf(energy_wh) or math.isinf(time_s):
            return math.inf
        return (self.energy_per_kwh * energy_wh / WH_PER_KWH
                + self.time_per_h * time_s / SECONDS_PER_H)


@dataclass(frozen=True)
class TargetWorth:
    """
    One target [deg C] and what comes of it; the fields are those of the JSON.

    `hvch_electric_wh` is what the heater takes before arrival [Wh]. Charging time [s], bought energy
    [Wh] and cost are infinite where the session never ends. The target of a drive without heating
    is the temperature that its battery arrives with, the highest that needs no heating.
    """

    target_c: float
    arrival_temperature_c: float
    arrival_soc: float
    hvch_electric_wh: float
    charging_time_s: float
    bought_energy_wh: float
    cost: float


@dataclass(frozen=True)
class Worth:
    """
    What heating is worth over all targets that were tried, `targets`, by rising target.

    `best` costs least, `fixed` is what heating to the usual target comes to. `verdict` is for the driver.
    `break_even_value_of_time_per_h` is the least value of time for which some heating pays, None
    where none does.
    """

    targets: tuple[TargetWorth, ...]
    best: TargetWorth
    without_heating: TargetWorth
    fixed: TargetWorth
    break_even_value_of_time_per_h: float | None
    verdict: str

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as `preheat worth --json` writes it."""
        return {'targets': [asdict(target) for target in self.targets],
                'best': asdict(self.best), 'without_heating': asdict(self.without_heating),
                'fixed_target': asdict(self.fixed),
                'break_even_value_of_time_per_h': self.break_even_value_of_time_per_h,
                'verdict': self.verdict}


def check_prices(prices: Prices) -> None:
    """Raise InvalidInput, one sentence a problem, where Prices are negative or no numbers."""
    problems = [f'{name}: {value:g} is not allowed; it must be 0 ... {most:g} {unit}'
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

    `state` is the battery's at the start, `goal` says what must be left on arrival and which target is
    usual. Charging ends at `departure_soc` (0 ... 1). Raises InvalidInput where something is not
    allowed, the charge does not carry the trip, or there is more in the battery than is asked for.
    """
    stop = stop_after(route, charger_power_w, departure_soc)
    _check(vehicle, route, state, goal, stop, prices)
    unheated = plan_unheated(vehicle, route, state, goal)
    refuse_stranded(unheated)
    sessions: dict[BatteryState, Session] = {}

    def worth_of(plan: Plan, target_c: float) -> TargetWorth:
        arrival = arrival_state(plan)
        if arrival not in sessions:
            sessions[arrival] = charge(vehicle, stop, arrival)
        session = sessions[arrival]
        return TargetWorth(
            target_c, plan.arrival_temperature_c, plan.arrival_soc, plan.energy_wh.hvch_electric,
            session.charging_time_s, session.bought_energy_wh,
            prices.cost(session.bought_energy_wh, session.charging_time_s))

    without = worth_of(unheated, unheated.arrival_temperature_c)
    found = {without.target_c: without}

    def at(target_c: float) -> TargetWorth:
        if target_c <= without.target_c:
            return replace(without, target_c=target_c)
        if target_c not in found:
            plan = plan_preheating(vehicle, route, state, replace(
                goal, target_temperature_c=target_c), method)
            found[target_c] = worth_of(plan, target_c)
        return found[target_c]

    highest_c = vehicle.battery.temperature_range_c[1]
    grid_c = [without.target_c, *targets_between(without.target_c, highest_c)]
    for target_c in grid_c:
        at(target_c)
    for place in minima([at(target_c).cost for target_c in grid_c])[:REFINED_MINIMA]:
        refine(grid_c, place, lambda target_c: at(target_c).cost)
    fixed = at(goal.target_temperature_c)

    def pays_from(target_c: float) -> float:
        return pays_from_per_h(at(target_c), without, prices.energy_per_kwh)

    values = list(map(pays_from, grid_c))
    if 0.0 < min(values) < math.inf:
        refine(grid_c, values.index(min(values)), pays_from)
    break_even = min(map(pays_from, list(found)))
    best = min(found.values(), key=lambda item: (item.cost, item.target_c))
    return Worth(
        tuple(sorted(found.values(), key=lambda item: item.target_c)), best, without, fixed,
        None if math.isinf(break_even) else break_even,
        verdict_on(best, without, break_even, prices, sessions[arrival_state(unheated)].problem))


def _check(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, stop: Stop,
           prices: Prices) -> None:
    """Raise InvalidInput with all that is not allowed before the drive."""
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
    """Return the whole degrees above one temperature [deg C] up to another, and that one."""
    first = math.floor(low_c / GRID_K) + 1
    last = math.ceil(high_c / GRID_K) - 1
    grid_c = [GRID_K * number for number in range(first, last + 1)]
    return [*grid_c, high_c] if high_c > low_c else []


def minima(costs: Sequence[float]) -> list[int]:
    """Return the places of the local minima of a sequence, the lowest first; infinite ones are none."""
    places, before = [], math.inf
    for place, cost in enumerate(costs):
        # A level stretch counts once, at its beginning.
        after = next((other for other in costs[place + 1:] if other != cost), math.inf)
        if cost < before and cost < after:
            places.append(place)
        before = cost
    return sorted(places, key=lambda place: costs[place])


def refine(grid_c: Sequence[float], place: int, cost_at: Callable[[float], float]) -> None:
    """Try targets on both sides of a grid point, to TARGET_RESOLUTION_K of the least cost between."""
    low_c, high_c = grid_c[max(place - 1, 0)], grid_c[min(place + 1, len(grid_c) - 1)]
    if high_c > low_c:
        least_of(low_c, high_c, lambda target_c: Trial(target_c, cost_at(target_c), None),
                 TARGET_RESOLUTION_K)


def pays_from_per_h(item: TargetWorth, without: TargetWorth, price_per_kwh: float) -> float:
    """Return the value of time [per h] from which a target costs less than no heating; inf: none."""
    if math.isinf(item.charging_time_s):
        return math.inf
    if math.isinf(without.charging_time_s):
        return 0.0
    more = price_per_kwh * (item.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH
    saved_h = (without.charging_time_s - item.charging_time_s) / SECONDS_PER_H
    if saved_h < LEAST_SAVED_S / SECONDS_PER_H:
        return math.inf
    return max(more, 0.0) / saved_h


def verdict_on(best: TargetWorth, without: TargetWorth, break_even: float, prices: Prices,
               problem: str | None) -> str:
    """
    Return the sentence for the driver; `problem` is why the unheated battery is not charged.

    `break_even` is the least value of time for which heating pays [per h], infinite where none does.
    """
    if math.isinf(best.cost):
        return f'This charger cannot charge the battery so far, whether it is heated or not: {problem}.'
    heating = f'heating the battery to {best.arrival_temperature_c:.1f} degC before arrival'
    if math.isinf(without.cost):
        return (f'Worth it: {heating} lets it charge within {duration_text(best.charging_time_s)}; '
                f'without, {problem}.')
    if 0.0 < without.cost - best.cost < LEAST_GAIN:
        return (f'It makes no difference: {heating} would save less than {LEAST_GAIN:.2f} in all. Some '
                f'heating pays as soon as an hour is worth {break_even:.2f} to you.')
    if best is not without:
        saved = _saved_text(best, without, prices)
        pays = ('Some heating pays whatever your time is worth' if break_even == 0.0 else
                f'Some heating pays as soon as an hour is worth {break_even:.2f} to you')
        return f'Worth it: {heating} {saved}. {pays}.'
    if math.isinf(break_even):
        return 'Not worth it: heating before arrival saves neither time nor money at this charger.'
    return (f'Not worth it at {prices.time_per_h:.2f} an hour: heating pays as soon as an hour is worth '
            f'{break_even:.2f} to you.')


def _saved_text(best: TargetWorth, without: TargetWorth, prices: Prices) -> str:
    saved_s = without.charging_time_s - best.charging_time_s
    more = prices.energy_per_kwh * (best.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH
    time = (f'saves {duration_text(saved_s)} at the charger' if saved_s >= 0.0 else
            f'takes {duration_text(-saved_s)} more at the charger')
    energy = f'costs {more:.2f} more for energy' if more >= 0.0 else f'saves {-more:.2f} of energy costs'
    return f'{time} and {energy}'
