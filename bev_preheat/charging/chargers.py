# SPDX-License-Identifier: Apache-2.0
"""
Choice of a charger: candidates along a route, each with its own best target, compared on the same end.

    total cost = price · bought energy + value of time · (charging time + detour + expected wait) + ageing

All candidates reach the end of the route with the same state of charge, so each departs with the charge for the
rest of the route: an early charger charges more, a late one less. The rest is driven without heating, from the
temperature after the session. If a charger is taken on arrival, the battery cools during the wait, and the target
allows for that (`expectation`). A detour is driven like the average of the route, half before the stop and half
after; its energy counts.
"""
from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np

from bev_preheat.charging.stop import CERTAIN, ChargingProspect
from bev_preheat.charging.target_worth import Prices, TargetWorth, Worth
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.errors import InvalidInput, quoted, share_hint
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.input_files import find_configuration
from bev_preheat.numerics import S_PER_H, S_PER_MIN, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc
from bev_preheat.route.segments import Places, Route
from bev_preheat.vehicle.description import Vehicle

# Tolerances of the departure's state of charge; the second applies if only the battery's temperature is open.
DEPARTURE_SOC_TOLERANCE, DEPARTURE_TOLERANCE = 1e-6, 1e-4
MOST_DEPARTURE_TRIALS, MOST_PASSES = 20, 3


@dataclass(frozen=True)
class Candidate:
    """
    A charger along a route.

    `instant_s` is the driving time from the start of the route to the exit for the charger [s];
    `charger_power_w` is at the vehicle's inlet [W]. `detour_s` covers both ways, `expected_wait_s` is the
    mean wait, including the chance of none [s]. It is free on arrival with `free_probability` (0 ... 1); with 1
    nothing is known about the chance, and the battery does not cool while the vehicle waits.
    """

    name: str
    instant_s: float
    charger_power_w: float
    energy_price_per_kwh: float
    detour_s: float = 0.0
    expected_wait_s: float = 0.0
    free_probability: float = 1.0

    @property
    def prospect(self) -> ChargingProspect:
        """The ChargingProspect: a vehicle that finds the charger taken waits."""
        taken = 1.0 - self.free_probability
        return CERTAIN if taken <= 0.0 else ChargingProspect(
            self.free_probability, wait_s=self.expected_wait_s / taken)


@dataclass(frozen=True)
class CandidateWorth:
    """
    Evaluation of a Candidate with its own best target.

    `problem` explains why it is ruled out, or is None. `departure_soc` is the state of charge at departure,
    `end_soc` at the end of the route; `worth` has all its targets. Costs are those of energy, and of time at the
    charger, on the detour and waiting; infinite with a problem. That of ageing is 0 if it has no price.
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
    ageing_cost: float = 0.0

    @property
    def total_cost(self) -> float:
        """Sum of all costs; infinite with a problem."""
        return self.energy_cost + self.charging_cost + self.detour_cost + self.wait_cost + self.ageing_cost

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible data, including the contract of `preheat worth`."""
        return {**vars(self.candidate), 'problem': self.problem, 'departure_soc': self.departure_soc,
                'end_soc': self.end_soc, 'energy_cost': self.energy_cost,
                'charging_cost': self.charging_cost, 'detour_cost': self.detour_cost,
                'wait_cost': self.wait_cost, 'total_cost': self.total_cost,
                **({'ageing_cost': self.ageing_cost} if self.ageing_cost else {}),
                'worth': None if self.worth is None else self.worth.as_dictionary()}


