# SPDX-License-Identifier: Apache-2.0
"""
Which charger: candidates along a route, each with its own best target, compared on the same end.

    total cost = price · bought energy + value of time · (charging time + detour + expected wait)

All arrive at the end of the route with the same state of charge. So each leaves its charger with what
carries the rest of the route to that: a charger that comes early charges more, one that comes late less.
The rest is driven without heating, from the temperature that the session leaves. A detour is driven as
the route is on average, half before the stop and half after; its energy counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import arrival_state, stop_after, WH_PER_KWH
from bev_preheat.charging.worth import find_worth, Prices, SECONDS_PER_H
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, check_situation, reserve_soc

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.charging.worth import Worth
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

# The departure's state of charge is known to this where all that is left is how warm the battery leaves.
SOC_TOLERANCE, DEPARTURE_TOLERANCE = 1e-6, 1e-4
MOST_TRIALS, MOST_PASSES = 20, 3


@dataclass(frozen=True)
class Candidate:
    """
    A charger along a route.

    `instant_s` is driving time from the start of the route to where it is left for the charger [s];
    `charger_power_w` is at the vehicle's inlet [W]. `detour_s` is there and back, `expected_wait_s` the
    mean of what is waited, 0 included [s].
    """

    name: str
    instant_s: float
    charger_power_w: float
    energy_price_per_kwh: float
    detour_s: float = 0.0
    expected_wait_s: float = 0.0


@dataclass(frozen=True)
class CandidateWorth:
    """
    What a Candidate comes to with its own best target.

    `problem` says why it is none, None where it is one. `departure_soc` is what it is left with,
    `end_soc` what is there at the end of the route; `worth` has all its targets. Costs are of energy
    and of time at the charger, on the detour and waiting; infinite where there is a problem.
    """

    candidate: Candidate
    problem: str | None
    departure_soc: float = math.nan
    end_soc: float = math.nan
    worth: Worth | None = None
    energy_cost: float = math.inf
    charging_cost: float = math.inf
    detour_cost: float = math.inf
    wait_cost: float = math.inf

    @property
    def total_cost(self) -> float:
        """Sum of all costs; infinite where there is a problem."""
        return self.energy_cost + self.charging_cost + self.detour_cost + self.wait_cost

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON holds it, with the contract of `preheat worth` inside."""
        return {**vars(self.candidate), 'problem': self.problem, 'departure_soc': self.departure_soc,
                'end_soc': self.end_soc, 'energy_cost': self.energy_cost,
                'charging_cost': self.charging_cost, 'detour_cost': self.detour_cost,
                'wait_cost': self.wait_cost, 'total_cost': self.total_cost,
                'worth': None if self.worth is None else self.worth.as_dictionary()}


def rank_chargers(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                  candidates: Sequence[Candidate], end_soc: float,
                  time_per_h: float) -> list[CandidateWorth]:
    """
    Return the CandidateWorth of each Candidate, the cheapest first, those with a problem last.

    `end_soc` (0 ... 1) is wanted at the end of the route, `time_per_h` is the value of time. The reserve
    of the Goal holds on arrival at the charger and on the rest of the route. Raises InvalidInput where
    something is not allowed.
    """
    check_situation(vehicle, route, state, goal)
    reserve, highest = reserve_soc(vehicle, goal), vehicle.battery.soc_range[1]
    if not reserve <= end_soc <= highest:
        raise InvalidInput(f'end state of charge: {end_soc:g} is not allowed; it must be {reserve:g} ... '
                           f"{highest:g}, from the reserve to the top of the vehicle's soc_range")
    found = [_Leg(vehicle, route, state, goal, candidate, end_soc).worth(time_per_h)
             for candidate in candidates]
    return sorted(found, key=lambda item: item.total_cost)


