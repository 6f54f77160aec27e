# SPDX-License-Identifier: Apache-2.0
"""
The best target under uncertainty against a search over start and end of heating, on random drives.

It is uncertain whether and when the vehicle charges. The search knows no target: it heats with full power between
two instants up to the planned arrival, at which the planner switches off, tries a grid of both, and refines the
best of it. Like a plan, it keeps the reserve of charge and the power that the drive needs. Its cost is computed
here: arrival times by a quadrature of its own with more points, each session simulated with the cheapest heating
at the charger, the lost energy as the integral of the open-circuit voltage. The same account judges the planner's
best target.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.charging.expectation import by_the_clock
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import ChargingProspect
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_figures
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FloatArray, FLOATS, JOULES_PER_WH
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat_studies.optimality.charging_trips import ChargingTrip, draw_charging_trip
from bev_preheat_studies.study import add_study, check_study_arguments, distribution, Study, text_of

COMPARED, NOT_DRIVEN = 'compared', 'not driven'
# (low, high) of uniform distributions, and the share of the drives with each uncertainty.
PROBABILITY = (0.05, 1.0)
DEVIATION_S, DEVIATION_SHARE = (60.0, 600.0), 0.5
KNOWN_S, KNOWN_SHARE = (300.0, 1500.0), 0.3
# Points of the judge's quadrature.
ARRIVALS = 11
# Starts and durations of heating on the grid, its points that are refined, and the step at which that ends [s].
STARTS, DURATIONS, REFINED, LEAST_STEP_S = 12, 6, 2, 15.0
LONGEST_SESSION_S = 24.0 * 3600.0
PERCENTILES = {'least': 0.0, 'median': 50.0, '95 %': 95.0, 'worst': 100.0}


@dataclass(frozen=True)
class Gap:
    """One drive: expected cost of best target, best start and end, no heating, and target for certain charging."""

    number: int
    outcome: str
    detail: str
    prospect: ChargingProspect
    has_heat_path: bool = False
    cost: float = math.nan
    searched_cost: float = math.nan
    unheated_cost: float = math.nan
    certain_cost: float = math.nan

    @property
    def gap(self) -> float:
        """Share by which the best target costs more than the best start and end; negative: less."""
        return self.cost / self.searched_cost - 1.0


def draw_prospect(seed: int, number: int) -> ChargingProspect:
    """Return the ChargingProspect of a drive of the study."""
    random = np.random.default_rng([seed, number, 40])
    probability = float(random.uniform(*PROBABILITY))
    deviation_s, known_s = float(random.uniform(*DEVIATION_S)), float(random.uniform(*KNOWN_S))
    return ChargingProspect(probability, deviation_s if random.uniform() < DEVIATION_SHARE else 0.0,
                            known_s if random.uniform() < KNOWN_SHARE else 0.0)


class Judge:
    """The expected cost of any heating on one drive under a ChargingProspect."""

    def __init__(self, drawn: ChargingTrip, prospect: ChargingProspect) -> None:
        """Drive the unheated vehicle to each arrival time."""
        self._drawn, self._prospect = drawn, prospect
        self._heating = ChargerHeating(drawn.vehicle, drawn.stop, drawn.prices)
        self._planned = make_trip(drawn.vehicle, drawn.route)
        self._allowed_w = power_deficit(self._planned, drive_as_planned(
            self._planned, drawn.state, np.zeros(len(drawn.route)))).worst_w
        deviation_s = prospect.arrival_deviation_s
        points, weights = np.polynomial.hermite_e.hermegauss(ARRIVALS if deviation_s > 0.0 else 1)
        self._arrivals: list[tuple[float, Trip, float]] = []
        for point, weight in zip(points.tolist(), (weights / weights.sum()).tolist()):
            pace = max(1.0 + point * deviation_s / drawn.route.total_duration_s, 0.5)
            route = replace(drawn.route.with_propulsion(1.0 / pace), duration_s=pace * drawn.route.duration_s,
                            speed_mps=drawn.route.speed_mps / pace)
            trip = make_trip(drawn.vehicle, route)
            self._arrivals.append((weight, trip, float(drive_as_planned(
                trip, drawn.state, np.zeros(len(trip.route))).soc[-1])))

    def allows(self, power_of: Callable[[Trip, float], FloatArray]) -> bool:
        """Return whether a heating keeps the reserve of charge, and the power for the drive, as a plan does."""
        driven = drive_as_planned(self._planned, self._drawn.state, power_of(self._planned, math.inf))
        reserve = reserve_soc(self._drawn.vehicle, self._drawn.goal)
        return (driven.empty_at_s is None and float(driven.soc[-1]) >= reserve
                and power_deficit(self._planned, driven).worst_w <= self._allowed_w)

    def cost(self, power_of: Callable[[Trip, float], FloatArray]) -> float:
        """Return the expected cost; `power_of(trip, until_s)` is the heater power on a trip until then [s]."""
        drawn, prospect, cost = self._drawn, self._prospect, 0.0
        for weight, trip, unheated_soc in self._arrivals:
            driven = drive_as_planned(trip, drawn.state, power_of(trip, math.inf))
            end_soc = float(driven.soc[-1])
            if prospect.known_before_arrival_s > 0.0:
                known_s = max(0.0, trip.route.total_duration_s - prospect.known_before_arrival_s)
                end_soc = float(drive_as_planned(trip, drawn.state, power_of(trip, known_s)).soc[-1])
            lost_wh = self._energy_wh(end_soc, unheated_soc, float(driven.temperature_c[-1]))
            not_charged = drawn.prices.cost(lost_wh, 0.0)
            state = driven.arrival_state
            charged = 0.0
            if state.soc < drawn.stop.departure_soc:
                session = self._heating.choose(replace(state, temperature_c=min(
                    state.temperature_c, drawn.vehicle.battery.temperature_range_c[1]))).session
                charged = (drawn.prices.cost(session.bought_energy_wh, session.charging_time_s)
                           if math.isfinite(session.charging_time_s) else drawn.prices.cost(
                               self._energy_wh(state.soc, drawn.stop.departure_soc, drawn.stop.ambient_c),
                               LONGEST_SESSION_S))
            cost += weight * (prospect.probability * charged + (1.0 - prospect.probability) * not_charged)
        return cost

    def _energy_wh(self, from_soc: float, to_soc: float, temperature_c: float) -> float:
        battery = self._drawn.vehicle.battery
        voltage_v = battery.open_circuit_voltage.function(FLOATS)
        socs = np.linspace(from_soc, to_soc, 21)
        volts = np.array([voltage_v(soc, temperature_c) for soc in socs.tolist()])
        return float(np.sum(0.5 * (volts[1:] + volts[:-1]) * np.diff(socs))) * battery.capacity_as / JOULES_PER_WH


def between(start_s: float, end_s: float) -> Callable[[Trip, float], FloatArray]:
    """Return the heater's power for `Judge.cost`: full between two instants [s]."""
    def power_of(trip: Trip, until_s: float) -> FloatArray:
        time_s = trip.time_s
        on_s = np.clip(np.minimum(time_s[1:], min(end_s, until_s)) - np.maximum(time_s[:-1], start_s), 0.0, None)
        power_w: FloatArray = trip.heater_limit_w * on_s / trip.route.duration_s
        return power_w

    return power_of