def rank_chargers(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                  candidates: Sequence[Candidate], end_soc: float,
                  time_per_h: float) -> list[CandidateWorth]:
    """
    Return the CandidateWorth of each Candidate, the cheapest first, those with a problem last.

    `end_soc` (0 ... 1) is required at the end of the route, `time_per_h` is the value of time. The reserve
    of the Goal holds on arrival at the charger and on the rest of the route. Raises InvalidInput if an input
    is not allowed.
    """
    check_situation(vehicle, route, state, goal)
    reserve, highest = reserve_soc(vehicle, goal), vehicle.battery.soc_range[1]
    if not reserve <= end_soc <= highest:
        raise InvalidInput(f'end state of charge: {end_soc:g} is not allowed; it must be {reserve:g} ... '
                           f"{highest:g}, from the reserve to the top of the vehicle's soc_range"
                           f'{share_hint(end_soc)}')
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
        # The battery's temperature at departure depends on that on arrival, and hardly affects the rest.
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
                departure_soc, Prices(candidate.energy_price_per_kwh, time_per_h), prospect=candidate.prospect)
            if math.isinf(worth.best.cost):
                return CandidateWorth(candidate, worth.verdict, departure_soc, worth=worth)
            # A battery that is hotter than its range at departure is soon within it.
            leaves_c = min(float(worth.best_choice.session.battery_temperature_c[-1]),
                           self._vehicle.battery.temperature_range_c[1])
        assert worth is not None
        best = worth.best
        end_soc = self._end_of_rest(leaves_c, departure_soc).soc[-1] if self._rest else departure_soc
        return CandidateWorth(
            candidate, None, departure_soc, float(end_soc), worth,
            candidate.energy_price_per_kwh * best.bought_energy_wh / WH_PER_KWH,
            time_per_h * best.charging_time_s / S_PER_H, time_per_h * candidate.detour_s / S_PER_H,
            self._wait_cost(best, time_per_h), best.ageing_cost)

    def _wait_cost(self, best: TargetWorth, time_per_h: float) -> float:
        """Return the mean cost of waiting: of its time, and of charging a battery that has cooled meanwhile."""
        taken = 1.0 - self._candidate.free_probability
        if taken == 0.0:
            return time_per_h * self._candidate.expected_wait_s / S_PER_H
        return taken * (best.not_charged_cost - best.charged_cost)

    def _unreached(self, unheated: Plan) -> str | None:
        """Return why the charger is out of reach, or None."""
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
        """Return the charge at departure, the resulting charge at the end, and a problem or None."""
        soc = self._end_soc
        if self._rest is not None:
            soc = highest = self._vehicle.battery.soc_range[1]
            for _ in range(MOST_DEPARTURE_TRIALS):
                rest = self._end_of_rest(temperature_c, soc)
                short = self._end_soc - rest.arrival_soc
                if soc == highest and (rest.stranding is not None or short > 0.0):
                    deficit = ('the vehicle would strand' if rest.stranding is not None else
                               f'{100.0 * rest.arrival_soc:.1f} % would be left at its end')
                    return soc, rest.arrival_soc, (
                        f'even {100.0 * highest:g} % is not enough for the rest of the route: {deficit}; '
                        f'{100.0 * self._end_soc:g} % is required')
                if abs(short) < DEPARTURE_SOC_TOLERANCE or rest.stranding is not None:
                    break
                soc = min(soc + short, highest)
            lowest_soc = 0.0 if rest.stranding is not None else float(rest.soc.min())
            if rest.stranding is not None or lowest_soc < self._reserve - DEPARTURE_SOC_TOLERANCE:
                return soc, rest.arrival_soc, (
                    f'a departure with {100.0 * soc:.1f} % would reach the end with {100.0 * self._end_soc:g} %, '
                    f'but fall to {100.0 * lowest_soc:.1f} % on the rest of the route; the reserve is '
                    f'{100.0 * self._reserve:g} %')
        if soc <= arrival_soc:
            return soc, self._end_soc, (
                f'not needed: the battery arrives with {100.0 * arrival_soc:.1f} %, and '
                f'{100.0 * soc:.1f} % is enough for the rest')
        return soc, self._end_soc, None


def _average(route: Route, duration_s: float, way: Route) -> Route:
    """Return a Route of one segment with the average of a route, and the air at the end of a way."""
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


SCHEMA = Path(__file__).with_name('chargers_schema.yaml')
M_PER_KM = 1000.0
# A place this close to the route's end [s] counts as its end: figures in files are rounded.
END_S = 1.0


def load_chargers(name_or_file: str | Path, route: Route, energy_price_per_kwh: float,
                  only: Sequence[str] = ()) -> tuple[list[Candidate], Path]:
    """
    Return the Candidates of a name (a file in config/chargers) or of a YAML file, along a Route; and that file.

    `energy_price_per_kwh` is the default price; with `only` (names), all other chargers are left out. Raises
    InvalidInput naming file, key, value and the allowed values.
    """
    path = find_configuration('chargers', name_or_file, '.yaml')
    nodes: list[FileData] = load_checked_yaml(path, SCHEMA)['chargers']
    names = [node['name'] for node in nodes]
    problems = [f'{path}: chargers: duplicate name {quoted(name)} ({count} times)'
                for name, count in Counter(names).items() if count > 1]
    candidates = []
    for index, node in enumerate(nodes):
        wrong = _problems(node, route)
        problems += [f'{path}: chargers[{index}] ({node["name"]}){problem}' for problem in wrong]
        if not wrong:
            candidates.append(_candidate(node, route, energy_price_per_kwh))
    problems += [f'--only: charger {quoted(name)} is unknown; {path} has: {", ".join(names)}'
                 for name in only if name not in names]
    if problems:
        raise InvalidInput(problems)
    return [candidate for candidate in candidates if not only or candidate.name in only], path


def _problems(node: FileData, route: Route) -> list[str]:
    """Return the problems of one charger that passed the schema."""
    problems = []
    if ('at_km' in node) == ('at_min' in node):
        problems.append(': needs either at_km or at_min')
    for key, most, unit in (('at_km', route.distance_m / M_PER_KM, 'km'),
                            ('at_min', route.total_duration_s / S_PER_MIN, 'min')):
        if key in node and node[key] > most + END_S / S_PER_MIN:
            problems.append(f'.{key}: {node[key]:g} is beyond the route, which ends at {most:.1f} {unit}')
    if ('free_probability' in node) != ('wait_min' in node):
        problems.append(': free_probability and wait_min must be given together')
    return problems


def _candidate(node: FileData, route: Route, energy_price_per_kwh: float) -> Candidate:
    if 'at_min' in node:
        instant_s = node['at_min'] * S_PER_MIN
    else:
        places = Places.of_route(route)
        # While the vehicle stands, one distance has many instants; the first one counts.
        distance_m, first = np.unique(places.distance_m, return_index=True)
        instant_s = float(np.interp(node['at_km'] * M_PER_KM, distance_m, places.time_s[first]))
    if instant_s > route.total_duration_s - END_S:
        instant_s = route.total_duration_s
    return Candidate(
        node['name'], instant_s, float(node['charger_power_w']),
        float(node.get('energy_price_per_kwh', energy_price_per_kwh)),
        node.get('detour_min', 0.0) * S_PER_MIN,
        (1.0 - node.get('free_probability', 1.0)) * node.get('wait_min', 0.0) * S_PER_MIN,
        float(node.get('free_probability', 1.0)))