class _Leg:
    """The way to one charger, and on from it."""

    def __init__(self, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                 candidate: Candidate, end_soc: float) -> None:
        self._vehicle, self._state, self._goal = vehicle, state, goal
        self._candidate, self._end_soc = candidate, end_soc
        self._reserve = reserve_soc(vehicle, goal)
        self._way = route.before(candidate.instant_s)
        self._rest = (route.after(candidate.instant_s)
                      if candidate.instant_s < route.total_duration_s else None)
        if candidate.detour_s > 0.0:
            half = _average(route, 0.5 * candidate.detour_s, self._way)
            self._way = self._way.followed_by(half)
            self._rest = half if self._rest is None else half.followed_by(self._rest)

    def worth(self, time_per_h: float) -> CandidateWorth:
        """Return the CandidateWorth."""
        candidate = self._candidate
        unheated = plan_unheated(self._vehicle, self._way, self._state, self._goal)
        problem = self._unreached(unheated)
        if problem is not None:
            return CandidateWorth(candidate, problem)
        # How warm the battery leaves depends on how it arrives, and hardly matters to the rest.
        leaves_c, departure_soc, worth = unheated.arrival_temperature_c, math.nan, None
        for _ in range(MOST_PASSES):
            before_soc = departure_soc
            departure_soc, end_soc, problem = self._departure(leaves_c, unheated.arrival_soc)
            if problem is not None:
                return CandidateWorth(candidate, problem, departure_soc)
            if worth is not None and abs(departure_soc - before_soc) <= DEPARTURE_TOLERANCE:
                departure_soc = before_soc
                break
            worth = find_worth(
                self._vehicle, self._way, self._state, self._goal, candidate.charger_power_w,
                departure_soc, Prices(candidate.energy_price_per_kwh, time_per_h))
            if math.isinf(worth.best.cost):
                return CandidateWorth(candidate, worth.verdict, departure_soc, worth=worth)
            leaves_c = self._leaves_c(worth, departure_soc)
        assert worth is not None
        best = worth.best
        end_soc = self._end_of_rest(leaves_c, departure_soc).soc[-1] if self._rest else departure_soc
        hour_s = SECONDS_PER_H
        return CandidateWorth(
            candidate, None, departure_soc, float(end_soc), worth,
            candidate.energy_price_per_kwh * best.bought_energy_wh / WH_PER_KWH,
            time_per_h * best.charging_time_s / hour_s, time_per_h * candidate.detour_s / hour_s,
            time_per_h * candidate.expected_wait_s / hour_s)

    def _unreached(self, unheated: Plan) -> str | None:
        """Return why the charger is not reached, None where it is."""
        if unheated.stranding is not None:
            return (f'out of reach: the battery will be empty after {duration_text(unheated.stranding.at_s)} '
                    f'({unheated.stranding.deficit_wh / WH_PER_KWH:.2f} kWh short)')
        lowest_soc = float(unheated.soc.min())
        if lowest_soc < self._reserve:
            return (f'out of reach: the charge would fall to {100.0 * lowest_soc:.1f} % on the way; the '
                    f'reserve is {100.0 * self._reserve:g} %')
        return None

    def _end_of_rest(self, temperature_c: float, soc: float) -> Plan:
        assert self._rest is not None
        return plan_unheated(self._vehicle, self._rest, BatteryState(temperature_c, soc), self._goal)

    def _departure(self, temperature_c: float, arrival_soc: float) -> tuple[float, float, str | None]:
        """Return what to leave with, what comes of it at the end, and why that is impossible, or None."""
        soc = self._end_soc
        if self._rest is not None:
            soc = highest = self._vehicle.battery.soc_range[1]
            for _ in range(MOST_TRIALS):
                rest = self._end_of_rest(temperature_c, soc)
                short = self._end_soc - rest.arrival_soc
                if soc == highest and (rest.stranding is not None or short > 0.0):
                    deficit = ('the vehicle would strand' if rest.stranding is not None else
                               f'{100.0 * rest.arrival_soc:.1f} % would be left at its end')
                    return soc, rest.arrival_soc, (
                        f'even {100.0 * highest:g} % is not enough for the rest of the route: {deficit}; '
                        f'{100.0 * self._end_soc:g} % is required')
                if abs(short) < SOC_TOLERANCE or rest.stranding is not None:
                    break
                soc = min(soc + short, highest)
            lowest_soc = 0.0 if rest.stranding is not None else float(rest.soc.min())
            if rest.stranding is not None or lowest_soc < self._reserve - SOC_TOLERANCE:
                return soc, rest.arrival_soc, (
                    f'a departure with {100.0 * soc:.1f} % would reach the end with {100.0 * self._end_soc:g} %, '
                    f'but fall to {100.0 * lowest_soc:.1f} % on the rest of the route; the reserve is '
                    f'{100.0 * self._reserve:g} %')
        if soc <= arrival_soc:
            return soc, self._end_soc, (
                f'not needed: the battery arrives with {100.0 * arrival_soc:.1f} %, and '
                f'{100.0 * soc:.1f} % is enough for the rest')
        return soc, self._end_soc, None

    def _leaves_c(self, worth: Worth, departure_soc: float) -> float:
        """Return how warm the battery leaves the charger with the best target [deg C]."""
        goal, best = self._goal, worth.best
        inputs = self._vehicle, self._way, self._state
        plan = (plan_unheated(*inputs, goal) if best is worth.without_heating else
                plan_preheating(*inputs, replace(goal, target_temperature_c=best.target_c)))
        stop = stop_after(self._way, self._candidate.charger_power_w, departure_soc)
        hottest_c = self._vehicle.battery.temperature_range_c[1]
        session = charge(self._vehicle, stop, arrival_state(plan))
        # A battery that leaves hotter than its range is soon within it.
        return min(float(session.battery_temperature_c[-1]), hottest_c)


def _average(route: Route, duration_s: float, way: Route) -> Route:
    """Return a Route of one segment, driven as a route is on average, with the air where a way ends."""
    mean = route.resampled(route.total_duration_s)
    last = way.segments(len(way) - 1, len(way))
    return replace(
        mean, duration_s=0.0 * mean.duration_s + duration_s,
        ambient_temperature_c=last.ambient_temperature_c,
        cabin_heating_power_w=last.cabin_heating_power_w,
        auxiliary_power_w=last.auxiliary_power_w)


def ranking_verdict(ranked: Sequence[CandidateWorth]) -> str:
    """Return the sentence for the driver."""
    able = [item for item in ranked if item.problem is None]
    if not able:
        if all(item.problem is not None and item.problem.startswith('not needed') for item in ranked):
            return 'No charger is needed: the charge is enough for the whole route.'
        return 'None of these chargers suits this route.'
    best = able[0]
    assert best.worth is not None
    target = best.worth.best
    heating = ('without heating before arrival' if target is best.worth.without_heating else
               f'with the battery heated to {target.arrival_temperature_c:.1f} degC')
    sentence = (f'{best.candidate.name}, {heating}: {best.total_cost:.2f} in all, '
                f'{duration_text(target.charging_time_s)} at the charger to '
                f'{100.0 * best.departure_soc:.0f} %')
    if len(able) > 1:
        sentence += (f'; {able[1].candidate.name} costs {able[1].total_cost - best.total_cost:.2f} more')
    return f'{sentence}.'