def search(judge: Judge, duration_s: float) -> tuple[float, float, float]:
    """Return the least expected cost over start and end [s] of heating within `duration_s` [s], and both."""
    tried: dict[tuple[float, float], float] = {}

    def attempt(start_s: float, end_s: float) -> float:
        at = (min(max(start_s, 0.0), duration_s), min(end_s, duration_s))
        if at not in tried:
            heating = between(*at) if at[1] > at[0] else between(0.0, 0.0)
            tried[at] = judge.cost(heating) if at[1] <= at[0] or judge.allows(heating) else math.inf
        return tried[at]

    starts_s = np.linspace(0.0, duration_s, STARTS, endpoint=False).tolist()
    for start_s in starts_s:
        for share in np.linspace(0.0, 1.0, DURATIONS + 1)[1:].tolist():
            attempt(start_s, start_s + share * (duration_s - start_s))
    attempt(0.0, 0.0)
    for start_s, end_s in sorted(tried, key=tried.__getitem__)[:REFINED]:
        step_s = duration_s / STARTS
        while step_s > LEAST_STEP_S:
            around = [(start_s + by * step_s, end_s + to * step_s) for by in (-1, 0, 1) for to in (-1, 0, 1)]
            best = min(around, key=lambda at: attempt(*at))
            if attempt(*best) < attempt(start_s, end_s):
                start_s, end_s = best
            else:
                step_s /= 2.0
    return min((cost, *at) for at, cost in tried.items())


def compare(seed: int, number: int) -> Gap:
    """Return the Gap of a drive of the study."""
    drawn, prospect = draw_charging_trip(seed, number), draw_prospect(seed, number)
    has_heat_path = not drawn.vehicle.heat_path.is_direct
    inputs = drawn.vehicle, drawn.route, drawn.state, drawn.goal
    charger = drawn.stop.charger_power_w, drawn.stop.departure_soc, drawn.prices
    try:
        if plan_unheated(*inputs).stranding is not None:
            return Gap(number, NOT_DRIVEN, 'the charge is not enough', prospect)
        found = find_worth(*inputs, *charger, prospect=prospect)
        certain = find_worth(*inputs, *charger)
    except InvalidInput as error:
        return Gap(number, NOT_DRIVEN, str(error), prospect)
    judge = Judge(drawn, prospect)

    def cost_of(target_c: float | None, heats_until_arrival: bool) -> float:
        if target_c is None:
            return judge.cost(between(0.0, 0.0))
        plan = plan_preheating(*inputs[:3], replace(
            drawn.goal, target_temperature_c=target_c, heats_until_arrival=heats_until_arrival))
        return judge.cost(partial(by_the_clock, plan))

    best = found.best
    return Gap(
        number, COMPARED, '', prospect, has_heat_path,
        cost_of(None if best is found.without_heating else best.target_c, prospect.heats_until_arrival),
        search(judge, drawn.route.total_duration_s)[0], judge.cost(between(0.0, 0.0)),
        cost_of(None if certain.best is certain.without_heating else certain.best.target_c, True))


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    add_study(subparsers, 'uncertain_charging', run, __doc__,
              'plans if it is uncertain whether and when the vehicle charges, against a search', 'drives')


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments, wanted='drives')
    return Study(
        partial(compare, arguments.seed), Gap, arguments.drives,
        {'study': 'uncertain_charging', 'seed': arguments.seed}, lambda gap: gap.outcome == COMPARED,
        'compared drives').conduct(arguments, _show)


def summarise(gaps: Sequence[Gap]) -> dict[str, Any]:
    """Return the figures of a study as plain values for JSON; gaps as shares of the cost."""
    compared = [gap for gap in gaps if gap.outcome == COMPARED]
    groups = {
        'all drives': compared,
        'arrival time exact': [gap for gap in compared if gap.prospect.arrival_deviation_s == 0.0],
        'arrival time uncertain': [gap for gap in compared if gap.prospect.arrival_deviation_s > 0.0],
        'heat arrives at once': [gap for gap in compared if not gap.has_heat_path],
        'with a heat path': [gap for gap in compared if gap.has_heat_path]}
    saved = [1.0 - gap.cost / gap.certain_cost for gap in compared]
    return {'drives': len(gaps), 'compared': len(compared),
            'saved': {'mean': float(np.mean(saved)), 'most': max(saved)} if saved else {},
            'gaps': {name: {'drives': len(group), **distribution((gap.gap for gap in group), **PERCENTILES)}
                     for name, group in groups.items()}}


def _show(console: Console, gaps: list[Gap]) -> dict[str, Any]:
    summary = summarise(gaps)
    console.print(f'{summary["drives"]} drives: {summary["compared"]} compared, '
                  f'{summary["drives"] - summary["compared"]} not driven', soft_wrap=True)
    print_figures(
        console, 'Expected cost of the best target above the best start and end of heating (%)',
        ('', 'drives', *PERCENTILES),
        [(name, str(figures['drives']), *(text_of(figures.get(key), '.4f', 100.0) for key in PERCENTILES))
         for name, figures in summary['gaps'].items()])
    if summary['saved']:
        console.print('Compared with the best target for certain charging the expected cost is lower by '
                      f'{100.0 * summary["saved"]["mean"]:.2f} % in the mean, '
                      f'{100.0 * summary["saved"]["most"]:.2f} % at most.', soft_wrap=True)
    return {'summary': summary}
